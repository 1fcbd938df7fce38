//! How the camera moves, from what it sees (`farsight-odometry`).

use farsight_core::Box2d;
use farsight_core::road::RoadPlane;
use farsight_odometry::{Odometry, OdometryFrame};
use farsight_track::EgoMotion;

use super::source::VideoFrame;
use crate::view::View;

/// How well a height that somebody measured is known, metres.
const HEIGHT_ERROR_M: f64 = 0.05;

/// Odometry of one video.
pub(super) struct VisualEgo {
    /// Height of a camera that has no calibration with its road, metres.
    height_m: Option<f64>,
    /// For this road, if the calibration tells one.
    odometry: Option<(Option<RoadPlane>, Odometry)>,
}

impl VisualEgo {
    pub(super) fn new(height_m: Option<f64>) -> Self {
        Self { height_m, odometry: None }
    }

    /// The motion up to this frame, in which boxes are as the pinhole of `view` sees them. None where it does not tell,
    /// or nothing is known of the camera's height.
    pub(super) fn motion(
        &mut self,
        frame: &VideoFrame,
        view: &View,
        objects: &[Box2d],
        looks_cut: bool,
    ) -> Option<EgoMotion> {
        let road = view.road();
        if self.odometry.as_ref().is_none_or(|(known, _)| *known != road) {
            let measured = || Some(Odometry::above_road(self.height_m?, HEIGHT_ERROR_M));
            self.odometry = road.map(Odometry::new).or_else(measured).map(|odometry| (road, odometry));
        }
        let (_, odometry) = self.odometry.as_mut()?;
        let image = view.straightened(&frame.image).ok()?;
        let image_size = [image.width(), image.height()].map(|side| side as usize);
        let (time_s, camera) = (frame.time_s, view.camera());
        let rgb = image.as_raw();
        let found = odometry.update(&OdometryFrame { time_s, image_size, rgb, camera, objects, looks_cut })?;
        Some(EgoMotion {
            speed_mps: found.speed_mps,
            speed_sigma_mps: found.speed_sigma_mps,
            yaw_rate: found.yaw_rate,
            yaw_rate_sigma: found.yaw_rate_sigma,
        })
    }
}
