//! What happens ahead: somebody cuts in, brakes hard, or is about to be reached.

use std::collections::BTreeMap;

use farsight_core::ObjectClass;
use serde::{Deserialize, Serialize};

use crate::json::FrameRecord;

/// Our own way ahead is so wide to each side, metres; who is farther aside than the second is beside it.
const HALF_WAY_M: f64 = 1.4;
const BESIDE_M: f64 = 2.0;

/// Who cuts in is no farther ahead, metres, and was beside our way no longer ago, seconds.
const CUT_IN_REACH_M: f64 = 40.0;
const CUT_IN_S: f64 = 3.0;

/// Who brakes hard brakes by so much, m/s², as seen from us, and by more than its error bar.
const HARD_MPS2: f64 = 3.0;
const HARD_REACH_M: f64 = 70.0;

/// Who is in our way then with this probability meets us.
const MEETS: f64 = 0.5;

/// An event is not told again of the same track before so long has passed without it, seconds.
const QUIET_S: f64 = 2.0;

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum EventKind {
    /// A vehicle came from beside our way into it.
    CutIn,
    /// A vehicle in our way brakes hard.
    HardBraking,
    /// The time to collision with something in our way is below the limit.
    TimeToCollision,
}

/// Something that happened, in the frame in which it was noticed first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Event {
    /// What.
    pub event: EventKind,
    /// Number of the frame, from 0.
    pub frame: u64,
    /// Its time, seconds.
    pub time_s: f64,
    /// Identity of the track.
    pub id: u64,
    /// Its class, by KITTI's name.
    pub class: String,
    /// Its depth, metres.
    pub range_m: f64,
    /// Its time to collision, seconds; null where there is none.
    pub ttc_s: Option<f64>,
    /// By so much its closing speed grows in a second, m/s²; null where that is not known.
    pub closing_acceleration_mps2: Option<f64>,
}

/// Notices events in the frames of one video. Our way is taken to go straight ahead.
#[derive(Debug, Clone)]
pub struct EventFinder {
    ttc_limit_s: f64,
    known: BTreeMap<u64, Known>,
}

/// What is remembered of a track.
#[derive(Debug, Clone, Default)]
struct Known {
    /// When it was beside our way last.
    beside_s: Option<f64>,
    /// When each event held last.
    told: BTreeMap<EventKind, f64>,
    seen_s: f64,
}

impl EventFinder {
    /// With a limit for the time to collision, seconds.
    pub fn new(ttc_limit_s: f64) -> Self {
        Self { ttc_limit_s, known: BTreeMap::new() }
    }

    /// What is noticed in the next frame.
    pub fn update(&mut self, record: &FrameRecord) -> Vec<Event> {
        let time_s = record.time_s;
        let mut events = Vec::new();
        for track in &record.tracks {
            let known = self.known.entry(track.id).or_default();
            known.seen_s = time_s;
            let is_vehicle = is_vehicle(&track.class);
            let [x, _, z] = track.location;
            let is_in_way = x.abs() < HALF_WAY_M;
            let inward = track.velocity_mps.is_some_and(|[vx, ..]| vx * x <= 0.0 || vx.abs() < 0.5);
            let was_beside = known.beside_s.is_some_and(|then_s| time_s - then_s < CUT_IN_S);
            let meets = track.ttc_s.is_some_and(|ttc_s| ttc_s < self.ttc_limit_s)
                && track.in_path_probability.is_some_and(|probability| probability > MEETS);
            let growth = track.closing_acceleration_mps2;
            let brakes = growth
                .zip(track.closing_acceleration_sigma_mps2)
                .is_some_and(|(growth, sigma)| growth > HARD_MPS2.max(sigma));
            let holds = [
                (EventKind::CutIn, is_vehicle && is_in_way && inward && was_beside && z < CUT_IN_REACH_M),
                (EventKind::HardBraking, is_vehicle && is_in_way && z < HARD_REACH_M && brakes),
                (EventKind::TimeToCollision, meets),
            ];
            for (event, _) in holds.into_iter().filter(|(_, holds)| *holds) {
                let last_s = known.told.insert(event, time_s);
                if last_s.is_none_or(|last_s| time_s - last_s > QUIET_S) {
                    events.push(Event {
                        event,
                        frame: record.frame,
                        time_s,
                        id: track.id,
                        class: track.class.clone(),
                        range_m: track.range_m,
                        ttc_s: track.ttc_s,
                        closing_acceleration_mps2: growth,
                    });
                }
            }
            if x.abs() > BESIDE_M {
                known.beside_s = Some(time_s);
            }
        }
        self.known.retain(|_, known| time_s - known.seen_s < CUT_IN_S);
        events
    }
}

