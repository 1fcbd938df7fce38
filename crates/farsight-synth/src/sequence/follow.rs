//! How drivers keep their distance: the intelligent driver model (Treiber, Hennecke, Helbing 2000).

/// Comfortable acceleration and deceleration, m/s², the gap in a queue, metres, and the time gap, seconds.
const ACCELERATION: f64 = 1.5;
const DECELERATION: f64 = 2.2;
const QUEUE_GAP_M: f64 = 2.0;
const TIME_GAP_S: f64 = 1.2;

/// No car brakes harder, m/s².
const HARDEST: f64 = 8.0;

/// Who is ahead: the free road up to it, metres, and its speed the same way, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Leader {
    pub(super) gap_m: f64,
    pub(super) speed: f64,
}

/// The acceleration of a driver, m/s².
pub(super) fn acceleration(speed: f64, desired: f64, leader: Option<Leader>) -> f64 {
    let free = 1.0 - (speed / desired.max(0.1)).powi(4);
    let kept = leader.map_or(0.0, |Leader { gap_m, speed: other }| {
        let closing = speed * (speed - other) / (2.0 * (ACCELERATION * DECELERATION).sqrt());
        let wanted = QUEUE_GAP_M + (TIME_GAP_S * speed + closing).max(0.0);
        (wanted / gap_m.max(0.1)).powi(2)
    });
    (ACCELERATION * (free - kept)).clamp(-HARDEST, ACCELERATION)
}

#[cfg(test)]
mod tests {
    use super::{Leader, acceleration};

    #[test]
    fn a_driver_settles_behind_a_slower_one_and_never_touches_it() {
        for lead_speed in [0.0, 5.0, 12.0] {
            let (mut gap_m, mut speed, mut least) = (60.0, 14.0, f64::INFINITY);
            for _ in 0..3000 {
                let a = acceleration(speed, 15.0, Some(Leader { gap_m, speed: lead_speed }));
                speed = f64::max(speed + 0.02 * a, 0.0);
                gap_m += 0.02 * (lead_speed - speed);
                least = f64::min(least, gap_m);
            }
            assert!(least > 0.5, "{lead_speed}: {least}");
            assert!((speed - lead_speed).abs() < 0.2, "{lead_speed}: {speed}");
        }
    }
}
