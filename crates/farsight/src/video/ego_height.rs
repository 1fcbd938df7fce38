//! How high a driving camera is above the road, from its speed (`farsight-odometry`).

use farsight_methods::DetectError;
use farsight_odometry::{HeightEstimator, OdometryFrame};

use super::ego::EgoFile;
use super::frame_detector::size;
use super::scene_cut::SceneCut;
use super::source::VideoFrame;
use crate::view::View;

/// Tells how high the camera of a film is whose speed is known. The film must show the road, and all its frames, as
/// neighbours are compared.
pub struct EgoHeight {
    ego: EgoFile,
    estimator: HeightEstimator,
    scene_cut: SceneCut,
}

impl EgoHeight {
    /// Of a camera that moves so.
    pub fn new(ego: EgoFile) -> Self {
        Self { ego, estimator: HeightEstimator::default(), scene_cut: SceneCut::default() }
    }

    /// Looks at the next frame, which was taken so.
    ///
    /// # Errors
    /// When it has another size than `view` was made for.
    pub fn add(&mut self, frame: &VideoFrame, view: &View) -> Result<(), DetectError> {
        let image = view.straightened(&frame.image)?;
        let speed_mps = self.ego.motion(frame.number, frame.time_s).map(|motion| motion.speed_mps);
        let seen = OdometryFrame {
            time_s: frame.time_s,
            image_size: size(&image),
            rgb: image.as_raw(),
            camera: view.camera(),
            objects: &[],
            looks_cut: self.scene_cut.looks_cut(&image),
        };
        self.estimator.add(&seen, speed_mps);
        Ok(())
    }

    /// How many frames tell it so far: those that show a road with texture, from above 3 m/s.
    pub fn frames(&self) -> usize {
        self.estimator.pictures()
    }

    /// Height above the road and its standard deviation, metres; none while too few frames tell it.
    pub fn height_m(&self) -> Option<[f64; 2]> {
        self.estimator.height_m()
    }
}
