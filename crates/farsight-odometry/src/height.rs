//! How high a camera is above the road, from how fast it drives.

use farsight_core::statistics::{quantile, sorted};

use crate::odometry::{Odometry, OdometryFrame, ROAD_SHARE};

/// The height that is taken first, metres: another one makes all speeds larger or smaller by the same factor.
const TAKEN_M: f64 = 1.5;

/// Slower pictures hardly differ, m/s.
const LEAST_MPS: f64 = 3.0;

/// Fewer pictures than this tell nothing.
const LEAST_PICTURES: usize = 10;

/// Neighbouring pictures show the same road: so many of them are one witness.
const ALIKE: f64 = 5.0;

/// Of a normal distribution: the standard deviation against the median of the distances from the median, and that of
/// a median against that of a mean.
const SIGMA_OF_MEDIAN_DISTANCE: f64 = 1.4826;
const SIGMA_OF_MEDIAN: f64 = 1.2533;

/// Tells how high a camera is that drives at speeds which are known. It keeps one picture.
///
/// Pictures alone tell the speed in heights of the camera: twice as high and twice as fast looks the same.
pub struct HeightEstimator {
    odometry: Odometry,
    /// Speed at the last picture, m/s.
    before_mps: Option<f64>,
    /// What each pair of pictures says, metres.
    heights_m: Vec<f64>,
}

impl Default for HeightEstimator {
    fn default() -> Self {
        Self { odometry: Odometry::above_road(TAKEN_M, 0.0), before_mps: None, heights_m: Vec::new() }
    }
}

impl HeightEstimator {
    /// Looks at the next picture, at which the camera drives ahead so fast, m/s.
    pub fn add(&mut self, frame: &OdometryFrame, speed_mps: Option<f64>) {
        let motion = self.odometry.update(frame);
        let before_mps = std::mem::replace(&mut self.before_mps, speed_mps);
        let speeds = before_mps.zip(speed_mps).map(|(before, now)| f64::midpoint(before, now));
        if let Some((motion, mean_mps)) = motion.zip(speeds.filter(|mean| *mean > LEAST_MPS)) {
            let height_m = TAKEN_M * mean_mps / motion.speed_mps;
            self.heights_m.extend((height_m.is_finite() && height_m > 0.0).then_some(height_m));
        }
    }

    /// How many pictures tell it so far.
    pub fn pictures(&self) -> usize {
        self.heights_m.len()
    }

    /// Height above the road and its standard deviation, metres; none while too few pictures tell it.
    pub fn height_m(&self) -> Option<[f64; 2]> {
        if self.heights_m.len() < LEAST_PICTURES {
            return None;
        }
        let height_m = median(self.heights_m.iter().copied());
        let off = median(self.heights_m.iter().map(|one| (one - height_m).abs()));
        let witnesses = (self.heights_m.len() as f64 / ALIKE).max(1.0);
        let spread = SIGMA_OF_MEDIAN * SIGMA_OF_MEDIAN_DISTANCE * off / witnesses.sqrt();
        Some([height_m, spread.hypot(ROAD_SHARE * height_m)])
    }
}

fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    quantile(&sorted(values), 0.5)
}
