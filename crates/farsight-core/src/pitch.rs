//! How far down a camera looks, by what it sees.
//!
//! On a plane, where something ends below in the image follows from how high it is there: `bottom = height_px H / h -
//! pitch`, as tangents, with the camera's height `H` over the object's `h`. Many objects, or a few far ones, so say
//! where the horizon is.

use crate::{Box2d, Camera, Detection, Pose};

/// How far down a camera looks: the angle from the road's plane to its optical axis, positive down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pitch {
    /// The angle, radians.
    pub angle_rad: f64,
    /// Its standard deviation, radians.
    pub sigma_rad: f64,
}

/// Detections with a lower score say nothing.
const MIN_SCORE: f64 = 0.2;

/// So many detections say enough.
const MOST: usize = 16;

/// Boxes that end nearer to the image's border, pixels, may be cut by it.
const BORDER_PX: f64 = 2.0;

/// Cameras before anything is seen: the tangent of their pitch (Cauchy's distribution: most look ahead, some down from
/// masts), and the height above the road, metres, with the standard deviation of its logarithm.
const TANGENT_SCALE: f64 = 0.1;
const HEIGHT_M: f64 = 1.6;
const HEIGHT_LOG_SIGMA: f64 = 0.5;

/// How far off the lower edge of a box is, as a tangent, and the height of an object, as a share of it.
const EDGE_ERROR: f64 = 0.006;
const SIZE_ERROR: f64 = 0.14;

/// Tails of Student's distribution: some boxes are no objects, or stand on bridges.
const DEGREES_OF_FREEDOM: f64 = 3.0;

/// What is tried: tangents of the pitch to both sides, and heights of the camera, metres.
const TANGENTS: usize = 121;
const MAX_TANGENT: f64 = 0.5;
const HEIGHTS: usize = 24;
const HEIGHTS_M: [f64; 2] = [0.7, 9.0];

/// A smaller pitch, radians, changes little of what is found; twice as large a one counts wholly, what is between in
/// part, so that neighbouring frames of a film are seen alike. So is one of which nothing is sure.
const LEAST_RAD: f64 = 0.0175;
const LEAST_SIGMAS: f64 = 0.5;

/// What an object says.
struct Sight {
    /// Of its lower edge below the optical axis.
    tangent: f64,
    /// By so much the lower edge is lower for each metre that the camera is higher.
    by_height: f64,
    weight: f64,
}

impl Sight {
    fn of(detection: &Detection, camera: &Camera, [width, height]: [f64; 2]) -> Option<Self> {
        let Detection { box2d, box3d, score, .. } = detection;
        let inner = Box2d::new(box2d.x1 - BORDER_PX, box2d.y1 - BORDER_PX, box2d.x2 + BORDER_PX, box2d.y2 + BORDER_PX);
        let tangent = (box2d.y2 - camera.principal_point()[1]) / camera.focal_y();
        let by_height = box2d.height() / camera.focal_y() / box3d.dimensions.height;
        let says = *score >= MIN_SCORE && !inner.reaches_border(width, height) && by_height > 0.0;
        (says && tangent.is_finite() && by_height.is_finite()).then_some(Self { tangent, by_height, weight: *score })
    }
}

impl Pitch {
    /// That of the `camera` that took an image of `image_size`, by what was found in it: boxes in the image, and
    /// heights of the objects. Without any it is what cameras usually have.
    pub fn of(detections: &[Detection], camera: &Camera, image_size: [usize; 2]) -> Self {
        let size = image_size.map(|side| side as f64);
        let mut sights: Vec<Sight> = detections.iter().filter_map(|one| Sight::of(one, camera, size)).collect();
        sights.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        sights.truncate(MOST);
        let (mut best, [mut sum, mut mean, mut square]) = (f64::NEG_INFINITY, [0.0; 3]);
        each_log_likelihood(&sights, |tangent, log| {
            if log > best {
                let smaller = (best - log).exp();
                (best, sum, mean, square) = (log, smaller * sum, smaller * mean, smaller * square);
            }
            let share = (log - best).exp();
            (sum, mean, square) = (sum + share, mean + share * tangent, square + share * tangent * tangent);
        });
        mean /= sum;
        let sigma = (square / sum - mean * mean).max(0.0).sqrt();
        // The derivative of the angle by its tangent.
        Self { angle_rad: mean.atan(), sigma_rad: sigma / (1.0 + mean * mean) }
    }

