//! The road under a camera that stays where it is: what all that it saw say of it together.

use std::fmt::{self, Display};

use super::{BENT, Common, EDGE_ERROR, Fit, GroundContact, Prior, Road, UNEVEN_M};
use crate::linear::{cross, norm, solved};
use crate::scale::ScalePrior;
use crate::{Camera, Detection, Pose};

/// Fewer objects than this are too few to tell a plane.
const MIN_OBJECTS: usize = 4;

/// A plane is told where it is surer of the height than this, as a share: less is no better than a guess.
const MAX_HEIGHT_ERROR: f64 = 0.3;

/// What a network gets wrong alike in all images of one camera: standard deviations of slope, tilt and, as a share,
/// height. Chosen with seven rendered cameras in view.
const ALIKE_SLOPE: f64 = 0.005;
const ALIKE_TILT: f64 = 0.003;
const ALIKE_HEIGHT: f64 = 0.03;

/// So many standard deviations off the plane an object does not stand on it.
const OFF_THE_ROAD: f64 = 2.5;

/// The least share of the optical axis that lies in the road: a camera that looks down more steeply sees no traffic.
const MIN_AHEAD: f64 = 0.1;

/// A road as a camera sees it: the plane `y + slope z + tilt x = height` in camera coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoadPlane {
    /// By how much the road comes up towards the optical axis, metres a metre: the tangent of how far the camera looks
    /// down.
    pub slope: f64,
    /// By how much it comes up to the right, metres a metre: the tangent of the camera's roll.
    pub tilt: f64,
    /// From the camera down to it, metres.
    pub height_m: f64,
    /// Standard deviations of slope, tilt and height.
    pub sigmas: [f64; 3],
}

impl RoadPlane {
    /// The plane on which the objects of all `images` of one camera stand; each image has unknown sizes by `scale` of
    /// its own, and the camera may be known to be `height` (metres, and its standard deviation) above it.
    ///
    /// None where it cannot be told: fewer than four objects that are sure, or all at one place.
    pub fn of(images: &[Vec<Detection>], road: Road, scale: &ScalePrior) -> Option<Self> {
        let height = road.height()?;
        let contacts: Vec<GroundContact> =
            images.iter().flatten().filter_map(|detection| GroundContact::of(detection, scale)).collect();
        if contacts.len() < MIN_OBJECTS {
            return None;
        }
        // The country is the same in all images, so that they share one factor.
        let prior = Prior::new(height, scale);
        let fit = Fit::of(&contacts, &prior)?;
        let (curvature, _) = fit.common_demand(&fit.demands(&contacts), &prior);
        let sigma = |direction: Common, place: usize| Some(solved(curvature, direction)?[place].sqrt());
        let [slope, height_m, tilt, _] = fit.common;
        let sigmas =
            [sigma([1.0, 0.0, 0.0, 0.0], 0)?, sigma([0.0, 0.0, 1.0, 0.0], 2)?, sigma([0.0, 1.0, 0.0, 0.0], 1)?];
        // A tape measure does not err as networks do.
        let alike_height = if road == Road::Below { ALIKE_HEIGHT } else { 0.0 };
        let alike = [ALIKE_SLOPE, ALIKE_TILT, alike_height * height_m];
        let sigmas = std::array::from_fn(|i| f64::hypot(sigmas[i], alike[i]));
        let plane = Self { slope, tilt, height_m, sigmas };
        plane.is_told().then_some(plane)
    }

    /// The share of the sure objects of `images` that stand on it, as far as their distances and boxes can tell.
    pub fn carries(&self, images: &[Vec<Detection>], scale: &ScalePrior) -> f64 {
        let common = [self.slope, self.height_m, self.tilt, 0.0];
        let stands = |contact: &GroundContact| {
            let (off, sigma) = contact.off(&common, 1.0);
            let depth_m = contact.foot[2];
            // What the distance leaves open moves it along its ray.
            let by_distance = contact.sigma.hypot(scale.log_sigma) * self.height_m / depth_m;
            off.abs() < OFF_THE_ROAD * sigma.hypot(by_distance).hypot(self.sigmas[2] / depth_m)
        };
        let contacts: Vec<GroundContact> =
            images.iter().flatten().filter_map(|detection| GroundContact::of(detection, scale)).collect();
        contacts.iter().filter(|contact| stands(contact)).count() as f64 / contacts.len().max(1) as f64
    }

    /// Whether it says more than a guess would.
    fn is_told(&self) -> bool {
        let numbers = [self.slope, self.tilt, self.height_m].into_iter().chain(self.sigmas);
        numbers.into_iter().all(f64::is_finite)
            && self.height_m > 0.0
            && self.sigmas[2] < MAX_HEIGHT_ERROR * self.height_m
    }

