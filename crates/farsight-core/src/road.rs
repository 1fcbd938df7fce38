//! One road under all: from where things stand a camera sees how far away they are.
//!
//! An image shows a car's direction and shape, not its size, so each object's distance is unsure by a factor of its
//! own, and by one that all vehicles of the image share ([`crate::scale`]). But objects of one image stand on one road,
//! roughly a plane, so each has a say in where the others are; and where the camera's height above the road is known,
//! that has, too. Plane and factors are looked for together: the likeliest ones by the error bars of the distances, by
//! where the boxes end below, and by how roads lie.

mod plane;

pub use plane::{HeightConflict, RoadPlane};

use crate::linear::{dot, solved};
use crate::scale::{ScalePrior, is_scaled};
use crate::{Detection, MeasuredDepth};

/// Detections with a lower score stay as they are and say nothing about the road: many are half hidden, and where they
/// end below is a guess.
pub const SURE_SCORE: f64 = 0.5;

/// How far off the lower edge of a box is, as a tangent of the angle: two pixels of KITTI's images.
const EDGE_ERROR: f64 = 0.003;

/// How uneven roads are, metres, and how fast they leave their plane, metres per metre of distance.
const UNEVEN_M: f64 = 0.05;
const BENT: f64 = 0.003;

/// How well a height that somebody measured is known, metres.
const HEIGHT_ERROR_M: f64 = 0.05;

/// Standard deviation of the logarithm of a common factor that is known.
const MIN_SCALE_SIGMA: f64 = 1e-9;

/// How high cameras are that nobody measured, and how far from that they may be, metres: in a car, on a truck, over a
/// road.
const ANY_HEIGHT_M: f64 = 2.0;
const ANY_HEIGHT_ERROR_M: f64 = 2.0;

/// How the plane under a camera tips, standard deviations of its slope along the optical axis, which may look down, and
/// across it.
const SLOPE: f64 = 0.5;
const TILT: f64 = 0.02;

/// At so many standard deviations off the plane an object counts half, farther off less and less: it may be no object,
/// or stand on a bridge.
const ODD: f64 = 2.5;

/// Newton's method (Gauss and Newton's) has long converged after so many steps.
const STEPS: usize = 8;

/// What is known of the road under a camera.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Road {
    /// Each object stays where it was found.
    #[default]
    Ignored,
    /// There is one, at an unknown height.
    Below,
    /// The camera is so high above it, metres.
    BelowBy(f64),
    /// This one.
    Known(RoadPlane),
}

impl Road {
    /// Lowest and highest camera, metres: they are neither in the road nor on satellites.
    pub const HEIGHTS_M: [f64; 2] = [0.2, 50.0];

    /// A camera so high above the road, metres; none outside [`Road::HEIGHTS_M`].
    pub fn below_by(height_m: f64) -> Option<Self> {
        let [lowest_m, highest_m] = Self::HEIGHTS_M;
        (lowest_m..=highest_m).contains(&height_m).then_some(Self::BelowBy(height_m))
    }

    /// A camera whose height was measured with this standard deviation, metres, and of which no more is known.
    pub fn measured(height_m: f64, sigma_m: f64) -> Self {
        Self::Known(RoadPlane { slope: 0.0, tilt: 0.0, height_m, sigmas: [SLOPE, TILT, sigma_m] })
    }

    /// Height of the camera and its standard deviation, metres.
    fn height(self) -> Option<[f64; 2]> {
        match self {
            Self::Ignored => None,
            Self::Below => Some([ANY_HEIGHT_M, ANY_HEIGHT_ERROR_M]),
            Self::BelowBy(height_m) => Some([height_m, HEIGHT_ERROR_M]),
            Self::Known(plane) => Some([plane.height_m, plane.sigmas[2]]),
        }
    }

    /// What is known of the plane before anything is seen.
    fn prior(self, scale: &ScalePrior) -> Option<Prior> {
        match self {
            Self::Known(plane) => Some(plane.prior(scale)),
            _ => self.height().map(|height| Prior::new(height, scale)),
        }
    }
}

/// What the objects of an image have in common: the plane `y + slope z + tilt x = height` in camera coordinates,
/// metres, as slope, height and tilt; and the logarithm of the factor of all vehicles' distances.
type Common = [f64; 4];

