//! Encode and decode: between a box in the scene and the eight regression channels at one cell of the head map.
//!
//! Written once. Inference runs it on `f64`; the loss runs the same functions on dual numbers and so gets its gradient
//! (see [`crate::corner_loss`]). `decode(encode(x)) = x`.

use std::f64::consts::FRAC_PI_2;

use serde::{Deserialize, Serialize};

use crate::box3d::ray_angle;
use crate::range_error::RangeError;
use crate::scalar::Scalar;
use crate::score::ScoreCalibration;
use crate::{Box3d, Camera, Dimensions, ObjectClass, wrapped_angle};

/// Input pixels per cell of the head maps.
pub const STRIDE: usize = 4;

/// Regression channels: depth, offset (2), dimensions (3), direction (2).
pub const CHANNELS: usize = 8;

/// Smallest norm that a direction vector is divided by (spec section 4).
const DIRECTION_EPSILON: f64 = 1e-12;

/// Mean and standard deviation of the depth of objects; centres the depth channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthReference {
    /// Mean depth, metres.
    pub mean_m: f64,
    /// Standard deviation of the depth, metres.
    pub std_m: f64,
    /// Virtual depth: the focal length, pixels of the network's input, under which the network's depth is the true depth. Under another focal length
    /// the same picture means a distance larger or smaller by the ratio of the two. Without it the network's depth is taken as it is, as in SMOKE.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<f64>,
    /// How far off the model's depths are, where that was fitted: gives detections their error bars.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<RangeError>,
}

impl DepthReference {
    /// Depth of KITTI's objects (SMOKE, spec 5.1).
    pub const KITTI: Self = Self { mean_m: 28.01, std_m: 16.32, focal_px: None, error: None };

    /// The depth that the network sees where `camera` (of the feature map) sees `depth_m`.
    pub fn virtual_depth_m(&self, depth_m: f64, camera: &Camera) -> f64 {
        depth_m / self.scale(camera)
    }

    /// Standard deviation, metres, of a depth that `camera` (of the feature map) sees with this score (0 to 1, both excluded) in a box that the image's border cuts or not,
    /// where that was fitted.
    pub fn sigma_m(&self, depth_m: f64, score: f64, is_cut: bool, camera: &Camera) -> Option<f64> {
        let sigma_m = self.error?.sigma_m(self.virtual_depth_m(depth_m, camera), score, is_cut) * self.scale(camera);
        sigma_m.is_finite().then_some(sigma_m)
    }

    /// True depth over virtual depth under `camera` (of the feature map).
    fn scale(&self, camera: &Camera) -> f64 {
        self.focal_px.map_or(1.0, |focal_px| camera.focal_y() * STRIDE as f64 / focal_px)
    }
}

/// What the codec must know of a class.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClassReference {
    /// The class.
    pub class: ObjectClass,
    /// Reference length, height and width, metres; the dimension channels are relative to it.
    pub dimensions_lhw: [f64; 3],
    /// Factor on the dynamic heat map's alpha for this class.
    #[serde(default = "one")]
    pub heat_map_factor: f64,
    /// Makes probabilities of the peaks; without it the peak is the score, as in SMOKE.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub score: Option<ScoreCalibration>,
}

fn one() -> f64 {
    1.0
}

impl ClassReference {
    /// SMOKE's three classes with its reference sizes, in the official order of channels: car, cyclist, pedestrian (spec 5.1).
    ///
    /// The car's height and width look exchanged; both public code bases carry it and it only shifts a learnt offset.
    pub fn smoke() -> Vec<Self> {
        let reference = |class, dimensions_lhw| Self { class, dimensions_lhw, heat_map_factor: 1.0, score: None };
        vec![
            reference(ObjectClass::Car, [3.88, 1.63, 1.53]),
            reference(ObjectClass::Cyclist, [1.78, 1.70, 0.58]),
            reference(ObjectClass::Pedestrian, [0.88, 1.73, 0.67]),
        ]
    }
}

/// The regression values of one cell after their activations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Regression<D> {
    /// Depth less the reference mean, in reference standard deviations.
    pub depth: D,
    /// Position of the projected centre within its cell, cells.
    pub offset: [D; 2],
    /// Logarithm of length, height, width over the reference.
    pub log_dimensions_lhw: [D; 3],
    /// Unit vector `(cos alpha, -sin alpha)`.
    pub direction: [D; 2],
}

