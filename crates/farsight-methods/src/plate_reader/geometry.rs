//! The number plate as a yardstick.
//!
//! An image does not show how large a car is, and so not how far away; but most cars carry something whose size is
//! known. The end of a vehicle that faces the camera is cut out of the image where an earlier look has it, at so many
//! pixels a metre that a plate is as wide as expected if that look is right, and a small network says how much wider it
//! is.

use crate::refiner::geometry::{LOG_UNIT, told_sigma};
use farsight_core::box3d::NEAR_PLANE_M;
use farsight_core::{Affine2, Box3d, Camera, DepthFusion, Detection, MeasuredDepth, ObjectClass};

/// Channels of the cut-out: red, green, blue.
pub const INPUT_CHANNELS: usize = 3;

/// Channels of the answer: where the middle of the plate is, across and down, sides of the cut-out from its middle; by
/// what factor it is wider than expected, a logarithm in [`LOG_UNIT`]; and how far off that may be, as a refiner says
/// it.
pub const ANSWER_CHANNELS: usize = 4;

/// Width of the plates of the European Union and most of its neighbours, metres.
const PLATE_WIDTH_M: f64 = 0.52;

/// How much of the vehicle's end is cut out, width and height, metres.
const WINDOW_M: [f64; 2] = [1.28, 0.8];

/// How wide a plate is expected to be, sides of the cut-out.
pub const EXPECTED_WIDTH: f64 = PLATE_WIDTH_M / WINDOW_M[0];

/// Height of the middle of the cut-out above the ground, as a share of the vehicle's.
const MIDDLE_HEIGHT: f64 = 0.37;

/// Cosine of the angle between the line of sight and the vehicle's heading below which its end is seen too much from
/// the side.
const MIN_FACING: f64 = 0.35;

/// A plate that is expected to be narrower shows nothing, pixels of the image.
const MIN_WIDTH_PX: f64 = 4.0;

/// Readings that differ from what is known already by more, joint standard deviations, are of another kind of plate, or
/// of something else.
const MAX_OFF: f64 = 2.5;

/// Whether vehicles of this class carry their plates where they are looked for.
pub fn carries_plate(class: &ObjectClass) -> bool {
    matches!(class, ObjectClass::Car | ObjectClass::Van)
}

/// The end of a vehicle cut out of an image, `side` x `side` pixels, 1.28 m x 0.8 m if the vehicle is where it is
/// expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateCrop {
    /// From pixels of the image to pixels of the cut-out.
    pub window: Affine2,
    /// The camera that takes the cut-out.
    camera: Camera,
    side: usize,
    /// The depth at which the vehicle is expected, metres.
    expected_m: f64,
}

impl PlateCrop {
    /// The cut-out, `side` pixels wide and high, of a vehicle that is `expected` in an image of this size (width,
    /// height) that `camera` takes; `None` when neither end faces the camera, or its middle is outside the image or too
    /// far away.
    pub fn of(expected: &Box3d, camera: &Camera, image_size: [usize; 2], side: usize) -> Option<Self> {
        let end = VehicleEnd::facing(expected)?;
        let [left, right] = end.plate_ends_px(camera)?;
        let [top, bottom] = [-0.5, 0.5].map(|share| end.point(0.0, share * WINDOW_M[1]));
        let [top, bottom] = [camera.pixel_from_point(top)?[1], camera.pixel_from_point(bottom)?[1]];
        let middle = [f64::midpoint(left, right), f64::midpoint(top, bottom)];
        let is_inside = (0..2).all(|axis| (0.0..image_size[axis] as f64).contains(&middle[axis]));
        if !is_inside || right - left < MIN_WIDTH_PX {
            return None;
        }
        let scale = [EXPECTED_WIDTH * side as f64 / (right - left), side as f64 / (bottom - top)];
        let window = Affine2::centered(middle, scale, [side; 2]);
        Some(Self { window, camera: camera.transformed(&window), side, expected_m: expected.depth_m() })
    }