/// What is known of one object.
#[derive(Debug, Clone, Copy)]
struct GroundContact {
    /// The middle of its lower face, camera coordinates, metres.
    foot: [f64; 3],
    /// Standard deviation of the logarithm of its distance, but for what it shares with others.
    sigma: f64,
    /// Whether it shares the common factor.
    is_scaled: bool,
}

impl GroundContact {
    /// Of a sure detection with an error bar.
    fn of(detection: &Detection, scale: &ScalePrior) -> Option<Self> {
        let foot = detection.box3d.location;
        let sigma = detection.range_sigma_m? / detection.box3d.depth_m();
        let is_usable = detection.score > SURE_SCORE && sigma.is_finite() && sigma > 0.0;
        is_usable.then_some(Self { foot, sigma, is_scaled: scale.log_sigma > 0.0 && is_scaled(&detection.class) })
    }

    /// How far its lower edge lies below where the plane would have it when it is `factor` times as far away, and how
    /// much that may be by boxes and roads: tangents of angles.
    ///
    /// Not metres off the plane: those shrink with the factor, so that many wrong edges would pull everything nearer.
    fn off(&self, common: &Common, factor: f64) -> (f64, f64) {
        let [x, y, z] = self.foot;
        let [slope, height, tilt, _] = *common;
        let off = y / z + slope + tilt * x / z - height / (factor * z);
        let variance = EDGE_ERROR.powi(2) + (UNEVEN_M / z).powi(2) + BENT.powi(2);
        (off, variance.sqrt())
    }

    /// What it asks for: gradient and curvature of the misfit by the logarithm of its factor and by what is common.
    fn demand(&self, common: &Common, log: f64) -> Demand {
        let factor = log.exp();
        let (off, sigma) = self.off(common, factor);
        let weight = 1.0 / (sigma * sigma * (1.0 + (off / sigma / ODD).powi(2)));
        let [x, _, z] = self.foot;
        let by_height = -1.0 / (factor * z);
        let by_log = -common[1] * by_height;
        let by_plane = [1.0, by_height, x / z, 0.0];
        let precision = 1.0 / (self.sigma * self.sigma);
        let share = if self.is_scaled { 1.0 } else { 0.0 };
        let own = log - share * common[3];
        let mut demand = Demand {
            gradient: weight * off * by_log + precision * own,
            curvature: weight * by_log * by_log + precision,
            mixed: by_plane.map(|v| weight * v * by_log),
            common_gradient: by_plane.map(|v| weight * v * off),
            common_curvature: by_plane.map(|a| by_plane.map(|b| weight * a * b)),
        };
        demand.mixed[3] -= share * precision;
        demand.common_gradient[3] -= share * precision * own;
        demand.common_curvature[3][3] += share * precision;
        demand
    }
}

/// Gradient and curvature of an object's misfit.
struct Demand {
    gradient: f64,
    curvature: f64,
    mixed: Common,
    common_gradient: Common,
    common_curvature: [Common; 4],
}

/// `detections` of one image where they stand on one `road` best, with error bars that hold what all share by `scale`.
///
/// Each box is moved along its rays and grows with the distance, so the picture stays the same. Error bars shrink by
/// what the plane tells. Unsure detections say nothing about the road; of it, they only follow the common factor. Those
/// without error bars stay where `scale` has them.
pub fn fit_to_road(mut detections: Vec<Detection>, road: Road, scale: &ScalePrior) -> Vec<Detection> {
    for detection in &mut detections {
        scale.apply(detection);
    }
    let contacts: Vec<Option<GroundContact>> =
        detections.iter().map(|detection| GroundContact::of(detection, scale)).collect();
    let known: Vec<GroundContact> = contacts.iter().copied().flatten().collect();
    let found = road.prior(scale).and_then(|prior| settled(&known, &prior));
    let Some(Settled { objects, common_factor }) = found else {
        for detection in &mut detections {
            widen(detection, MeasuredDepth { depth_m: 1.0, log_sigma: scale.log_sigma });
        }
        return detections;
    };
    let mut objects = objects.into_iter();
    for (detection, contact) in detections.iter_mut().zip(&contacts) {
        match contact.and_then(|_| objects.next()) {
            Some(MeasuredDepth { depth_m, log_sigma }) => {
                let depth_m = detection.box3d.depth_m() * depth_m;
                detection.move_to(MeasuredDepth { depth_m, log_sigma });
            }
            None => widen(detection, common_factor),
        }
    }
    detections
}