    /// As much of the angle as is worth a turn, radians: none where that changes nothing, or nothing is sure.
    pub fn worthwhile_rad(self) -> Option<f64> {
        let least = LEAST_RAD.max(LEAST_SIGMAS * self.sigma_rad);
        let share = ((self.angle_rad.abs() - least) / least).clamp(0.0, 1.0);
        (share > 0.0).then_some(share * self.angle_rad)
    }
}

/// From level coordinates (y straight down, z ahead over the road) to those of a camera that looks down by `angle_rad`.
pub fn camera_from_level(angle_rad: f64) -> Pose {
    let (sin, cos) = angle_rad.sin_cos();
    Pose { rotation: [[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]], ..Pose::IDENTITY }
}

/// Tells the tangents of the pitch, each with how likely it is with each height of the camera, by at most [`MOST`]
/// sights.
fn each_log_likelihood(sights: &[Sight], mut tell: impl FnMut(f64, f64)) {
    let step = |place: usize, count: usize| place as f64 / (count - 1) as f64;
    let [lowest_m, highest_m] = HEIGHTS_M.map(f64::ln);
    for height in 0..HEIGHTS {
        let log_height = lowest_m + (highest_m - lowest_m) * step(height, HEIGHTS);
        let usual = ((log_height - HEIGHT_M.ln()) / HEIGHT_LOG_SIGMA).powi(2);
        let height_m = log_height.exp();
        // Expected tangent of the edge of a level camera, its precision, and what the width of the distribution costs.
        let mut expected = [[0.0; 3]; MOST];
        for (sight, expected) in sights.iter().zip(&mut expected) {
            let below = height_m * sight.by_height;
            let variance = EDGE_ERROR.powi(2) + (SIZE_ERROR * below).powi(2);
            *expected = [sight.tangent - below, 1.0 / (DEGREES_OF_FREEDOM * variance), 0.5 * variance.ln()];
        }
        for place in 0..TANGENTS {
            let tangent = MAX_TANGENT * (2.0 * step(place, TANGENTS) - 1.0);
            let mut log = -0.5 * usual - (tangent / TANGENT_SCALE).powi(2).ln_1p();
            for (sight, [level, precision, width]) in sights.iter().zip(&expected) {
                let off = level + tangent;
                let tails = f64::midpoint(DEGREES_OF_FREEDOM, 1.0) * (off * off * precision).ln_1p();
                log -= sight.weight * (tails + width);
            }
            tell(tangent, log);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Pitch, camera_from_level};
    use crate::{Box2d, Box3d, Camera, Detection, Dimensions, ObjectClass};

    const SIZE: [usize; 2] = [1280, 720];

    fn camera() -> Camera {
        Camera::from_hfov(70.0, SIZE[0], SIZE[1]).unwrap()
    }

    /// A plate of a car's height that stands on the road of a camera so high that looks down so far.
    fn plate(height_m: f64, pitch_rad: f64, [x, z]: [f64; 2], size: f64) -> Detection {
        let (sin, cos) = pitch_rad.sin_cos();
        let seen = |up: f64, aside: f64| {
            let y = height_m - up;
            camera().pixel_from_point([x + aside, cos * y - sin * z, sin * y + cos * z]).unwrap()
        };
        let ([x1, y1], [x2, y2]) = (seen(1.5 * size, -0.9), seen(0.0, 0.9));
        let dimensions = Dimensions { height: 1.5, width: 1.8, length: 4.2 };
        let box3d = Box3d { dimensions, location: [x, height_m, z], yaw: 0.0 };
        let box2d = Box2d::new(x1, y1, x2, y2);
        Detection { class: ObjectClass::Car, score: 0.6, box2d, box3d, range_sigma_m: None }
    }

    const PLACES: [[f64; 2]; 6] = [[-4.0, 14.0], [0.0, 22.0], [4.0, 30.0], [-3.0, 45.0], [3.0, 60.0], [0.0, 35.0]];
    /// Cars and vans.
    const SIZES: [f64; 6] = [1.0, 0.95, 1.1, 1.0, 0.92, 1.05];

    fn seen(height_m: f64, pitch_rad: f64) -> Vec<Detection> {
        PLACES.iter().zip(SIZES).map(|(place, size)| plate(height_m, pitch_rad, *place, size)).collect()
    }

    #[test]
    fn cars_on_a_road_say_how_far_down_a_camera_looks() {
        // What is high up looks down.
        for (height_m, least, most_off) in [(1.2, -5, 1.0), (1.6, -5, 1.0), (2.5, -2, 1.0), (6.0, 3, 2.5)] {
            for degrees in [-5, -2, 0, 3, 8, 14].into_iter().filter(|degrees| *degrees >= least).map(f64::from) {
                let found = Pitch::of(&seen(height_m, degrees.to_radians()), &camera(), SIZE);
                let off = found.angle_rad.to_degrees() - degrees;
                assert!(off.abs() < most_off, "{height_m} m, {degrees}: {off}");
                assert!(off.abs() < 3.0 * found.sigma_rad.to_degrees(), "{height_m} m, {degrees}: {off}, {found:?}");
            }
        }
    }

    #[test]
    fn a_level_camera_stays_as_it_is_and_so_does_one_that_sees_nothing() {
        assert_eq!(Pitch::of(&seen(1.6, 0.005), &camera(), SIZE).worthwhile_rad(), None);
        let unknown = Pitch::of(&[], &camera(), SIZE);
        assert!(unknown.angle_rad.abs() < 1e-9 && unknown.sigma_rad > 0.09, "{unknown:?}");
        assert_eq!(unknown.worthwhile_rad(), None);
        // What the border cuts says nothing.
        let cut: Vec<Detection> = seen(1.6, 0.15)
            .into_iter()
            .map(|one| Detection { box2d: Box2d { y2: 719.0, ..one.box2d }, ..one })
            .collect();
        assert_eq!(Pitch::of(&cut, &camera(), SIZE), unknown);
    }

    #[test]
    fn boxes_that_are_no_cars_move_it_little() {
        let mut found = seen(1.6, 0.1);
        found.push(Detection { box2d: Box2d::new(600.0, 20.0, 640.0, 60.0), ..found[0].clone() });
        let pitch = Pitch::of(&found, &camera(), SIZE);
        assert!((pitch.angle_rad - 0.1).abs() < 0.02, "{pitch:?}");
    }

    #[test]
    fn an_angle_counts_the_more_the_larger_and_surer_it_is() {
        let worth = |degrees: f64, sigma: f64| {
            let pitch = Pitch { angle_rad: degrees.to_radians(), sigma_rad: sigma.to_radians() };
            pitch.worthwhile_rad().map(f64::to_degrees)
        };
        assert_eq!(worth(0.9, 0.3), None);
        assert_eq!(worth(3.0, 6.0), None);
        assert!((worth(-5.0, 0.5).unwrap() + 5.0).abs() < 1e-9);
        assert!((worth(1.5, 0.5).unwrap() - 0.75).abs() < 0.01);
    }

    #[test]
    fn level_coordinates_have_the_road_below() {
        let seen = camera_from_level(0.12).apply([1.0, 1.6, 20.0]);
        let (sin, cos) = 0.12_f64.sin_cos();
        let expected = [1.0, cos * 1.6 - sin * 20.0, sin * 1.6 + cos * 20.0];
        assert!((0..3).all(|axis| (seen[axis] - expected[axis]).abs() < 1e-12), "{seen:?}");
        // The camera sees the same, whatever coordinates it is told in.
        let level = camera().moved(&camera_from_level(0.12).inverse());
        let [there, here] = [level.pixel_from_point([1.0, 1.6, 20.0]), camera().pixel_from_point(seen)];
        let (there, here) = (there.unwrap(), here.unwrap());
        assert!((there[0] - here[0]).abs() < 1e-9 && (there[1] - here[1]).abs() < 1e-9, "{there:?}, {here:?}");
    }

    #[test]
    fn detections_come_back_from_other_coordinates() {
        let camera_from_level = camera_from_level(0.3);
        for yaw in [-3.0, -1.5, -0.4, 0.0, 0.7, 1.6, 3.1] {
            let mut one = Detection { range_sigma_m: Some(1.5), ..plate(1.6, 0.0, [2.0, 18.0], 1.0) };
            one.box3d.yaw = yaw;
            let there = one.moved(&camera_from_level);
            let sigma = |one: &Detection| one.range_sigma_m.unwrap() / one.box3d.depth_m();
            assert!((sigma(&there) - sigma(&one)).abs() < 1e-12);
            let back = there.moved_back(&camera_from_level);
            assert!((back.box3d.yaw - yaw).abs() < 1e-9, "{yaw}: {back:?}");
            assert!((0..3).all(|axis| (back.box3d.location[axis] - one.box3d.location[axis]).abs() < 1e-9));
        }
    }
}
