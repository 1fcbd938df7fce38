//! The second look: each found object is cut out of the image at a fixed size, and a small network says again, from the cut-out and its camera alone, where
//! the object is.
//!
//! The refining network does not know what it looks at: sizes and depth are relative to one reference, so it corrects any detector's boxes of any class.

use std::f64::consts::SQRT_2;

use serde::{Deserialize, Serialize};

use crate::box3d::ray_angle;
use crate::overlap::iou_2d;
use crate::range_error::WITHIN_ONE_SIGMA;
use crate::score::LEAST_EXAMPLES;
use crate::statistics::quantile;
use crate::{Affine2, Box2d, Box3d, Camera, Detection, Dimensions, wrapped_angle};

/// Channels of the cut-out: red, green, blue, the direction of each pixel's ray (x / z and y / z), and the logarithm of the focal length.
pub const INPUT_CHANNELS: usize = 6;

/// Channels of the answer: [`TARGETS`], and the logarithms of how far off depth and sizes may be.
pub const OUTPUT_CHANNELS: usize = TARGETS + 2;

/// Depth; u and v of the centre; length, height, width; cosine and minus sine of the observation angle.
pub const TARGETS: usize = 8;

/// How much more than the box is cut out, so that its surroundings and the errors of the first look have room.
const MARGIN: f64 = 1.3;

/// A box with a side below this, pixels, shows nothing.
const LEAST_SIDE_PX: f64 = 2.0;

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
pub const LARGEST_ERROR_LOG: f64 = 4.0;

/// Boxes in the image that overlap less are of two different things.
const LEAST_OVERLAP: f64 = 0.3;

/// The depth at which rays are taken: a camera's fourth column moves them by centimetres there.
const RAY_DEPTH_M: f64 = 100.0;

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
    pub fn around(box2d: &Box2d, camera: &Camera, side: usize) -> Option<Self> {
        let sides = [box2d.width(), box2d.height()];
        if !sides.iter().all(|side| side.is_finite() && *side >= LEAST_SIDE_PX) {
            return None;
        }
        let center = [f64::midpoint(box2d.x1, box2d.x2), f64::midpoint(box2d.y1, box2d.y2)];
        let window = Affine2::window(center, MARGIN * sides[0].max(sides[1]), [side, side]);
        Some(Self { window, camera: camera.transformed(&window), side })
    }

    /// The channels of the input that tell about the camera, `[3, side, side]`.
    pub fn rays(&self) -> Vec<f32> {
        let area = self.side * self.side;
        let mut planes = vec![0.0; 3 * area];
        let focal = (self.focal_sides() / REFERENCE_FOCAL).ln() as f32;
        for cell in 0..area {
            let pixel = [cell % self.side, cell / self.side].map(|place| place as f64);
            let [x, y, z] = self.camera.point_from_pixel(pixel, RAY_DEPTH_M);
            planes[cell] = (x / z) as f32;
            planes[area + cell] = (y / z) as f32;
            planes[2 * area + cell] = focal;
        }
        planes
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
        let [depth, u, v, l, h, w, cos, minus_sin, depth_error, _] = *answer;
        let side = self.side as f64;
        let depth_m = (depth * LOG_UNIT).exp() * REFERENCE_WINDOW_M * self.focal_sides();
        let [length, height, width] = [0, 1, 2].map(|i| ([l, h, w][i] * LOG_UNIT).exp() * REFERENCE_LHW[i]);
        let [x, y, z] = self.camera.point_from_pixel([(u + 0.5) * side, (v + 0.5) * side], depth_m);
        let location = [x, y + height / 2.0, z];
        let alpha = (-minus_sin).atan2(cos);
        let yaw = wrapped_angle(alpha + ray_angle(location));
        let error = ERROR_UNIT * depth_error.clamp(-LARGEST_ERROR_LOG, LARGEST_ERROR_LOG).exp();
        let box3d = Box3d { dimensions: Dimensions { height, width, length }, location, yaw };
        let numbers = [length, height, width, x, y, z, yaw];
        let is_place = z > 0.0 && numbers.iter().all(|number| number.is_finite());
        // Laplace's distribution deviates by the root of two times its mean absolute error.
        is_place.then_some(Refinement { box3d, depth_sigma: SQRT_2 * error })
    }
}

/// What the second look says of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refinement {
    /// Where it is, camera coordinates, metres.
    pub box3d: Box3d,
    /// Standard deviation of the logarithm of its depth.
    pub depth_sigma: f64,
}

/// How the two looks go together, fitted on labelled frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TwoLooks {
    /// Factor on the second look's depths.
    pub depth_factor: f64,
    /// Factor on the error bars of the second look.
    pub error_factor: f64,
    /// Correlation of the two looks' errors: neither knows how large a car is, so they err alike.
    pub correlation: f64,
    /// Factor on the error bars of both together.
    pub joint_error_factor: f64,
}

