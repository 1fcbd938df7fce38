//! One road under all: from where things stand a camera sees how far away they are.
//!
//! An image shows a car's direction and shape, not its size, so each object's distance is unsure by a factor of its own. But objects of one image stand on
//! one road, roughly a plane, so each has a say in where the others are; and where the camera's height above the road is known, that has, too. Plane and
//! factors are looked for together: the likeliest ones by the error bars of the distances, by where the boxes end below, and by how roads lie.

use crate::linear::{dot, solved};
use crate::{Detection, MeasuredDepth};

/// Detections with a lower score stay as they are and say nothing about the road: many are half hidden, and where they end below is a guess.
pub const SURE_SCORE: f64 = 0.5;

/// How far off the lower edge of a box is, as a tangent of the angle: two pixels of KITTI's images.
const EDGE_ERROR: f64 = 0.003;

/// How uneven roads are, metres, and how fast they leave their plane, metres per metre of distance.
const UNEVEN_M: f64 = 0.05;
const BENT: f64 = 0.003;

/// How well a height that somebody measured is known, metres.
const HEIGHT_ERROR_M: f64 = 0.05;

/// How high cameras are that nobody measured, and how far from that they may be, metres: in a car, on a truck, over a road.
const ANY_HEIGHT_M: f64 = 2.0;
const ANY_HEIGHT_ERROR_M: f64 = 2.0;

/// How the plane under a camera tips, standard deviations of its slope along the optical axis, which may look down, and across it.
const SLOPE: f64 = 0.5;
const TILT: f64 = 0.05;

/// At so many standard deviations off the plane an object counts half, farther off less and less: it may be no object, or stand on a bridge.
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
}

impl Road {
    /// Height of the camera and its standard deviation, metres.
    fn height(self) -> Option<[f64; 2]> {
        match self {
            Self::Ignored => None,
            Self::Below => Some([ANY_HEIGHT_M, ANY_HEIGHT_ERROR_M]),
            Self::BelowBy(height_m) => Some([height_m, HEIGHT_ERROR_M]),
        }
    }
}

/// The plane `y + slope z + tilt x = height` in camera coordinates, metres: slope, height, tilt.
type Plane = [f64; 3];

/// What is known of one object.
#[derive(Debug, Clone, Copy)]
struct Stand {
    /// The middle of its lower face, camera coordinates, metres.
    foot: [f64; 3],
    /// Standard deviation of the logarithm of its distance.
    sigma: f64,
}

impl Stand {
    /// Of a sure detection with an error bar.
    fn of(detection: &Detection) -> Option<Self> {
        let foot = detection.box3d.location;
        let sigma = detection.range_sigma_m? / detection.box3d.depth_m();
        let is_usable = detection.score > SURE_SCORE && sigma.is_finite() && sigma > 0.0;
        is_usable.then_some(Self { foot, sigma })
    }

    /// How far, metres, it stands off the plane when it is `factor` times as far away, and how much that may be by boxes and roads.
    fn off(&self, plane: &Plane, factor: f64) -> (f64, f64) {
        let [x, y, z] = self.foot;
        let [slope, height, tilt] = *plane;
        let off = factor * (y + slope * z + tilt * x) - height;
        let variance = (EDGE_ERROR * z).powi(2) + UNEVEN_M.powi(2) + (BENT * z).powi(2);
        (off, variance.sqrt())
    }

    /// What it asks for: gradient and curvature of the misfit by the logarithm of its factor and by the plane, at these.
    fn demand(&self, plane: &Plane, log: f64) -> Demand {
        let factor = log.exp();
        let (off, sigma) = self.off(plane, factor);
        let weight = 1.0 / (sigma * sigma * (1.0 + (off / sigma / ODD).powi(2)));
        let [x, _, z] = self.foot;
        let by_log = off + plane[1];
        let by_plane = [factor * z, -1.0, factor * x];
        let precision = 1.0 / (self.sigma * self.sigma);
        Demand {
            gradient: weight * off * by_log + precision * log,
            curvature: weight * by_log * by_log + precision,
            mixed: by_plane.map(|v| weight * v * by_log),
            plane_gradient: by_plane.map(|v| weight * v * off),
            plane_curvature: by_plane.map(|a| by_plane.map(|b| weight * a * b)),
        }
    }
}

/// Gradient and curvature of an object's misfit.
struct Demand {
    gradient: f64,
    curvature: f64,
    mixed: [f64; 3],
    plane_gradient: [f64; 3],
    plane_curvature: [[f64; 3]; 3],
}