    /// Where `point` (camera coordinates, metres) is seen, sides of the cut-out from its middle; `None` when it is not
    /// in front of the camera.
    pub fn image_position(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        Some(self.camera.pixel_from_point(point)?.map(|at| at / self.side as f64 - 0.5))
    }

    /// The third channel of what the network should answer when the vehicle is at this depth.
    pub fn encode(&self, depth_m: f64) -> f64 {
        (self.expected_m / depth_m).ln() / LOG_UNIT
    }

    /// What an answer says of the vehicle's depth.
    pub fn decode(&self, [.., wider, error]: [f64; ANSWER_CHANNELS]) -> MeasuredDepth {
        MeasuredDepth { depth_m: self.expected_m * (-wider * LOG_UNIT).exp(), log_sigma: told_sigma(error) }
    }
}

/// The mean of the answers for a cut-out, `side` pixels wide, and for its mirror image.
pub fn mean_answer(
    answer: [f64; ANSWER_CHANNELS],
    mirrored: [f64; ANSWER_CHANNELS],
    side: usize,
) -> [f64; ANSWER_CHANNELS] {
    // Pixel u lies at side - 1 - u.
    let [across, down, wider, error] = mirrored;
    let mirrored = [-across - 1.0 / side as f64, down, wider, error];
    std::array::from_fn(|channel| f64::midpoint(answer[channel], mirrored[channel]))
}

/// `known` at the depth on which it and a reading of its plate agree best, if they can be of the same thing and it says
/// how sure it is of its depth.
///
/// The box is moved along its rays and grows with the distance, so the picture stays the same.
pub fn measured(mut known: Detection, reading: MeasuredDepth, fusion: &DepthFusion) -> Detection {
    let Some(first) = MeasuredDepth::of(&known) else { return known };
    let second = fusion.corrected(reading);
    let off = (second.depth_m / first.depth_m).ln().abs() / first.log_sigma.hypot(second.log_sigma);
    // What is no number is not at most this.
    if off <= MAX_OFF {
        known.move_to(fusion.joint(Some(first), reading));
    }
    known
}

/// The end of a vehicle that faces the camera.
struct VehicleEnd {
    /// The middle of where plates are.
    middle: [f64; 3],
    /// To the right as the camera sees it, over the ground, of length 1.
    across: [f64; 2],
}

impl VehicleEnd {
    fn facing(vehicle: &Box3d) -> Option<Self> {
        let [x, y, z] = vehicle.location;
        let (sin, cos) = vehicle.yaw.sin_cos();
        let ahead = [cos, -sin];
        // Front or rear, whichever looks towards the camera.
        let towards = if ahead[0] * x + ahead[1] * z > 0.0 { ahead.map(|v| -v) } else { ahead };
        let half = vehicle.dimensions.length / 2.0;
        let middle = [x + half * towards[0], y - MIDDLE_HEIGHT * vehicle.dimensions.height, z + half * towards[1]];
        let facing = -(towards[0] * middle[0] + towards[1] * middle[2]) / middle[0].hypot(middle[2]);
        let is_seen = facing >= MIN_FACING && middle[2] > NEAR_PLANE_M;
        is_seen.then_some(Self { middle, across: [-towards[1], towards[0]] })
    }

    /// The point so many metres to the right of the middle and below it.
    fn point(&self, right_m: f64, down_m: f64) -> [f64; 3] {
        let [x, y, z] = self.middle;
        [x + right_m * self.across[0], y + down_m, z + right_m * self.across[1]]
    }

    /// Columns of the left and the right end of a plate.
    fn plate_ends_px(&self, camera: &Camera) -> Option<[f64; 2]> {
        let [left, right] = [-0.5, 0.5].map(|share| self.point(share * PLATE_WIDTH_M, 0.0));
        let [left, right] = [camera.pixel_from_point(left)?[0], camera.pixel_from_point(right)?[0]];
        Some([left, right])
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, SQRT_2};

    use proptest::prelude::*;

    use super::*;
    use farsight_core::Dimensions;

    const IMAGE: [usize; 2] = [1242, 375];
    const SIDE: usize = 72;