/// Moves what shares the common factor by it, and adds its error.
fn widen(detection: &mut Detection, factor: MeasuredDepth) {
    if factor.log_sigma > 0.0
        && is_scaled(&detection.class)
        && let Some(own) = MeasuredDepth::of(detection)
    {
        let log_sigma = own.log_sigma.hypot(factor.log_sigma);
        detection.move_to(MeasuredDepth { depth_m: own.depth_m * factor.depth_m, log_sigma });
    }
}

/// What is known before anything is seen: the likeliest values of what is common, and their precisions.
struct Prior {
    expected: Common,
    precision: Common,
}

impl Prior {
    /// Of a camera at this height (and its standard deviation).
    fn new(height: [f64; 2], scale: &ScalePrior) -> Self {
        Self::around([0.0, height[0], 0.0], [SLOPE, height[1], TILT], scale)
    }

    /// Around this slope, height and tilt, with these standard deviations.
    fn around(
        [slope, height_m, tilt]: [f64; 3],
        [slope_sigma, height_sigma, tilt_sigma]: [f64; 3],
        scale: &ScalePrior,
    ) -> Self {
        // Nobody asks for a factor that is known, so any precision will do.
        let sigmas = [slope_sigma, height_sigma, tilt_sigma, scale.log_sigma.max(MIN_SCALE_SIGMA)];
        Self { expected: [slope, height_m, tilt, 0.0], precision: sigmas.map(|sigma| 1.0 / (sigma * sigma)) }
    }
}

/// What was found out about an image.
struct Settled {
    /// Factor of the distance of each object.
    objects: Vec<MeasuredDepth>,
    /// Of all that share the common one.
    common_factor: MeasuredDepth,
}

/// The factors of the distances and how sure they are; none when the numbers are none.
fn settled(contacts: &[GroundContact], prior: &Prior) -> Option<Settled> {
    let fit = Fit::of(contacts, prior)?;
    let demands = fit.demands(contacts);
    let (curvature, _) = fit.common_demand(&demands, prior);
    let variance = |direction: Common| Some(dot(&direction, &solved(curvature, direction)?));
    let factor = |log: f64, variance: f64| {
        let found = MeasuredDepth { depth_m: log.exp(), log_sigma: variance.sqrt() };
        (found.depth_m.is_finite() && found.log_sigma.is_finite()).then_some(found)
    };
    let object = |(log, demand): (&f64, &Demand)| {
        let by_common = variance(demand.mixed)? / (demand.curvature * demand.curvature);
        factor(*log, 1.0 / demand.curvature + by_common)
    };
    let objects = fit.logs.iter().zip(&demands).map(object).collect::<Option<_>>()?;
    let common_factor = factor(fit.common[3], variance([0.0, 0.0, 0.0, 1.0])?)?;
    Some(Settled { objects, common_factor })
}

/// What is looked for.
struct Fit {
    common: Common,
    /// Logarithms of the factors of the distances.
    logs: Vec<f64>,
}

impl Fit {
    /// The likeliest plane and factors.
    fn of(contacts: &[GroundContact], prior: &Prior) -> Option<Self> {
        let mut fit = Self { common: prior.expected, logs: vec![0.0; contacts.len()] };
        for _ in 0..STEPS {
            let demands = fit.demands(contacts);
            let (curvature, downhill) = fit.common_demand(&demands, prior);
            fit.descend(&demands, &solved(curvature, downhill)?);
        }
        Some(fit)
    }

    fn demands(&self, contacts: &[GroundContact]) -> Vec<Demand> {
        contacts.iter().zip(&self.logs).map(|(contact, log)| contact.demand(&self.common, *log)).collect()
    }

    /// Curvature and negative gradient of the misfit by what is common, where each object's own factor follows (Schur's
    /// complement).
    fn common_demand(&self, demands: &[Demand], prior: &Prior) -> ([Common; 4], Common) {
        let Prior { expected, precision } = prior;
        let mut downhill: Common = std::array::from_fn(|i| -precision[i] * (self.common[i] - expected[i]));
        let mut curvature = [[0.0; 4]; 4];
        for (i, row) in curvature.iter_mut().enumerate() {
            row[i] = precision[i];
        }
        for demand in demands {
            let share = demand.mixed.map(|mixed| mixed / demand.curvature);
            for (i, row) in curvature.iter_mut().enumerate() {
                downhill[i] -= demand.common_gradient[i] - share[i] * demand.gradient;
                for (cell, (asked, mixed)) in row.iter_mut().zip(demand.common_curvature[i].iter().zip(demand.mixed)) {
                    *cell += asked - share[i] * mixed;
                }
            }
        }
        (curvature, downhill)
    }