/// `detections` of one image where they stand on one `road` best; unsure ones and those without error bars stay.
///
/// Each box is moved along its rays and grows with the distance, so the picture stays the same. Error bars shrink by what the plane tells.
pub fn on_one_road(mut detections: Vec<Detection>, road: Road) -> Vec<Detection> {
    let Some(height) = road.height() else { return detections };
    let stands: Vec<Option<Stand>> = detections.iter().map(Stand::of).collect();
    let known: Vec<Stand> = stands.iter().copied().flatten().collect();
    let Some(found) = settled(&known, height) else { return detections };
    let moved = detections.iter_mut().zip(&stands).filter(|(_, stand)| stand.is_some());
    for ((detection, _), [log, sigma]) in moved.zip(found) {
        let depth_m = detection.box3d.depth_m() * log.exp();
        detection.move_to(MeasuredDepth { depth_m, log_sigma: sigma });
    }
    detections
}

/// Logarithm of the factor of each object's distance and its standard deviation; none when the numbers are none.
fn settled(stands: &[Stand], height: [f64; 2]) -> Option<Vec<[f64; 2]>> {
    let fit = Fit::of(stands, height)?;
    let demands = fit.demands(stands);
    let (curvature, _) = fit.plane_demand(&demands, height);
    let sigma = |demand: &Demand| {
        let by_plane = dot(&demand.mixed, &solved(curvature, demand.mixed)?);
        Some((1.0 / demand.curvature + by_plane / (demand.curvature * demand.curvature)).sqrt())
    };
    let found = fit.logs.iter().zip(&demands).map(|(log, demand)| Some([*log, sigma(demand)?]));
    let found: Vec<[f64; 2]> = found.collect::<Option<_>>()?;
    found.iter().flatten().all(|number| number.is_finite()).then_some(found)
}

/// What is looked for.
struct Fit {
    plane: Plane,
    /// Logarithms of the factors of the distances.
    logs: Vec<f64>,
}

impl Fit {
    /// The likeliest plane and factors.
    fn of(stands: &[Stand], height: [f64; 2]) -> Option<Self> {
        let mut fit = Self { plane: [0.0, height[0], 0.0], logs: vec![0.0; stands.len()] };
        for _ in 0..STEPS {
            let demands = fit.demands(stands);
            let (curvature, downhill) = fit.plane_demand(&demands, height);
            fit.descend(&demands, &solved(curvature, downhill)?);
        }
        Some(fit)
    }

    fn demands(&self, stands: &[Stand]) -> Vec<Demand> {
        stands.iter().zip(&self.logs).map(|(stand, log)| stand.demand(&self.plane, *log)).collect()
    }

    /// Curvature and negative gradient of the misfit by the plane, where each object's own factor follows (Schur's complement).
    fn plane_demand(&self, demands: &[Demand], height: [f64; 2]) -> ([[f64; 3]; 3], [f64; 3]) {
        let expected = [0.0, height[0], 0.0];
        let precision = [SLOPE, height[1], TILT].map(|sigma| 1.0 / (sigma * sigma));
        let mut downhill: [f64; 3] = std::array::from_fn(|i| -precision[i] * (self.plane[i] - expected[i]));
        let mut curvature = [[0.0; 3]; 3];
        for (i, row) in curvature.iter_mut().enumerate() {
            row[i] = precision[i];
        }
        for demand in demands {
            let share = demand.mixed.map(|mixed| mixed / demand.curvature);
            for (i, row) in curvature.iter_mut().enumerate() {
                downhill[i] -= demand.plane_gradient[i] - share[i] * demand.gradient;
                for (cell, (asked, mixed)) in row.iter_mut().zip(demand.plane_curvature[i].iter().zip(demand.mixed)) {
                    *cell += asked - share[i] * mixed;
                }
            }
        }
        (curvature, downhill)
    }