    /// With a fourth column, as KITTI's.
    fn camera() -> Camera {
        let projection =
            [[721.5377, 0.0, 609.5593, 44.857], [0.0, 721.5377, 172.854, 0.2164], [0.0, 0.0, 1.0, 0.002_745_9]];
        Camera::from_projection(projection).expect("a camera")
    }

    /// A car `depth_m` ahead and `right_m` to the right that is turned by `turn` from facing away.
    fn car(right_m: f64, depth_m: f64, turn: f64) -> Box3d {
        let dimensions = Dimensions { height: 1.5, width: 1.7, length: 4.2 };
        Box3d { dimensions, location: [right_m, 1.65, depth_m], yaw: turn - FRAC_PI_2 }
    }

    /// Left and right end of a plate in the middle of the car's near end, computed from the corners of its box.
    fn plate_of(object: &Box3d) -> [[f64; 3]; 2] {
        let corners = object.corners();
        let middle =
            |of: &[usize]| [0, 1, 2].map(|axis| of.iter().map(|&k| corners[k][axis]).sum::<f64>() / of.len() as f64);
        let (front, rear) = ([1, 2, 3, 4], [0, 5, 6, 7]);
        let distance = |of: &[usize]| middle(of)[0].hypot(middle(of)[2]);
        let near = if distance(&front) < distance(&rear) { front } else { rear };
        let across = |sign: f64| {
            let [x, _, z] = middle(&near);
            let (sin, cos) = object.yaw.sin_cos();
            let y = object.location[1] - MIDDLE_HEIGHT * object.dimensions.height;
            [x + sign * PLATE_WIDTH_M / 2.0 * sin, y, z + sign * PLATE_WIDTH_M / 2.0 * cos]
        };
        let mut ends = [across(-1.0), across(1.0)];
        ends.sort_by(|a, b| (a[0] / a[2]).total_cmp(&(b[0] / b[2])));
        ends
    }

    proptest! {
        #[test]
        fn a_plate_is_where_it_is_expected_and_as_wide(
            right in -0.4..0.4_f64, depth_m in 6.0..40.0_f64, turn in -0.9..0.9_f64, from_ahead in any::<bool>(),
        ) {
            let turn = if from_ahead { turn + std::f64::consts::PI } else { turn };
            let object = car(right * depth_m, depth_m, turn);
            let Some(crop) = PlateCrop::of(&object, &camera(), IMAGE, SIDE) else { return Ok(()) };
            let [left, right] = plate_of(&object).map(|end| crop.image_position(end).expect("in front"));
            prop_assert!((left[0] + EXPECTED_WIDTH / 2.0).abs() < 1e-9 && (right[0] - EXPECTED_WIDTH / 2.0).abs() < 1e-9);
            prop_assert!((left[1] + right[1]).abs() < 0.12, "{left:?} {right:?}");
            prop_assert!(crop.encode(depth_m).abs() < 1e-12);
        }

        #[test]
        fn an_answer_gives_back_the_depth(depth_m in 6.0..40.0_f64, factor in 0.8..1.25_f64, error in -2.0..2.0_f64) {
            let crop = PlateCrop::of(&car(1.0, depth_m, 0.2), &camera(), IMAGE, SIDE).expect("a plate");
            let read = crop.decode([0.0, 0.0, crop.encode(factor * depth_m), error]);
            prop_assert!((read.depth_m - factor * depth_m).abs() < 1e-9);
            prop_assert!((read.log_sigma - SQRT_2 * 0.05 * error.exp()).abs() < 1e-12);
        }

        #[test]
        fn a_nearer_car_shows_a_wider_plate(depth_m in 6.0..30.0_f64, factor in 0.8..1.25_f64) {
            // Expected farther away and as much larger: the same picture, but for the centimetres of a fourth column.
            let object = car(1.0, depth_m, 0.2);
            let crop = PlateCrop::of(&object.scaled(factor), &camera(), IMAGE, SIDE).expect("a plate");
            let [left, right] = plate_of(&object).map(|end| crop.image_position(end).expect("in front")[0]);
            let wider = ((right - left) / EXPECTED_WIDTH).ln() / LOG_UNIT;
            prop_assert!((wider - crop.encode(depth_m)).abs() < 0.03, "{wider} {}", crop.encode(depth_m));
        }
    }