    /// The same camera in coordinates that are level: y points straight down to the road, z ahead over it. Its
    /// projection holds the rotation, as those of rendered cameras that look down do. With it, the plane in these
    /// coordinates.
    ///
    /// None where the camera looks straight down.
    pub fn levelled(&self, camera: &Camera) -> Option<(Camera, Self)> {
        let length = norm(&[self.tilt, 1.0, self.slope]);
        let down = [self.tilt, 1.0, self.slope].map(|value| value / length);
        // The optical axis, as far as it lies in the road.
        let ahead = [0, 1, 2].map(|axis| if axis == 2 { 1.0 } else { 0.0 } - down[2] * down[axis]);
        let ahead_length = norm(&ahead);
        if ahead_length < MIN_AHEAD {
            return None;
        }
        let ahead = ahead.map(|value| value / ahead_length);
        let level_from_camera = Pose { rotation: [cross(&down, &ahead), down, ahead], ..Pose::IDENTITY };
        let plane = Self { slope: 0.0, tilt: 0.0, height_m: self.height_m / length, sigmas: self.sigmas };
        Some((camera.moved(&level_from_camera), plane))
    }

    /// The plane as the prior of a fit.
    pub(super) fn prior(&self, scale: &ScalePrior) -> Prior {
        let [slope, tilt, height] = self.sigmas;
        // A road is no plane: what objects of one place say of it is not known better than this.
        let sigmas = [slope.hypot(BENT), height.hypot(UNEVEN_M), tilt.hypot(EDGE_ERROR)];
        Prior::around([self.slope, self.height_m, self.tilt], sigmas, scale)
    }
}

/// How surely a height that somebody gave contradicts what the objects of an image say of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightConflict {
    /// What was given, metres.
    pub given_m: f64,
    /// What the objects say, and its standard deviation, metres.
    pub seen_m: [f64; 2],
}

impl Display for HeightConflict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { given_m, seen_m: [seen, sigma] } = self;
        write!(
            f,
            "a camera {given_m} m above the road contradicts what stands on it, which says {seen:.1} ±{sigma:.1} m: \
             is the height or the field of view wrong?"
        )
    }
}

/// So many standard deviations apart two heights contradict each other.
const DOUBT: f64 = 3.0;

