//! The refiner sees each found object cut out of the image at a fixed size. A small network says again, from the
//! cut-out and its camera alone, where the object is.
//!
//! The refining network is not told what it looks at: it says so itself, and sizes and depth are relative to one
//! reference, so it corrects any detector's boxes of any class.

mod fusion;
mod kinds;
mod scores;

use std::f64::consts::SQRT_2;

pub use fusion::StageFusion;
pub use kinds::{KINDS, NOTHING, kind_of};
pub use scores::{Evidence, FusedScore, FusedScoreExample, FusedScores};

use farsight_core::box3d::ray_angle;
use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_core::{Affine2, Box2d, Box3d, Camera, Dimensions, MeasuredDepth, wrapped_angle};

/// Channels of the cut-out: red, green, blue, the direction of each pixel's ray (x / z and y / z), and the logarithm of
/// the focal length.
pub const INPUT_CHANNELS: usize = 6;

/// Channels of the answer: where the object is, and the logit of each kind of thing that it may be.
pub const OUTPUT_CHANNELS: usize = PLACE_CHANNELS + KINDS;

/// Channels that say where the object is: [`TARGETS`], and the logarithms of how far off depth and sizes may be.
pub const PLACE_CHANNELS: usize = TARGETS + 2;

/// Depth; u and v of the centre; length, height, width; cosine and minus sine of the observation angle.
pub const TARGETS: usize = 8;

/// How much more than the box is cut out, so that its surroundings and the errors of the detector have room.
const MARGIN: f64 = 1.3;

/// A box with a side below this, pixels, shows nothing.
const MIN_SIDE_PX: f64 = 2.0;

/// Length, height and width, metres, that sizes are relative to.
const REFERENCE_LHW: [f64; 3] = [3.88, 1.53, 1.63];

/// How high, metres, the world in a cut-out is at the object's depth, where the depth's channel is 0.
const REFERENCE_WINDOW_M: f64 = 2.5;

/// The focal length, sides of the cut-out, where its channel is 0.
const REFERENCE_FOCAL: f64 = 10.0;

/// A logarithm is this times its channel: so the network's numbers are of order one.
pub const LOG_UNIT: f64 = 0.3;

/// Relative error, mean of the absolute, where the channel for it is 0.
pub const ERROR_UNIT: f64 = 0.05;

/// The channels for errors are cut to plus and minus this.
pub const MAX_ERROR_LOG: f64 = 4.0;

/// The depth at which rays are taken: a camera's fourth column moves them by centimetres there.
const RAY_DEPTH_M: f64 = 100.0;

/// Size and conventions of a cut-out's pixels: the same for training and for use.
pub const fn input_rules(side: usize) -> InputRules {
    InputRules { size: [side; 2], channels: ChannelOrder::Rgb, sampling: Sampling::PixelExact }
}

/// The standard deviation that a channel for errors tells: Laplace's distribution deviates by the root of two times its
/// mean absolute error.
pub(crate) fn told_sigma(error_log: f64) -> f64 {
    SQRT_2 * ERROR_UNIT * error_log.clamp(-MAX_ERROR_LOG, MAX_ERROR_LOG).exp()
}

/// A square cut-out of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crop {
    /// From pixels of the image to pixels of the cut-out.
    pub window: Affine2,
    /// The camera that takes the cut-out.
    pub camera: Camera,
    /// Pixels a side.
    pub side: usize,
}

impl Crop {
    /// The cut-out of `side` pixels around `box2d` in an image that `camera` takes; `None` when the box shows nothing.
    pub fn from_box(box2d: &Box2d, camera: &Camera, side: usize) -> Option<Self> {
        let sides = [box2d.width(), box2d.height()];
        if !sides.iter().all(|side| side.is_finite() && *side >= MIN_SIDE_PX) {
            return None;
        }
        let center = [f64::midpoint(box2d.x1, box2d.x2), f64::midpoint(box2d.y1, box2d.y2)];
        let window = Affine2::window(center, MARGIN * sides[0].max(sides[1]), [side, side]);
        Some(Self { window, camera: camera.transformed(&window), side })
    }