    fn descend(&mut self, demands: &[Demand], step: &Common) {
        for (value, step) in self.common.iter_mut().zip(step) {
            *value += step;
        }
        for (log, demand) in self.logs.iter_mut().zip(demands) {
            *log -= (demand.gradient + dot(&demand.mixed, step)) / demand.curvature;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Box2d, Box3d, Dimensions, ObjectClass};

    /// Nothing is shared.
    const ALONE: ScalePrior = ScalePrior { factor: 1.0, log_sigma: 0.0 };

    /// A car whose distance is told `factor` times too large, give or take `sigma`, on a road that falls by `slope`,
    /// 1.6 m below the camera.
    fn car(x: f64, z: f64, slope: f64, factor: f64, sigma: f64) -> Detection {
        let dimensions = Dimensions { height: 1.5, width: 1.6, length: 3.9 };
        let box3d = Box3d { dimensions, location: [x, 1.6 - slope * z, z], yaw: 0.2 }.scaled(factor);
        let box2d = Box2d::new(0.0, 0.0, 50.0, 40.0);
        let range_sigma_m = Some(sigma * box3d.depth_m());
        Detection { class: ObjectClass::Car, score: 0.9, box2d, box3d, range_sigma_m }
    }

    #[test]
    fn on_a_plane_wrong_distances_come_right_the_more_the_better_its_height_is_known() {
        for slope in [-0.01, 0.0, 0.015] {
            let factors = [1.06, 0.95, 1.04, 0.97, 1.05, 0.94];
            let places = [[-3.0, 9.0], [3.2, 12.0], [-3.1, 17.0], [0.1, 22.0], [3.0, 28.0], [-3.3, 36.0]];
            let told = || places.iter().zip(factors).map(|(&[x, z], factor)| car(x, z, slope, factor, 0.05)).collect();
            let error = |detection: &Detection, z: f64| (detection.box3d.depth_m() / z).ln().abs();
            let before: f64 = factors.iter().map(|factor: &f64| factor.ln().abs()).sum();
            for (road, most) in [(Road::BelowBy(1.6), 0.7), (Road::Below, 0.85)] {
                let found = fit_to_road(told(), road, &ALONE);
                let after: f64 = found.iter().zip(places).map(|(detection, [_, z])| error(detection, z)).sum();
                assert!(after < most * before, "errors of {before} became {after} with a slope of {slope} by {road:?}");
                for (detection, [x, z]) in found.iter().zip(places) {
                    let location = detection.box3d.location;
                    assert!((location[0] / location[2] - x / z).abs() < 1e-12, "moved off its ray");
                    let sigma = detection.range_sigma_m.unwrap() / detection.box3d.depth_m();
                    assert!(sigma > 0.005 && sigma < 0.05, "{sigma} at {z} m");
                }
            }
            assert_eq!(fit_to_road(told(), Road::Ignored, &ALONE), told());
        }
    }

    /// What the fit makes small: squares of the errors in standard deviations, but for those off the plane, which
    /// spread as Cauchy's distribution does.
    fn misfit(fit: &Fit, contacts: &[GroundContact], height: [f64; 2], scale: &ScalePrior) -> f64 {
        let [slope, above, tilt, shared] = fit.common;
        let plane = (slope / SLOPE).powi(2) + ((above - height[0]) / height[1]).powi(2) + (tilt / TILT).powi(2);
        let usual = plane + (shared / scale.log_sigma).powi(2);
        let each = contacts.iter().zip(&fit.logs).map(|(contact, log)| {
            let (off, sigma) = contact.off(&fit.common, log.exp());
            let own = log - if contact.is_scaled { shared } else { 0.0 };
            (own / contact.sigma).powi(2) + ODD.powi(2) * (off / sigma / ODD).powi(2).ln_1p()
        });
        usual + each.sum::<f64>()
    }

    #[test]
    fn no_other_plane_and_factors_nearby_are_likelier() {
        let factors = [1.06, 0.95, 1.04, 0.97, 1.3];
        let places = [[-3.0, 9.0], [3.2, 12.0], [-3.1, 17.0], [0.1, 22.0], [3.0, 28.0]];
        let cars = places.iter().zip(factors).map(|(&[x, z], factor)| car(x, z, 0.01, factor, 0.05));
        let mut objects: Vec<Detection> = cars.collect();
        objects[1].class = ObjectClass::Pedestrian;
        let scale = ScalePrior { factor: 1.0, log_sigma: 0.06 };
        let contacts: Vec<GroundContact> =
            objects.iter().filter_map(|object| GroundContact::of(object, &scale)).collect();
        for height in [Road::Below, Road::BelowBy(1.6)].map(|road| road.height().unwrap()) {
            let fit = Fit::of(&contacts, &Prior::new(height, &scale)).unwrap();
            let least = misfit(&fit, &contacts, height, &scale);
            for step in [-1e-3, 1e-3] {
                for place in 0..4 + contacts.len() {
                    let mut other = Fit { common: fit.common, logs: fit.logs.clone() };
                    *other.common.iter_mut().chain(&mut other.logs).nth(place).unwrap() += step;
                    let worse = misfit(&other, &contacts, height, &scale);
                    assert!(worse > least, "{worse} is less than {least} when {place} moves by {step}");
                }
            }
        }
    }

    /// Ten cars in two rows, all told `factor` times too far, each with an error bar of its own of 5%.
    fn ten_cars(factor: f64) -> Vec<Detection> {
        let places = (0..10).map(|place| [if place % 2 == 0 { -3.0 } else { 3.0 }, 8.0 + 4.0 * f64::from(place)]);
        places.map(|[x, z]| car(x, z, 0.0, factor, 0.05)).collect()
    }

    /// Mean error of [`ten_cars`] after the fit, and mean error bar: both of the logarithm.
    fn ten_after(factor: f64, road: Road, scale: &ScalePrior) -> [f64; 2] {
        let found = fit_to_road(ten_cars(factor), road, scale);
        let mean = |value: &dyn Fn(usize) -> f64| (0..10).map(value).sum::<f64>() / 10.0;
        let error = |place: usize| (found[place].box3d.depth_m() / (8.0 + 4.0 * place as f64)).ln();
        let sigma = |place: usize| found[place].range_sigma_m.unwrap() / found[place].box3d.depth_m();
        [mean(&error), mean(&sigma)]
    }

    #[test]
    fn ten_cars_that_agree_do_not_outvote_a_tape_measure() {
        let shared = ScalePrior { factor: 1.0, log_sigma: 0.06 };
        let [alone, _] = ten_after(0.88, Road::BelowBy(1.6), &ALONE);
        let [error, sigma] = ten_after(0.88, Road::BelowBy(1.6), &shared);
        assert!(error.abs() < 0.6 * alone.abs(), "{error}, independent {alone}");
        assert!(error.abs() < 2.0 * sigma && sigma < 0.065, "{error} give or take {sigma}");
    }

    #[test]
    fn ten_cars_that_agree_are_as_unsure_of_what_they_share_as_one() {
        let shared = ScalePrior { factor: 1.0, log_sigma: 0.06 };
        for road in [Road::Ignored, Road::Below] {
            let [error, sigma] = ten_after(1.0, road, &shared);
            assert!(error.abs() < 0.01, "{error} by {road:?}");
            assert!(sigma > 0.055 && sigma < 0.0785, "{sigma} by {road:?}");
        }
        let [_, alone] = ten_after(1.0, Road::Below, &ALONE);
        assert!(alone < 0.05, "{alone}");
    }

    #[test]
    fn a_factor_that_is_known_moves_vehicles_only() {
        let smaller = ScalePrior { factor: 0.95, log_sigma: 0.0 };
        let mut seen = vec![car(2.0, 15.0, 0.0, 1.0, 0.05); 2];
        seen[1].class = ObjectClass::Pedestrian;
        let found = fit_to_road(seen.clone(), Road::Ignored, &smaller);
        assert!((found[0].box3d.depth_m() - 0.95 * 15.0).abs() < 1e-9);
        assert!((found[0].range_sigma_m.unwrap() - 0.05 * 0.95 * 15.0).abs() < 1e-9);
        assert_eq!(found[1], seen[1]);
    }

    #[test]
    fn unsure_vehicles_follow_what_the_sure_ones_tell_of_the_common_factor() {
        let shared = ScalePrior { factor: 1.0, log_sigma: 0.06 };
        let guess = Detection { score: 0.2, ..car(1.0, 30.0, 0.0, 0.88, 0.05) };
        let found = fit_to_road([ten_cars(0.88), vec![guess]].concat(), Road::BelowBy(1.6), &shared);
        let error = (found[10].box3d.depth_m() / 30.0).ln();
        assert!(error.abs() < 0.6 * 0.88_f64.ln().abs(), "{error}");
    }

    #[test]
    fn a_camera_over_the_road_that_looks_down_needs_no_height() {
        let (slope, height_m) = (0.364, 6.4);
        let factors = [1.06, 0.95, 1.04, 0.97, 1.05, 0.94];
        let depths = [12.0, 15.0, 19.0, 24.0, 30.0, 38.0];
        let seen = |(z, factor): (f64, f64)| {
            let mut seen = car(z / 4.0 - 5.0, z, slope, factor, 0.05);
            seen.box3d.location[1] += factor * (height_m - 1.6);
            seen
        };
        let found = fit_to_road(depths.into_iter().zip(factors).map(seen).collect(), Road::Below, &ALONE);
        let before: f64 = factors.iter().map(|factor: &f64| factor.ln().abs()).sum();
        let after: f64 = found.iter().zip(depths).map(|(object, z)| (object.box3d.depth_m() / z).ln().abs()).sum();
        assert!(after < 0.85 * before, "errors of {before} became {after}");
    }

    #[test]
    fn at_an_unknown_height_one_object_alone_hardly_moves() {
        for height_m in [1.2, 2.5, 6.0] {
            let mut alone = car(2.0, 15.0, 0.0, 1.0, 0.05);
            alone.box3d.location[1] = height_m;
            let found = fit_to_road(vec![alone], Road::Below, &ALONE);
            assert!((found[0].box3d.depth_m() / 15.0).ln().abs() < 0.005, "{height_m}: {:?}", found[0].box3d);
        }
    }

    #[test]
    fn what_is_right_stays_and_what_is_sure_moves_least() {
        let right = vec![car(-3.0, 9.0, 0.0, 1.0, 0.05), car(3.0, 20.0, 0.0, 1.0, 0.05)];
        for (before, after) in right.iter().zip(fit_to_road(right.clone(), Road::BelowBy(1.6), &ALONE)) {
            assert!((before.box3d.depth_m() - after.box3d.depth_m()).abs() < 1e-6);
        }
        let moved = |sigma: f64| {
            let found = fit_to_road(vec![car(2.0, 15.0, 0.0, 1.1, sigma)], Road::BelowBy(1.6), &ALONE);
            (found[0].box3d.depth_m() / 16.5).ln().abs()
        };
        assert!(moved(0.01) < 0.3 * moved(0.1), "{} and {}", moved(0.01), moved(0.1));
    }

    #[test]
    fn what_stands_elsewhere_or_is_no_more_than_a_guess_bends_no_road() {
        let street =
            || vec![car(-3.0, 9.0, 0.0, 1.0, 0.05), car(3.0, 15.0, 0.0, 1.0, 0.05), car(0.0, 25.0, 0.0, 1.0, 0.05)];
        let mut on_a_bridge = car(4.0, 20.0, 0.0, 1.0, 0.05);
        on_a_bridge.box3d.location[1] = -4.0;
        let mut guess = car(4.0, 20.0, 0.0, 1.4, 0.05);
        guess.score = 0.2;
        for (odd, most) in [(on_a_bridge, 0.02), (guess, 1e-6)] {
            let found = fit_to_road([street(), vec![odd]].concat(), Road::BelowBy(1.6), &ALONE);
            for (detection, z) in found.iter().zip([9.0, 15.0, 25.0]) {
                let off = (detection.box3d.depth_m() / z).ln().abs();
                assert!(off < most, "{off} at {z} m");
            }
        }
    }

    #[test]
    fn without_error_bars_nothing_moves() {
        let unsure = Detection { range_sigma_m: None, ..car(2.0, 15.0, 0.0, 1.1, 0.05) };
        assert_eq!(fit_to_road(vec![unsure.clone()], Road::BelowBy(1.6), &ALONE), vec![unsure]);
        assert_eq!(fit_to_road(Vec::new(), Road::BelowBy(1.6), &ALONE), Vec::new());
    }
}
