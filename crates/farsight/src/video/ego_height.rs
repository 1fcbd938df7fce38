//! How high a driving camera is above the road, from its speed (`farsight-odometry`).

use farsight_methods::DetectError;
use farsight_odometry::{HeightEstimator, OdometryFrame};

use super::ego::EgoFile;
use super::error::VideoError;
use super::frame_detector::size;
use super::scene_cut::SceneCut;
use super::source::{VideoFrame, VideoOptions, VideoSource};
use crate::view::View;

/// More frames than this tell hardly more: roads are no planes.
const ENOUGH_FRAMES: usize = 100;

/// So much of a film is looked at, seconds.
const LONGEST_S: f64 = 60.0;

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

    /// Looks at the frames of a film until they tell, for a minute at most. `view` says how each was taken; those of
    /// which nobody knows, or that cannot be read, are left out.
    ///
    /// # Errors
    /// When ffmpeg cannot be started.
    pub fn of_film(
        ego: EgoFile,
        source: &VideoSource,
        options: &VideoOptions,
        mut view: impl FnMut(&VideoFrame) -> Option<View>,
    ) -> Result<Self, VideoError> {
        let mut height = Self::new(ego);
        for frame in source.clone().frames(options)?.flatten() {
            if frame.time_s > LONGEST_S || height.frames() >= ENOUGH_FRAMES {
                break;
            }
            // A frame of another size is left out, too.
            view(&frame).and_then(|view| height.add(&frame, &view).ok());
        }
        Ok(height)
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