impl HeightConflict {
    /// None where `detections`, as found and not yet moved onto a road, agree with `road`, or cannot tell.
    pub fn of(detections: &[Detection], road: Road, scale: &ScalePrior) -> Option<Self> {
        let Road::BelowBy(given_m) = road else { return None };
        let seen = RoadPlane::of(&[detections.to_vec()], Road::Below, scale)?;
        let sigma = seen.sigmas[2];
        let apart = (seen.height_m - given_m).abs();
        (apart > DOUBT * sigma.hypot(UNEVEN_M)).then_some(Self { given_m, seen_m: [seen.height_m, sigma] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::road::fit_to_road;
    use crate::{Box2d, Box3d, Dimensions, ObjectClass};

    const SCALE: ScalePrior = ScalePrior { factor: 1.0, log_sigma: 0.05 };

    /// A car on the plane, told `factor` times too far.
    fn car(plane: [f64; 3], [x, z]: [f64; 2], factor: f64) -> Detection {
        let [slope, tilt, height_m] = plane;
        let dimensions = Dimensions { height: 1.5, width: 1.7, length: 4.2 };
        let location = [x, height_m - slope * z - tilt * x, z];
        let box3d = Box3d { dimensions, location, yaw: 0.3 }.scaled(factor);
        let box2d = Box2d::new(0.0, 0.0, 50.0, 40.0);
        let range_sigma_m = Some(0.05 * box3d.depth_m());
        Detection { class: ObjectClass::Car, score: 0.9, box2d, box3d, range_sigma_m }
    }

    /// Ten images of six cars; factors go around those of a normal distribution's quantiles.
    fn traffic(plane: [f64; 3], common: f64) -> Vec<Vec<Detection>> {
        let quantiles = [-1.38_f64, -0.67, -0.21, 0.21, 0.67, 1.38];
        (0..10)
            .map(|image| {
                (0..6)
                    .map(|i| {
                        let factor = common * (0.05 * quantiles[(i * 5 + image * 7) % 6]).exp();
                        let x = [-6.0, 3.5, -3.0, 7.0, 0.5, -9.0][(i + image) % 6];
                        car(plane, [x, 10.0 + 5.5 * i as f64 + 0.4 * image as f64], factor)
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn the_plane_of_a_camera_is_found_within_its_error_bars() {
        // Sizes off by one of their standard deviations, and a camera at the limit of what is expected of heights.
        for plane in [[0.0, 0.0, 1.4], [0.18, -0.03, 6.0], [-0.02, 0.02, 2.2]] {
            for common in [1.0, 1.05, 0.94] {
                let found = RoadPlane::of(&traffic(plane, common), Road::Below, &SCALE).unwrap();
                let off = [found.slope - plane[0], found.tilt - plane[1], found.height_m - plane[2]];
                for (off, sigma) in off.into_iter().zip(found.sigmas) {
                    assert!(off.abs() < 2.5 * sigma, "{plane:?} {common}: {found:?}");
                }
                // Nobody knows the country's sizes, so the height stays unsure by their share.
                assert!(found.sigmas[2] / plane[2] > 0.03 && found.sigmas[0] < 0.01, "{found:?}");
            }
        }
    }

    #[test]
    fn many_wrong_edges_make_no_camera_lower() {
        // Boxes end two error bars too low, or as much too high. In metres off a plane that is less on a lower one.
        let wrong = |tangent: f64| {
            let mut images = traffic([0.05, 0.0, 1.8], 1.0);
            images.iter_mut().flatten().for_each(|car| car.box3d.location[1] += tangent * car.box3d.depth_m());
            images
        };
        let images = [wrong(0.008), wrong(-0.008)].concat();
        let found = RoadPlane::of(&images, Road::Below, &SCALE).unwrap();
        assert!((found.height_m / 1.8).ln().abs() < 0.04, "{found:?}");
    }

    #[test]
    fn a_measured_height_leaves_slope_and_tilt_to_the_traffic() {
        let found = RoadPlane::of(&traffic([0.1, 0.01, 5.0], 1.08), Road::BelowBy(5.0), &SCALE).unwrap();
        assert!((found.height_m - 5.0).abs() < 0.1 && found.sigmas[2] < 0.06, "{found:?}");
        assert!((found.slope - 0.1).abs() < 0.01 && (found.tilt - 0.01).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn no_traffic_tells_nothing() {
        assert_eq!(RoadPlane::of(&[], Road::Below, &SCALE), None);
        let few = [vec![car([0.0, 0.0, 1.5], [1.0, 20.0], 1.0); 3]];
        assert_eq!(RoadPlane::of(&few, Road::Below, &SCALE), None);
        let mut unsure = traffic([0.0, 0.0, 1.5], 1.0);
        unsure.iter_mut().flatten().for_each(|car| car.score = 0.3);
        assert_eq!(RoadPlane::of(&unsure, Road::Below, &SCALE), None);
    }

    #[test]
    fn a_known_plane_puts_a_single_car_where_it_is() {
        let plane = [0.12, 0.0, 5.0];
        let road = Road::Known(RoadPlane::of(&traffic(plane, 1.0), Road::BelowBy(5.0), &SCALE).unwrap());
        let found = fit_to_road(vec![car(plane, [2.0, 25.0], 1.15)], road, &SCALE);
        let before = 0.15_f64;
        assert!((found[0].box3d.depth_m() / 25.0 - 1.0).abs() < 0.4 * before, "{:?}", found[0].box3d);
        assert!(found[0].range_sigma_m.unwrap() < 0.05 * 25.0);
    }

    #[test]
    fn a_level_camera_shows_the_road_where_the_tilted_one_does() {
        let camera = Camera::from_hfov(60.0, 1280, 720).unwrap();
        let plane = RoadPlane { slope: 0.3, tilt: -0.06, height_m: 6.0, sigmas: [0.01, 0.01, 0.2] };
        let (level, road) = plane.levelled(&camera).unwrap();
        assert!((road.height_m - 6.0 / (1.0_f64 + 0.09 + 0.0036).sqrt()).abs() < 1e-12, "{road:?}");
        for place in [[0.0, 15.0], [4.0, 30.0], [-7.0, 55.0]] {
            let pixel = level.pixel_from_point([place[0], road.height_m, place[1]]).unwrap();
            // The same point of the road, through the tilted camera.
            let ray = camera.point_from_pixel(pixel, 1.0);
            let depth = 6.0 / (ray[1] + 0.3 * ray[2] - 0.06 * ray[0]);
            let point = ray.map(|value| value * depth);
            let distance = norm(&point);
            assert!((distance - norm(&[place[0], road.height_m, place[1]])).abs() < 1e-9, "{point:?}");
        }
        let steep = RoadPlane { slope: 1e6, ..plane };
        assert_eq!(steep.levelled(&camera), None);
    }

    #[test]
    fn a_height_that_the_cars_contradict_is_doubted() {
        let seen = &traffic([0.0, 0.0, 1.6], 1.0)[0];
        let doubt = HeightConflict::of(seen, Road::BelowBy(10.0), &SCALE).unwrap();
        assert!((doubt.seen_m[0] - 1.6).abs() < 2.0 * doubt.seen_m[1], "{doubt:?}");
        for road in [Road::BelowBy(1.6), Road::BelowBy(1.7), Road::Below, Road::Ignored] {
            assert_eq!(HeightConflict::of(seen, road, &SCALE), None, "{road:?}");
        }
        assert_eq!(HeightConflict::of(&seen[..2], Road::BelowBy(10.0), &SCALE), None, "two cars are no witness");
    }
}
