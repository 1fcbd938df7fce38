//! The numerics that every other crate shares: camera, boxes, labels, heatmaps and their peaks, error bars, NMS, the
//! road plane.
//!
//! Frames of reference are KITTI's. Camera coordinates are metres with x right, y **down**, z forward;
//! pixels are `(u, v)`, u right, v down, with pixel centres at whole numbers. An object stands at the centre of
//! its **bottom** face; `yaw` turns about the y axis and is 0 when the object faces +x.
//!
//! Nothing here reads a file, knows an engine or starts a thread.

pub mod affine;
pub mod box2d;
pub mod box3d;
pub mod camera;
pub mod class;
pub mod depth_fusion;
pub mod detection;
pub mod geometric_baseline;
pub mod heatmap;
pub mod input;
pub mod label;
pub mod lens;
pub mod linear;
pub mod nms;
pub mod overlap;
pub mod peaks;
pub mod pitch;
pub mod pose;
pub mod range_error;
pub mod references;
pub mod road;
pub mod road_rectangle;
pub mod samplers;
pub mod scalar;
pub mod scale;
pub mod score;
pub mod statistics;

pub use affine::Affine2;
pub use box2d::Box2d;
pub use box3d::{Box3d, Dimensions};
pub use camera::Camera;
pub use class::ObjectClass;
pub use depth_fusion::{DepthFusion, MeasuredDepth};
pub use detection::Detection;
pub use label::Label;
pub use lens::Lens;
pub use pitch::Pitch;
pub use pose::Pose;
pub use range_error::RangeError;
pub use references::{ClassReference, DepthReference};
pub use scale::{Region, ScalePrior};
pub use score::ScoreCalibration;

/// The angle equal to `angle_rad` up to whole turns, in `(-pi, pi]`.
pub fn wrapped_angle(angle_rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    if -PI < angle_rad && angle_rad <= PI {
        return angle_rad;
    }
    let turned = angle_rad.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}