impl Default for TwoLooks {
    /// Unfitted.
    fn default() -> Self {
        Self { depth_factor: 1.0, error_factor: 1.0, correlation: 0.5, joint_error_factor: 1.0 }
    }
}

/// An object that both looks saw and of which the depth is known, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LooksExample {
    /// What is right.
    pub true_m: f64,
    /// The first look's depth and its error bar.
    pub first: [f64; 2],
    /// The second look's depth, and the standard deviation of its logarithm.
    pub second: [f64; 2],
}

impl TwoLooks {
    /// What makes `examples` right in the median and the error bars hold two thirds of them; none when they are fewer than [`LEAST_EXAMPLES`].
    pub fn fit(examples: &[LooksExample]) -> Option<Self> {
        if examples.len() < LEAST_EXAMPLES {
            return None;
        }
        let off = |example: &LooksExample, found_m: f64| (found_m / example.true_m).ln();
        let depth_factor = (-median(examples.iter().map(|example| off(example, example.second[0])))).exp();
        let second = |example: &LooksExample| off(example, example.second[0] * depth_factor) / example.second[1];
        let error_factor = one_sigma(examples.iter().map(second));
        let first = |example: &LooksExample| off(example, example.first[0]) / (example.first[1] / example.first[0]);
        let pairs: Vec<[f64; 2]> = examples
            .iter()
            .map(|example| [first(example), second(example) / error_factor].map(|off| off.clamp(-3.0, 3.0)))
            .collect();
        let product = |a: usize, b: usize| pairs.iter().map(|pair| pair[a] * pair[b]).sum::<f64>();
        let correlation = product(0, 1) / (product(0, 0) * product(1, 1)).sqrt();
        let unfinished = Self { depth_factor, error_factor, correlation, joint_error_factor: 1.0 };
        let joint = |example: &LooksExample| {
            let [first_m, first_sigma_m] = example.first;
            let [second_m, second_sigma] = example.second;
            let first = Some((first_m.ln(), first_sigma_m / first_m));
            let second = ((second_m * depth_factor).ln(), second_sigma * error_factor);
            let (log, sigma) = unfinished.agreed(first, second);
            off(example, log.exp()) / sigma
        };
        let fitted = Self { joint_error_factor: one_sigma(examples.iter().map(joint)), ..unfinished };
        fitted.is_usable().then_some(fitted)
    }

    /// Whether these are numbers that a fit could have given: files from strangers may hold others.
    pub fn is_usable(&self) -> bool {
        let factors = [self.depth_factor, self.error_factor, self.joint_error_factor];
        factors.iter().all(|factor| (0.01..100.0).contains(factor)) && (-0.99..=0.99).contains(&self.correlation)
    }

    /// `first`, found in an image of this size (width, height) that `camera` takes, with what the second look says of it.
    ///
    /// Direction, heading and proportions are the second look's; its box is moved along its rays, growing with the distance, to the depth on which
    /// both agree best. A first look without error bar has no say in that. Where the second look sees something else than the first, or
    /// something that is not in the image, `first` stays.
    pub fn joined(&self, first: &Detection, second: &Refinement, camera: &Camera, image_size: [usize; 2]) -> Detection {
        let second = Refinement {
            box3d: scaled(&second.box3d, self.depth_factor),
            depth_sigma: second.depth_sigma * self.error_factor,
        };
        let depth_m = first.box3d.depth_m();
        let first_look = first.range_sigma_m.map(|sigma_m| (depth_m.ln(), sigma_m / depth_m));
        let (log, sigma) = self.agreed(first_look, (second.box3d.depth_m().ln(), second.depth_sigma));
        let box3d = scaled(&second.box3d, log.exp() / second.box3d.depth_m());
        let [width, height] = image_size.map(|side| side as f64);
        let box2d = box3d.projected(camera).map(|box2d| box2d.clamped(width, height));
        let Some(box2d) = box2d.filter(|box2d| iou_2d(box2d, &first.box2d) >= LEAST_OVERLAP) else {
            return first.clone();
        };
        let range_sigma_m = Some(sigma * self.joint_error_factor * box3d.depth_m());
        Detection { box2d, box3d, range_sigma_m, ..first.clone() }
    }