    fn descend(&mut self, demands: &[Demand], step: &[f64; 3]) {
        for (value, step) in self.plane.iter_mut().zip(step) {
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

    /// A car whose distance is told `factor` times too large, give or take `sigma`, on a road that falls by `slope`, 1.6 m below the camera.
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
                let found = on_one_road(told(), road);
                let after: f64 = found.iter().zip(places).map(|(detection, [_, z])| error(detection, z)).sum();
                assert!(after < most * before, "errors of {before} became {after} with a slope of {slope} by {road:?}");
                for (detection, [x, z]) in found.iter().zip(places) {
                    let location = detection.box3d.location;
                    assert!((location[0] / location[2] - x / z).abs() < 1e-12, "moved off its ray");
                    let sigma = detection.range_sigma_m.unwrap() / detection.box3d.depth_m();
                    assert!(sigma > 0.005 && sigma < 0.05, "{sigma} at {z} m");
                }
            }
            assert_eq!(on_one_road(told(), Road::Ignored), told());
        }
    }

    /// What the fit makes small: squares of the errors in standard deviations, but for those off the plane, which spread as Cauchy's distribution does.
    fn misfit(fit: &Fit, stands: &[Stand], height: [f64; 2]) -> f64 {
        let [slope, above, tilt] = fit.plane;
        let usual = (slope / SLOPE).powi(2) + ((above - height[0]) / height[1]).powi(2) + (tilt / TILT).powi(2);
        let each = stands.iter().zip(&fit.logs).map(|(stand, log)| {
            let (off, sigma) = stand.off(&fit.plane, log.exp());
            (log / stand.sigma).powi(2) + ODD.powi(2) * (off / sigma / ODD).powi(2).ln_1p()
        });
        usual + each.sum::<f64>()
    }

    #[test]
    fn no_other_plane_and_factors_nearby_are_likelier() {
        let factors = [1.06, 0.95, 1.04, 0.97, 1.3];
        let places = [[-3.0, 9.0], [3.2, 12.0], [-3.1, 17.0], [0.1, 22.0], [3.0, 28.0]];
        let cars = places.iter().zip(factors).map(|(&[x, z], factor)| car(x, z, 0.01, factor, 0.05));
        let stands: Vec<Stand> = cars.filter_map(|car| Stand::of(&car)).collect();
        for height in [Road::Below, Road::BelowBy(1.6)].map(|road| road.height().unwrap()) {
            let fit = Fit::of(&stands, height).unwrap();
            let least = misfit(&fit, &stands, height);
            for step in [-1e-3, 1e-3] {
                for place in 0..3 + stands.len() {
                    let mut other = Fit { plane: fit.plane, logs: fit.logs.clone() };
                    *other.plane.iter_mut().chain(&mut other.logs).nth(place).unwrap() += step;
                    let worse = misfit(&other, &stands, height);
                    assert!(worse > least, "{worse} is less than {least} when {place} moves by {step}");
                }
            }
        }
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
        let found = on_one_road(depths.into_iter().zip(factors).map(seen).collect(), Road::Below);
        let before: f64 = factors.iter().map(|factor: &f64| factor.ln().abs()).sum();
        let after: f64 = found.iter().zip(depths).map(|(object, z)| (object.box3d.depth_m() / z).ln().abs()).sum();
        assert!(after < 0.85 * before, "errors of {before} became {after}");
    }

    #[test]
    fn at_an_unknown_height_one_object_alone_hardly_moves() {
        for height_m in [1.2, 2.5, 6.0] {
            let mut alone = car(2.0, 15.0, 0.0, 1.0, 0.05);
            alone.box3d.location[1] = height_m;
            let found = on_one_road(vec![alone], Road::Below);
            assert!((found[0].box3d.depth_m() / 15.0).ln().abs() < 0.005, "{height_m}: {:?}", found[0].box3d);
        }
    }

    #[test]
    fn what_is_right_stays_and_what_is_sure_moves_least() {
        let right = vec![car(-3.0, 9.0, 0.0, 1.0, 0.05), car(3.0, 20.0, 0.0, 1.0, 0.05)];
        for (before, after) in right.iter().zip(on_one_road(right.clone(), Road::BelowBy(1.6))) {
            assert!((before.box3d.depth_m() - after.box3d.depth_m()).abs() < 1e-6);
        }
        let moved = |sigma: f64| {
            let found = on_one_road(vec![car(2.0, 15.0, 0.0, 1.1, sigma)], Road::BelowBy(1.6));
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
            let found = on_one_road([street(), vec![odd]].concat(), Road::BelowBy(1.6));
            for (detection, z) in found.iter().zip([9.0, 15.0, 25.0]) {
                let off = (detection.box3d.depth_m() / z).ln().abs();
                assert!(off < most, "{off} at {z} m");
            }
        }
    }

    #[test]
    fn without_error_bars_nothing_moves() {
        let unsure = Detection { range_sigma_m: None, ..car(2.0, 15.0, 0.0, 1.1, 0.05) };
        assert_eq!(on_one_road(vec![unsure.clone()], Road::BelowBy(1.6)), vec![unsure]);
        assert_eq!(on_one_road(Vec::new(), Road::BelowBy(1.6)), Vec::new());
    }
}