    /// The channels of the input that tell about the camera, `[3, side, side]`.
    pub fn rays(&self) -> Vec<f32> {
        let mut planes = vec![0.0; 3 * self.side * self.side];
        self.rays_in(&mut planes);
        planes
    }

    /// Writes [`Crop::rays`] to `planes`, which has as many values.
    pub fn rays_in(&self, planes: &mut [f32]) {
        let side = self.side;
        let area = side * side;
        let (across, rest) = planes.split_at_mut(area);
        let (down, focal) = rest.split_at_mut(area);
        let ray = |column: usize, row: usize| {
            let [x, y, z] = self.camera.point_from_pixel([column, row].map(|place| place as f64), RAY_DEPTH_M);
            [x / z, y / z].map(|tangent| tangent as f32)
        };
        if self.camera.is_upright() {
            // All pixels of a column, or of a row, look as far to the side, or down.
            for (column, tangent) in across.iter_mut().take(side).enumerate() {
                *tangent = ray(column, 0)[0];
            }
            for (row, tangents) in down.chunks_exact_mut(side).enumerate() {
                across.copy_within(..side, row * side);
                tangents.fill(ray(0, row)[1]);
            }
        } else {
            for (cell, (across, down)) in across.iter_mut().zip(down).enumerate() {
                [*across, *down] = ray(cell % side, cell / side);
            }
        }
        focal.fill((self.focal_sides() / REFERENCE_FOCAL).ln() as f32);
    }

    /// How far the corners of this cut-out lie from those of `other` at most, as a share of the side of `other`;
    /// infinite where it has none.
    pub fn distance(&self, other: &Self) -> f64 {
        let Some(back) = self.window.inverse() else { return f64::INFINITY };
        let to_other = back.then(&other.window);
        let side = self.side as f64;
        let moved = |corner: [f64; 2]| {
            let [x, y] = to_other.apply(corner);
            (x - corner[0]).abs().max((y - corner[1]).abs()) / side
        };
        // Windows are upright: two corners tell all.
        moved([-0.5, -0.5]).max(moved([side - 0.5, side - 0.5]))
    }

    /// The mirror image of this cut-out: what its camera would take of a mirrored world. Its window is still that of
    /// the image as it is.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        Self { camera: self.camera.mirrored(self.side), ..*self }
    }

    /// The mean of the answers for this cut-out and for its mirror image.
    pub fn mean_answer(
        &self,
        answer: &[f64; OUTPUT_CHANNELS],
        mirrored: &[f64; OUTPUT_CHANNELS],
    ) -> [f64; OUTPUT_CHANNELS] {
        let mut mirrored = *mirrored;
        // Pixel u lies at side - 1 - u, and the object looks at the camera from the other side.
        mirrored[1] = -mirrored[1] - 1.0 / self.side as f64;
        mirrored[6] = -mirrored[6];
        std::array::from_fn(|channel| f64::midpoint(answer[channel], mirrored[channel]))
    }

    /// The focal length, sides of the cut-out.
    fn focal_sides(&self) -> f64 {
        self.camera.focal_y() / self.side as f64
    }

    /// What the network should answer for `object`; `None` when its centre is not in front of the camera.
    pub fn encode(&self, object: &Box3d) -> Option<[f64; TARGETS]> {
        let center = self.camera.pixel_from_point(object.center())?;
        let side = self.side as f64;
        let [u, v] = center.map(|at| at / side - 0.5);
        let Dimensions { height, width, length } = object.dimensions;
        let depth = (object.depth_m() / self.focal_sides() / REFERENCE_WINDOW_M).ln() / LOG_UNIT;
        let sizes = [length, height, width];
        let [l, h, w] = [0, 1, 2].map(|i| (sizes[i] / REFERENCE_LHW[i]).ln() / LOG_UNIT);
        let alpha = object.alpha();
        let targets = [depth, u, v, l, h, w, alpha.cos(), -alpha.sin()];
        targets.iter().all(|target| target.is_finite()).then_some(targets)
    }

    /// What an answer of the network says. Inverse of [`Crop::encode`]; `None` when the numbers are no place.
    pub fn decode(&self, answer: &[f64; OUTPUT_CHANNELS]) -> Option<Refinement> {
        let [depth, u, v, l, h, w, cos, minus_sin, depth_error, _, kinds @ ..] = *answer;
        let side = self.side as f64;
        let depth_m = (depth * LOG_UNIT).exp() * REFERENCE_WINDOW_M * self.focal_sides();
        let [length, height, width] = [0, 1, 2].map(|i| ([l, h, w][i] * LOG_UNIT).exp() * REFERENCE_LHW[i]);
        let [x, y, z] = self.camera.point_from_pixel([(u + 0.5) * side, (v + 0.5) * side], depth_m);
        let location = [x, y + height / 2.0, z];
        let alpha = (-minus_sin).atan2(cos);
        let yaw = wrapped_angle(alpha + ray_angle(location));
        let box3d = Box3d { dimensions: Dimensions { height, width, length }, location, yaw };
        let numbers = [length, height, width, x, y, z, yaw];
        let is_place = z > 0.0 && numbers.iter().all(|number| number.is_finite());
        is_place.then_some(Refinement { box3d, depth_sigma: told_sigma(depth_error), kinds })
    }
}