    /// Mean and deviation of two measurements, of which the first may be missing, whose errors are correlated: the best linear combination.
    fn agreed(&self, first: Option<(f64, f64)>, second: (f64, f64)) -> (f64, f64) {
        let Some(first) = first else { return second };
        let (a, b) = (first.1, second.1);
        let shared = self.correlation * a * b;
        let spread = a * a + b * b - 2.0 * shared;
        let weight = if spread > 0.0 { ((a * a - shared) / spread).clamp(0.0, 1.0) } else { 0.5 };
        let rest = 1.0 - weight;
        let variance = weight * weight * b * b + rest * rest * a * a + 2.0 * weight * rest * shared;
        (rest * first.0 + weight * second.0, variance.sqrt())
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    quantile(&sorted(values), 0.5)
}

/// What as many of the values lie within, either way, as of a normal distribution within one standard deviation.
fn one_sigma(values: impl Iterator<Item = f64>) -> f64 {
    quantile(&sorted(values.map(f64::abs)), WITHIN_ONE_SIGMA)
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The box `factor` times as far away and as large: the same picture.
fn scaled(box3d: &Box3d, factor: f64) -> Box3d {
    let Dimensions { height, width, length } = box3d.dimensions;
    let dimensions = Dimensions { height: height * factor, width: width * factor, length: length * factor };
    Box3d { dimensions, location: box3d.location.map(|v| v * factor), yaw: box3d.yaw }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::ObjectClass;

    /// With a fourth column, as KITTI's.
    fn camera() -> Camera {
        let projection =
            [[721.5377, 0.0, 609.5593, 44.857], [0.0, 721.5377, 172.854, 0.2164], [0.0, 0.0, 1.0, 0.002_745_9]];
        Camera::from_projection(projection).expect("a camera")
    }

    const IMAGE: [usize; 2] = [1242, 375];

    fn car(location: [f64; 3], yaw: f64) -> Box3d {
        Box3d { dimensions: Dimensions { height: 1.5, width: 1.6, length: 3.9 }, location, yaw }
    }

    fn crop(object: &Box3d) -> Crop {
        Crop::around(&object.projected(&camera()).expect("in front"), &camera(), 96).expect("a box")
    }

    /// Three independent numbers of mean 0 and deviation 1 for each `k`: an even spread over a unit cube, made normal (Box and Muller).
    fn normals(k: u32) -> [f64; 3] {
        let share = |power: i32| (0.5 + f64::from(k) * 0.856_674_883_854_502_9_f64.powi(power)).fract();
        let pair = |a: f64, b: f64| {
            let (radius, angle) = ((-2.0 * (1.0 - a).ln()).sqrt(), std::f64::consts::TAU * b);
            [radius * angle.cos(), radius * angle.sin()]
        };
        let ([first, second], [third, _]) = (pair(share(1), share(2)), pair(share(3), share(4)));
        [first, second, third]
    }

    fn detection(box3d: Box3d, range_sigma_m: Option<f64>) -> Detection {
        let box2d = box3d.projected(&camera()).expect("in front").clamped(1242.0, 375.0);
        Detection { class: ObjectClass::Car, score: 0.7, box2d, box3d, range_sigma_m }
    }

    proptest! {
        #[test]
        fn an_encoded_box_is_decoded(x in -20.0..20.0, y in 0.5..2.5, z in 3.0..80.0, yaw in -3.1..3.1, error in -3.0..3.0) {
            let object = car([x, y, z], yaw);
            let crop = crop(&object);
            let targets = crop.encode(&object).expect("in front");
            let mut answer = [0.0; OUTPUT_CHANNELS];
            answer[..TARGETS].copy_from_slice(&targets);
            answer[TARGETS] = error;
            let found = crop.decode(&answer).expect("a place");
            for (a, b) in found.box3d.location.into_iter().zip(object.location) {
                prop_assert!((a - b).abs() < 1e-6, "{:?}", found);
            }
            prop_assert!(wrapped_angle(found.box3d.yaw - yaw).abs() < 1e-9);
            prop_assert!((found.box3d.dimensions.length - 3.9).abs() < 1e-9);
            prop_assert!((found.depth_sigma - SQRT_2 * ERROR_UNIT * error.exp()).abs() < 1e-12);
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
        fn rays_point_where_the_pixels_look(x in -10.0..10.0, z in 8.0..60.0) {
            let crop = crop(&car([x, 1.6, z], 0.3));
            let planes = crop.rays();
            let area = crop.side * crop.side;
            for cell in [0, 95, 40 * 96 + 17, area - 1] {
                let pixel = [(cell % 96) as f64, (cell / 96) as f64];
                let [px, py, pz] = crop.camera.point_from_pixel(pixel, 40.0);
                // The fourth column moves the camera by six centimetres: a few thousandths of a ray here.
                prop_assert!((f64::from(planes[cell]) - px / pz).abs() < 2e-3);
                prop_assert!((f64::from(planes[area + cell]) - py / pz).abs() < 2e-3);
            }
        }

        #[test]
        fn two_looks_meet_between_them_and_the_surer_one_counts_more(
            first_m in 10.0..40.0_f64, share in 0.9..1.1_f64, a in 0.01..0.2_f64, b in 0.01..0.2_f64, correlation in -0.5..0.9_f64,
        ) {
            let looks = TwoLooks { correlation, ..TwoLooks::default() };
            let second_m = first_m * share;
            let (log, sigma) = looks.agreed(Some((first_m.ln(), a)), (second_m.ln(), b));
            prop_assert!(log >= first_m.min(second_m).ln() - 1e-9 && log <= first_m.max(second_m).ln() + 1e-9);
            prop_assert!(sigma <= a.min(b) + 1e-12, "{} of {} and {}", sigma, a, b);
            let middle = f64::midpoint(first_m.ln(), second_m.ln());
            let towards_second = (log - middle) * (second_m.ln() - first_m.ln()).signum();
            let as_it_should = towards_second * (a - b) >= -1e-9;
            prop_assert!(as_it_should, "{} of {} and {}", towards_second, a, b);
        }
    }

    #[test]
    fn a_joined_box_looks_like_the_second_at_the_depth_of_both() {
        let first = detection(car([2.0, 1.6, 20.0], 0.4), Some(1.0));
        let second = Refinement { box3d: car([2.2, 1.65, 22.0], 0.5), depth_sigma: 0.05 };
        let looks = TwoLooks { correlation: 0.0, ..TwoLooks::default() };
        let joined = looks.joined(&first, &second, &camera(), IMAGE);
        let depth_m = joined.box3d.depth_m();
        assert!((depth_m - (20.0_f64 * 22.0).sqrt()).abs() < 1e-9, "as sure as each other: {depth_m}");
        assert!((joined.box3d.dimensions.height - 1.5 * depth_m / 22.0).abs() < 1e-9);
        assert!((joined.box3d.yaw - 0.5).abs() < 1e-12);
        let sigma_m = joined.range_sigma_m.expect("both have one");
        assert!((sigma_m - 0.05 / SQRT_2 * depth_m).abs() < 1e-9, "{sigma_m}");
        // Without an error bar the first look has no say.
        let unsure = detection(first.box3d, None);
        let alone = looks.joined(&unsure, &second, &camera(), IMAGE);
        assert!((alone.box3d.depth_m() - 22.0).abs() < 1e-9);
    }

    #[test]
    fn a_second_look_at_something_else_changes_nothing() {
        let first = detection(car([2.0, 1.6, 20.0], 0.4), Some(1.0));
        let beside = Refinement { box3d: car([7.0, 1.6, 20.0], 0.4), depth_sigma: 0.01 };
        assert_eq!(TwoLooks::default().joined(&first, &beside, &camera(), IMAGE), first);
        let behind = Refinement { box3d: car([2.0, 1.6, -20.0], 0.4), depth_sigma: 0.01 };
        assert_eq!(TwoLooks::default().joined(&first, &behind, &camera(), IMAGE), first);
    }

    #[test]
    fn what_is_no_box_is_not_cut_out_and_what_is_no_number_is_no_place() {
        let narrow = Box2d::new(10.0, 10.0, 11.0, 50.0);
        assert_eq!(Crop::around(&narrow, &camera(), 96), None);
        assert_eq!(Crop::around(&Box2d::new(f64::NAN, 0.0, 20.0, 20.0), &camera(), 96), None);
        let crop = crop(&car([0.0, 1.6, 20.0], 0.0));
        let mut answer = [0.0; OUTPUT_CHANNELS];
        assert!(crop.decode(&answer).is_some());
        answer[0] = f64::NAN;
        assert_eq!(crop.decode(&answer), None);
        answer[0] = 1e6;
        assert_eq!(crop.decode(&answer), None);
    }

    #[test]
    fn a_fit_finds_factors_and_correlation() {
        let truth = TwoLooks { depth_factor: 1.03, error_factor: 2.0, correlation: 0.6, joint_error_factor: 1.0 };
        let examples: Vec<LooksExample> = (0..4000)
            .map(|k| {
                let true_m = 5.0 + f64::from(k % 60);
                let [common, a, b] = normals(k);
                let mixed = |own: f64| 0.6_f64.sqrt() * common + 0.4_f64.sqrt() * own;
                let first_m = true_m * (0.06 * mixed(a)).exp();
                let second_m = true_m * (0.04 * mixed(b)).exp() / truth.depth_factor;
                LooksExample { true_m, first: [first_m, 0.06 * first_m], second: [second_m, 0.02] }
            })
            .collect();
        let found = TwoLooks::fit(&examples).expect("enough examples");
        assert!((found.depth_factor - truth.depth_factor).abs() < 0.003, "{found:?}");
        assert!((found.error_factor - truth.error_factor).abs() < 0.08, "{found:?}");
        assert!((found.correlation - truth.correlation).abs() < 0.04, "{found:?}");
        assert!((found.joint_error_factor - 1.0).abs() < 0.05, "{found:?}");
        assert_eq!(TwoLooks::fit(&examples[..3]), None);
    }
}
