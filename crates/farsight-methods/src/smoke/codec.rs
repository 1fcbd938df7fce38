//! Encode and decode: between a box in the scene and the eight regression channels at one cell of the head map.
//!
//! Written once. Inference runs it on `f64`; the loss runs the same functions on dual numbers and so gets its gradient
//! (see [`super::corner_loss`]). `decode(encode(x)) = x`.

use std::f64::consts::FRAC_PI_2;

use farsight_core::box3d::ray_angle;
use farsight_core::scalar::Scalar;
use farsight_core::{Box3d, Camera, ClassReference, DepthReference, Dimensions, wrapped_angle};

/// Input pixels per cell of the head maps.
pub const STRIDE: usize = 4;

/// Regression channels: depth, offset (2), dimensions (3), direction (2).
pub const CHANNELS: usize = 8;

/// Smallest norm that a direction vector is divided by (spec section 4).
const DIRECTION_EPSILON: f64 = 1e-12;

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
    /// Classes in the order of the heatmap's channels.
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
            depth: (self.depth.virtual_depth_m(object.depth_m(), input_focal_px(camera)) - self.depth.mean_m)
                / self.depth.std_m,
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

    /// The `z` of the location, metres, as [`Box3d::depth_m`] has it; `camera` is that of the feature map.
    pub fn depth_m<D: Scalar>(&self, regression: &Regression<D>, camera: &Camera) -> D {
        (regression.depth * self.depth.std_m + self.depth.mean_m) * self.depth.scale(input_focal_px(camera))
    }

    /// Length, height and width of class number `class`, metres.
    ///
    /// # Panics
    /// When `class` is not a class of this codec.
    pub fn dimensions_lhw<D: Scalar>(&self, regression: &Regression<D>, class: usize) -> [D; 3] {
        let reference = self.classes[class].dimensions_lhw;
        [0, 1, 2].map(|i| regression.log_dimensions_lhw[i].exp() * reference[i])
    }

    /// The bottom centre, metres, of an object `height` metres high whose centre lies in `cell` of the feature map seen
    /// by `camera`.
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

    /// The box that `encoded` stands for, class number `class`, under `camera` (of the feature map). Inverse of
    /// [`Codec::encode`].
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

/// Focal length, pixels, of the network's input whose feature map `camera` sees.
fn input_focal_px(camera: &Camera) -> f64 {
    camera.focal_y() * STRIDE as f64
}