impl<D: Scalar> Regression<D> {
    /// Applies the activations to the raw channels, in the order of spec section 4.
    pub fn from_raw(raw: [D; CHANNELS]) -> Self {
        // sigmoid(x) - 1/2, written so that no exponential overflows.
        let bounded = |x: D| {
            let decay = (if x.value() < 0.0 { x } else { -x }).exp();
            let half = (-decay + 1.0) / (decay + 1.0) * 0.5;
            if x.value() < 0.0 { -half } else { half }
        };
        let norm = (raw[6] * raw[6] + raw[7] * raw[7]).sqrt();
        let unit = |x: D| if norm.value() > DIRECTION_EPSILON { x / norm } else { x * (1.0 / DIRECTION_EPSILON) };
        Self {
            depth: raw[0],
            offset: [raw[1], raw[2]],
            log_dimensions_lhw: [bounded(raw[3]), bounded(raw[4]), bounded(raw[5])],
            direction: [unit(raw[6]), unit(raw[7])],
        }
    }

    /// From activated values in channel order.
    pub fn from_activated(values: [D; CHANNELS]) -> Self {
        let [depth, dx, dy, l, h, w, s, c] = values;
        Self { depth, offset: [dx, dy], log_dimensions_lhw: [l, h, w], direction: [s, c] }
    }

    /// Observation angle, radians, up to whole turns.
    pub fn alpha(&self) -> D {
        self.direction[0].atan2(self.direction[1]) - FRAC_PI_2
    }
}

/// A box as the head maps hold it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoded {
    /// Column and row of the cell that holds the projected centre.
    pub cell: [usize; 2],
    /// Its regression values, after activation.
    pub regression: Regression<f64>,
}

/// Reference constants of a model and the two directions of the code.
#[derive(Debug, Clone, PartialEq)]
pub struct Codec {
    /// Classes in the order of the heat map's channels.
    pub classes: Vec<ClassReference>,
    /// Centres the depth.
    pub depth: DepthReference,
}

impl Codec {
    /// The regression values of `object`, class number `class`, under `camera` (of the feature map, not of the image).
    ///
    /// `None` when the object's centre does not project to a cell with non-negative column and row.
    pub fn encode(&self, object: &Box3d, class: usize, camera: &Camera) -> Option<Encoded> {
        let pixel = camera.pixel_from_point(object.center())?;
        if pixel[0] < 0.0 || pixel[1] < 0.0 {
            return None;
        }
        let Dimensions { height, width, length } = object.dimensions;
        let reference = self.classes.get(class)?.dimensions_lhw;
        let alpha = object.alpha();
        let regression = Regression {
            depth: (self.depth.virtual_depth_m(object.depth_m(), camera) - self.depth.mean_m) / self.depth.std_m,
            offset: pixel.map(f64::fract),
            log_dimensions_lhw: [
                (length / reference[0]).ln(),
                (height / reference[1]).ln(),
                (width / reference[2]).ln(),
            ],
            direction: [alpha.cos(), -alpha.sin()],
        };
        Some(Encoded { cell: pixel.map(|v| v as usize), regression })
    }

    /// The `z` of the location, metres, as [`crate::Box3d::depth_m`] has it; `camera` is that of the feature map.
    pub fn depth_m<D: Scalar>(&self, regression: &Regression<D>, camera: &Camera) -> D {
        (regression.depth * self.depth.std_m + self.depth.mean_m) * self.depth.scale(camera)
    }

    /// Length, height and width of class number `class`, metres.
    ///
    /// # Panics
    /// When `class` is not a class of this codec.
    pub fn dimensions_lhw<D: Scalar>(&self, regression: &Regression<D>, class: usize) -> [D; 3] {
        let reference = self.classes[class].dimensions_lhw;
        [0, 1, 2].map(|i| regression.log_dimensions_lhw[i].exp() * reference[i])
    }

    /// The bottom centre, metres, of an object `height` metres high whose centre lies in `cell` of the feature map seen by `camera`.
    pub fn location<D: Scalar>(
        &self,
        regression: &Regression<D>,
        cell: [usize; 2],
        height: D,
        camera: &Camera,
    ) -> [D; 3] {
        let pixel = [0, 1].map(|i| regression.offset[i] + cell[i] as f64);
        let [x, y, z] = camera.point_from_pixel(pixel, self.depth_m(regression, camera));
        [x, y + height * 0.5, z]
    }

    /// The box that `encoded` stands for, class number `class`, under `camera` (of the feature map). Inverse of [`Codec::encode`].
    ///
    /// # Panics
    /// When `class` is not a class of this codec.
    pub fn decode(&self, encoded: &Encoded, class: usize, camera: &Camera) -> Box3d {
        let regression = &encoded.regression;
        let [length, height, width] = self.dimensions_lhw(regression, class);
        let location = self.location(regression, encoded.cell, height, camera);
        let yaw = wrapped_angle(regression.alpha() + ray_angle(location));
        Box3d { dimensions: Dimensions { height, width, length }, location, yaw }
    }
}
