//! The disentangled corner loss of SMOKE (spec 7.2) with its exact gradient.
//!
//! The loss is the decoder seen from the other side, so it *is* the decoder: the same generic functions run on dual
//! numbers that carry the derivatives with respect to the eight raw channels. There is no second, tensor-shaped decoder
//! to keep in step.

use super::codec::{CHANNELS, Regression};
use super::targets::ObjectTarget;
use farsight_core::box3d::{corners, ray_angle};
use farsight_core::scalar::Dual;
use farsight_core::{Camera, Dimensions};

use super::Codec;

/// A value and its derivatives with respect to the raw channels.
pub type Variable = Dual<CHANNELS>;

/// A corner this near, metres in front of the camera, or nearer, has no place in the image to learn.
const NEAR_M: f64 = 1.0;

/// The parts of one object's loss, metres summed over corner coordinates, with their derivatives with respect to each
/// raw channel. The first three are SMOKE's, the last is ours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerLoss {
    /// Predicted yaw, everything else true.
    pub orientation: Variable,
    /// Predicted dimensions, everything else true.
    pub dimensions: Variable,
    /// Predicted location, everything else true.
    pub location: Variable,
    /// Everything predicted, as the image shows it: how far each corner lies across the line of sight, at the object's
    /// true depth. A larger car farther away is no error here, so this judges apparent size, which an image tells more
    /// exactly than size or distance.
    pub image: Variable,
}

impl CornerLoss {
    /// The loss of the object, with its derivatives.
    pub fn sum(&self) -> Variable {
        self.orientation + self.dimensions + self.location + self.image
    }
}

/// Loss of the raw regression channels `raw` at the cell of `target`, under `camera` (of the feature map).
///
/// The yaw is made with the angle of the **true** ray, as in official SMOKE, so that its three parts stay apart.
///
/// # Panics
/// When the target's class is not a class of `codec`.
pub fn corner_loss(codec: &Codec, raw: [f64; CHANNELS], target: &ObjectTarget, camera: &Camera) -> CornerLoss {
    let predicted = Regression::from_raw(Variable::variables(raw));

    let truth = &target.box3d;
    let Dimensions { height, width, length } = truth.dimensions;
    let true_dimensions = [length, height, width].map(Variable::constant);
    let true_location = truth.location.map(Variable::constant);
    let true_yaw = Variable::constant(truth.yaw);

    let yaw = predicted.alpha() + ray_angle(truth.location);
    let dimensions = codec.dimensions_lhw(&predicted, target.class);
    let location = codec.location(&predicted, target.cell, dimensions[1], camera);

    let true_corners = truth.corners();
    let distance = |predicted: [[Variable; 3]; 8]| l1(&predicted, &true_corners);
    CornerLoss {
        orientation: distance(corners(true_dimensions, true_location, yaw)),
        dimensions: distance(corners(dimensions, true_location, true_yaw)),
        location: distance(corners(true_dimensions, location, true_yaw)),
        image: l1_in_image(&corners(dimensions, location, yaw), &true_corners) * truth.depth_m(),
    }
}

/// Sum of absolute differences.
fn l1(predicted: &[[Variable; 3]; 8], truth: &[[f64; 3]; 8]) -> Variable {
    let pairs = predicted.as_flattened().iter().zip(truth.as_flattened());
    pairs.fold(Variable::constant(0.0), |sum, (&p, &t)| sum + absolute(p - t))
}

/// Sum of absolute differences of x / z and y / z, over the corners that lie in front of the camera in both.
fn l1_in_image(predicted: &[[Variable; 3]; 8], truth: &[[f64; 3]; 8]) -> Variable {
    let seen = predicted.iter().zip(truth).filter(|(p, t)| p[2].value > NEAR_M && t[2] > NEAR_M);
    seen.fold(Variable::constant(0.0), |sum, (p, t)| {
        let across = |axis: usize| absolute(p[axis] / p[2] - t[axis] / t[2]);
        sum + across(0) + across(1)
    })
}

/// The absolute value; its derivative at zero is zero, as in libtorch.
fn absolute(value: Variable) -> Variable {
    match value.value.partial_cmp(&0.0) {
        Some(std::cmp::Ordering::Less) => -value,
        Some(std::cmp::Ordering::Equal) => Variable::constant(0.0),
        _ => value,
    }
}
