//! How a closing speed grows.

use std::collections::VecDeque;

use crate::track::Acceleration;

/// The slope is taken over so long, seconds, and over so many frames at least.
const WINDOW_S: f64 = 0.6;
const MIN_FRAMES: usize = 4;

/// A window is full when it holds this share of its time.
const FULL_SHARE: f64 = 0.8;

/// Times that differ by less are the same, seconds.
const TIME_TOLERANCE_S: f64 = 1e-6;

/// The closing speeds of a track in the latest window.
#[derive(Debug, Clone, Default)]
pub(crate) struct ClosingWindow {
    /// Times, seconds, and closing speeds, m/s.
    speeds: VecDeque<[f64; 2]>,
}

impl ClosingWindow {
    /// Takes the closing speed of another frame, with its standard deviation. Answers the slope once the window is
    /// full.
    pub(crate) fn update(&mut self, time_s: f64, closing_mps: f64, sigma_mps: f64) -> Option<Acceleration> {
        self.speeds.push_back([time_s, closing_mps]);
        while self.speeds.front().is_some_and(|[then_s, _]| time_s - then_s > WINDOW_S + TIME_TOLERANCE_S) {
            self.speeds.pop_front();
        }
        let [first_s, _] = *self.speeds.front()?;
        let length_s = time_s - first_s;
        if length_s < FULL_SHARE * WINDOW_S || self.speeds.len() < MIN_FRAMES {
            return None;
        }
        let count = self.speeds.len() as f64;
        // From now on backwards, so that it does not matter when it was.
        let mean_s = self.speeds.iter().map(|[then_s, _]| then_s - time_s).sum::<f64>() / count;
        let mean_mps = self.speeds.iter().map(|[_, mps]| mps).sum::<f64>() / count;
        let centred = || self.speeds.iter().map(|[then_s, mps]| (then_s - time_s - mean_s, mps - mean_mps));
        let product: f64 = centred().map(|(s, mps)| s * mps).sum();
        let square: f64 = centred().map(|(s, _)| s * s).sum();
        // The errors at both ends of the window have little in common; in between they go from one to the other.
        let sigma = f64::sqrt(2.0) * sigma_mps / length_s;
        Some(Acceleration { closing_mps2: product / square, sigma_mps2: sigma })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_a_speed_that_grows_evenly() {
        let mut window = ClosingWindow::default();
        let mut last = None;
        for frame in 0..20 {
            let time_s = 0.1 * f64::from(frame);
            last = window.update(time_s, 3.0 + 2.5 * time_s, 0.3);
            assert_eq!(last.is_some(), frame >= 5, "frame {frame}");
        }
        let Acceleration { closing_mps2, sigma_mps2 } = last.unwrap_or_else(|| panic!("told"));
        assert!((closing_mps2 - 2.5).abs() < 1e-9 && (sigma_mps2 - 2f64.sqrt() * 0.3 / 0.6).abs() < 1e-9, "{last:?}");
    }

    #[test]
    fn after_a_gap_the_window_fills_anew() {
        let mut window = ClosingWindow::default();
        for frame in 0..10 {
            window.update(0.1 * f64::from(frame), 1.0, 0.3);
        }
        assert_eq!(window.update(5.0, 9.0, 0.3), None);
    }
}