/// What the refiner says of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refinement {
    /// Where it is, camera coordinates, metres.
    pub box3d: Box3d,
    /// Standard deviation of the logarithm of its depth.
    pub depth_sigma: f64,
    /// Logits of what it is, in the order of [`kind_of`].
    pub kinds: [f64; KINDS],
}

impl Refinement {
    /// What it says of the depth.
    pub fn depth(&self) -> MeasuredDepth {
        MeasuredDepth { depth_m: self.box3d.depth_m(), log_sigma: self.depth_sigma }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// With a fourth column, as KITTI's.
    pub(super) fn camera() -> Camera {
        let projection =
            [[721.5377, 0.0, 609.5593, 44.857], [0.0, 721.5377, 172.854, 0.2164], [0.0, 0.0, 1.0, 0.002_745_9]];
        Camera::from_projection(projection).expect("a camera")
    }

    pub(super) fn car(location: [f64; 3], yaw: f64) -> Box3d {
        Box3d { dimensions: Dimensions { height: 1.5, width: 1.6, length: 3.9 }, location, yaw }
    }

    fn crop(object: &Box3d) -> Crop {
        Crop::from_box(&object.projected(&camera()).expect("in front"), &camera(), 96).expect("a box")
    }

    proptest! {
        #[test]
        fn an_encoded_box_is_decoded(x in -20.0..20.0, y in 0.5..2.5, z in 3.0..80.0, yaw in -3.1..3.1, error in -3.0..3.0, kind in -9.0..9.0) {
            let object = car([x, y, z], yaw);
            let crop = crop(&object);
            let targets = crop.encode(&object).expect("in front");
            let mut answer = [0.0; OUTPUT_CHANNELS];
            answer[..TARGETS].copy_from_slice(&targets);
            answer[TARGETS] = error;
            answer[PLACE_CHANNELS..].fill(kind);
            let found = crop.decode(&answer).expect("a place");
            for (a, b) in found.box3d.location.into_iter().zip(object.location) {
                prop_assert!((a - b).abs() < 1e-6, "{:?}", found);
            }
            prop_assert!(wrapped_angle(found.box3d.yaw - yaw).abs() < 1e-9);
            prop_assert!((found.box3d.dimensions.length - 3.9).abs() < 1e-9);
            prop_assert!((found.depth_sigma - SQRT_2 * ERROR_UNIT * error.exp()).abs() < 1e-12);
            prop_assert!(found.kinds.iter().all(|found| (found - kind).abs() < 1e-12));
        }

        #[test]
        fn a_mirror_image_is_answered_alike(x in -20.0..20.0, y in 0.5..2.5, z in 3.0..80.0, yaw in -3.1..3.1) {
            let object = car([x, y, z], yaw);
            let crop = crop(&object);
            let answer = |targets: [f64; TARGETS]| {
                let mut answer = [0.5; OUTPUT_CHANNELS];
                answer[..TARGETS].copy_from_slice(&targets);
                answer
            };
            let plain = answer(crop.encode(&object).expect("in front"));
            let mirrored = answer(crop.mirrored().encode(&object.mirrored()).expect("in front"));
            for (mean, one) in crop.mean_answer(&plain, &mirrored).into_iter().zip(plain) {
                prop_assert!((mean - one).abs() < 1e-9, "{} is not {}", mean, one);
            }
        }

        #[test]
        fn a_box_lies_amid_its_crop_with_a_margin(x in -20.0..20.0, z in 5.0..80.0, yaw in -3.1..3.1) {
            let object = car([x, 1.6, z], yaw);
            let crop = crop(&object);
            let seen = object.projected(&crop.camera).expect("in front");
            let side = crop.side as f64;
            prop_assert!((seen.x1 + seen.x2 - side).abs() < 1e-6 && (seen.y1 + seen.y2 - side).abs() < 1e-6);
            prop_assert!((seen.width().max(seen.height()) - side / MARGIN).abs() < 1e-6);
        }

        #[test]
        fn rays_point_where_the_pixels_look(x in -10.0..10.0, z in 8.0..60.0, roll in prop_oneof![Just(0.0), -0.2..0.2]) {
            let crop = crop(&car([x, 1.6, z], 0.3));
            let (sin, cos) = f64::sin_cos(roll);
            let rolled = crop.camera.transformed(&Affine2 { matrix: [[cos, -sin, 5.0], [sin, cos, -9.0]] });
            let crop = Crop { camera: rolled, ..crop };
            prop_assert_eq!(crop.camera.is_upright(), roll == 0.0);
            let planes = crop.rays();
            let area = crop.side * crop.side;
            for cell in [0, 95, 40 * 96 + 17, area - 1] {
                let [px, py, pz] = crop.camera.point_from_pixel([cell % 96, cell / 96].map(|at| at as f64), RAY_DEPTH_M);
                let seen = [planes[cell], planes[area + cell]].map(f32::to_bits);
                prop_assert_eq!(seen, [px / pz, py / pz].map(|tangent| (tangent as f32).to_bits()));
                // The fourth column moves the camera by six centimetres: a few thousandths of a ray here.
                let [px, py, pz] = crop.camera.point_from_pixel([cell % 96, cell / 96].map(|at| at as f64), 40.0);
                prop_assert!((f64::from(planes[cell]) - px / pz).abs() < 2e-3);
                prop_assert!((f64::from(planes[area + cell]) - py / pz).abs() < 2e-3);
            }
        }
    }

    #[test]
    fn what_is_no_box_is_not_cut_out_and_what_is_no_number_is_no_place() {
        let narrow = Box2d::new(10.0, 10.0, 11.0, 50.0);
        assert_eq!(Crop::from_box(&narrow, &camera(), 96), None);
        assert_eq!(Crop::from_box(&Box2d::new(f64::NAN, 0.0, 20.0, 20.0), &camera(), 96), None);
        let crop = crop(&car([0.0, 1.6, 20.0], 0.0));
        let mut answer = [0.0; OUTPUT_CHANNELS];
        assert!(crop.decode(&answer).is_some());
        answer[0] = f64::NAN;
        assert_eq!(crop.decode(&answer), None);
        answer[0] = 1e6;
        assert_eq!(crop.decode(&answer), None);
    }
}