fn is_vehicle(class: &str) -> bool {
    !matches!(ObjectClass::from_name(class), ObjectClass::Pedestrian | ObjectClass::PersonSitting)
}

#[cfg(test)]
mod tests {
    use super::{EventFinder, EventKind};
    use crate::json::FrameRecord;

    /// A track at x and z, with velocities across and closing, the growth of the latter, and when it meets us.
    fn frame(
        number: u64,
        [x, z]: [f64; 2],
        [across, closing, growth]: [f64; 3],
        meets: Option<[f64; 2]>,
    ) -> FrameRecord {
        let mut record = FrameRecord::new(number, 0.1 * number as f64, &[], None);
        record.tracks = vec![crate::json::TrackRecord {
            id: 1,
            class: "Car".to_owned(),
            score: 0.9,
            age: number,
            box2d: [0.0, 0.0, 10.0, 10.0],
            dimensions_hwl: [1.5, 1.7, 4.2],
            location: [x, 1.6, z],
            rotation_y: -1.57,
            range_m: z,
            range_sigma_m: 1.0,
            range_interval_m: [z - 1.6, z + 1.6],
            velocity_mps: Some([across, 0.0, -closing]),
            velocity_sigma_mps: Some([0.2; 3]),
            closing_mps: Some(closing),
            closing_sigma_mps: Some(0.2),
            ttc_s: meets.map(|[ttc_s, _]| ttc_s),
            ttc_interval_s: None,
            in_path_probability: meets.map(|[_, probability]| probability),
            closing_acceleration_mps2: Some(growth),
            closing_acceleration_sigma_mps2: Some(1.5),
            coasting: false,
            speed_mps: None,
            speed_sigma_mps: None,
        }];
        record
    }

    fn kinds(frames: impl Iterator<Item = FrameRecord>) -> Vec<(EventKind, u64)> {
        let mut finder = EventFinder::new(2.0);
        frames.flat_map(|frame| finder.update(&frame)).map(|event| (event.event, event.frame)).collect()
    }

    #[test]
    fn who_comes_in_from_beside_cuts_in_once() {
        let inward = |k: u64| frame(k, [3.5 - 0.15 * k as f64, 20.0], [-1.5, 0.0, 0.0], None);
        assert_eq!(kinds((0..30).map(inward)), [(EventKind::CutIn, 15)]);
        // Who passes by beside our way does not.
        assert_eq!(kinds((0..30).map(|k| frame(k, [3.5, 40.0 - k as f64], [0.0, 10.0, 0.0], Some([1.0, 0.1])))), []);
    }

    #[test]
    fn hard_braking_is_told_from_a_steady_approach() {
        let grows = |k: u64| if k < 10 { 1.0 } else { 5.0 };
        let braking = |k: u64| frame(k, [0.2, 40.0], [0.0, 2.0, grows(k)], None);
        assert_eq!(kinds((0..20).map(braking)), [(EventKind::HardBraking, 10)]);
        assert_eq!(kinds((0..20).map(|k| frame(k, [0.2, 40.0], [0.0, 5.0, 1.0], Some([6.0, 1.0])))), []);
        // Beside our way it is not told.
        assert_eq!(kinds((0..20).map(|k| frame(k, [3.2, 40.0], [0.0, 2.0, grows(k)], None))), []);
    }

    #[test]
    fn a_short_time_to_collision_is_told_when_it_begins() {
        let near = |k: u64| frame(k, [0.0, 30.0 - k as f64], [0.0, 10.0, 0.0], Some([3.0 - 0.1 * k as f64, 0.9]));
        assert_eq!(kinds((0..20).map(near)), [(EventKind::TimeToCollision, 11)]);
    }
}