    #[test]
    fn a_mirrored_world_gives_the_mirrored_answer() {
        let (object, camera) = (car(3.0, 15.0, 0.3), camera());
        let expected = object.scaled(1.1);
        let crop = PlateCrop::of(&expected, &camera, IMAGE, SIDE).expect("a plate");
        let mirrored = PlateCrop::of(&expected.mirrored(), &camera.mirrored(IMAGE[0]), IMAGE, SIDE).expect("a plate");
        let middle = |ends: [[f64; 3]; 2], crop: &PlateCrop| {
            let [left, right] = ends.map(|end| crop.image_position(end).expect("in front"));
            [0, 1].map(|axis| f64::midpoint(left[axis], right[axis]))
        };
        let [u, v] = middle(plate_of(&object), &crop);
        let [mirrored_u, mirrored_v] = middle(plate_of(&object.mirrored()), &mirrored);
        let wider = crop.encode(object.depth_m());
        // The cut-out of the mirrored image is the mirror image of the cut-out, but that pixel 0 becomes pixel `SIDE`.
        let shift = 1.0 / SIDE as f64;
        let mean = mean_answer([u, v, wider, 0.5], [mirrored_u - shift, mirrored_v, wider, 1.5], SIDE);
        for (found, expected) in mean.into_iter().zip([u, v, wider, 1.0]) {
            assert!((found - expected).abs() < 1e-6, "{mean:?}, expected {u}, {v}, {wider}, 1");
        }
    }

    #[test]
    fn what_shows_no_end_has_no_plate() {
        let crop = |object: Box3d| PlateCrop::of(&object, &camera(), IMAGE, SIDE);
        assert!(crop(car(0.0, 20.0, 0.0)).is_some());
        assert_eq!(crop(car(0.0, 20.0, FRAC_PI_2)), None, "seen from the side");
        assert_eq!(crop(car(0.0, 150.0, 0.0)), None, "too far away");
        assert_eq!(crop(car(0.0, 1.0, 0.0)), None, "its end is behind the camera");
        assert_eq!(crop(car(25.0, 20.0, 0.5)), None, "outside the image");
        assert_eq!(crop(car(f64::NAN, 20.0, 0.0)), None);
        assert!(carries_plate(&ObjectClass::Car) && !carries_plate(&ObjectClass::Cyclist));
    }

    #[test]
    fn a_reading_moves_what_it_can_be_of() {
        let box3d = car(2.0, 20.0, 0.1);
        let known = Detection {
            class: ObjectClass::Car,
            score: 0.9,
            box2d: box3d.projected(&camera()).expect("in front"),
            box3d,
            range_sigma_m: Some(1.0),
        };
        let fusion = DepthFusion { correlation: 0.0, ..DepthFusion::default() };
        let read =
            |depth_m: f64, log_sigma: f64| measured(known.clone(), MeasuredDepth { depth_m, log_sigma }, &fusion);
        let surer = read(21.0, 0.01);
        assert!((20.9..21.0).contains(&surer.box3d.depth_m()), "{surer:?}");
        assert!(surer.range_sigma_m < Some(0.25), "{surer:?}");
        assert!(
            (surer.box3d.dimensions.height / 1.5 - surer.box3d.depth_m() / 20.0).abs() < 1e-12,
            "it grows with the distance"
        );
        assert_eq!((surer.box2d, surer.score), (known.box2d, known.score));
        // Plates of another country are 0.3 m wide; an answer that is no number says nothing.
        assert_eq!(read(20.0 * 0.52 / 0.3, 0.02), known);
        assert_eq!(read(f64::NAN, 0.02), known);
        let unsure = Detection { range_sigma_m: None, ..known };
        assert_eq!(measured(unsure.clone(), MeasuredDepth { depth_m: 21.0, log_sigma: 0.01 }, &fusion), unsure);
    }
}
