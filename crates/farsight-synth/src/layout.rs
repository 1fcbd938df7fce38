//! Real frames rebuilt: the labelled objects exactly where they are, in a random scene that hides them no more than
//! the label says.

use farsight_core::linear::{dot, solved};
use farsight_core::{Box3d, Camera, Label, ObjectClass};

use crate::generator::builder::{SceneBuilder, Sightline};
use crate::generator::ground::Ground;
use crate::generator::light::Light;
use crate::generator::plan::{Plan, RoadEstimate};
use crate::generator::view::View;
use crate::generator::{SceneConfig, build_surroundings, textures};
use crate::objects::ObjectState;
use crate::rng::{LAYOUT_STREAM, SceneRng};
use crate::scene::LabelledScene;
use crate::sensor::Device;

/// A camera that no label says anything about stands this high, metres (KITTI's).
const CAMERA_HEIGHT_M: f64 = 1.65;

/// Vehicles whose axis is less askew to the camera's than this lie along its road, radians.
const ALONG_ROAD_RAD: f64 = 0.45;

/// Rebuilds a frame in a world: the same camera, a labelled object with the class and box of each label (in their
/// order, `DontCare` left out), and a scene drawn from `seed` around them.
///
/// The ground is fitted to the bottoms of the boxes, and the road runs along the vehicles that stand along the
/// camera's direction. Houses, trees and posts are left out where they would hide a labelled object more than its
/// label says. Any labels will do, none too.
pub fn scene_from_labels(
    config: &SceneConfig,
    labels: &[Label],
    camera: &Camera,
    image_size: [usize; 2],
    seed: u64,
) -> LabelledScene {
    let objects: Vec<&Label> = labels.iter().filter(|label| label.class != ObjectClass::DontCare).collect();
    let mut rng = SceneRng::new(seed, 0, LAYOUT_STREAM);
    let region = config.regions.sample(&mut rng);
    let ground = fitted_ground(&objects);
    let device = config.cameras.first().map_or(Device::Any, |camera| camera.device);
    let mut view = View::new(*camera, image_size, ground.at_camera, 0.0);
    view.device = device;
    let unusual = rng.chance(config.unusual_share);
    let weather = rng.weighted(&config.weather.table());
    let light = Light::of(weather, config, unusual, [seed, 0], &mut rng);
    let plan = Plan::around(&estimated_road(&objects), region, &mut rng);
    let mut builder = SceneBuilder::new(view, ground, light, unusual, region);
    for label in &objects {
        builder.sightlines.extend(sightline(label));
    }
    for label in &objects {
        let moving = is_along(&label.box3d) && label.box3d.location[0].abs() < 4.0;
        let share = if moving { builder.light.lights_share } else { 0.03 };
        let state =
            ObjectState { lights_on: rng.chance(share), braking: moving && rng.chance(0.2), moving, stride: None };
        let mut rng = rng.fork();
        let Label { class, box3d, .. } = label;
        let kind = region.and_then(|region| region.kind_of(class, box3d.dimensions, &mut rng));
        builder.add_labelled(class.clone(), kind, *box3d, state, rng);
    }
    let distracting = rng.chance(config.distractor_share);
    build_surroundings(&mut builder, &plan, distracting, config.clutter, &mut rng);
    let mut generated = builder.finish();
    if rng.chance(config.textured_share) {
        textures::spread(&mut generated.scene.materials, &mut rng);
    }
    generated
}

/// What the vehicles say about the road.
pub(crate) fn estimated_road(objects: &[&Label]) -> RoadEstimate {
    let mut turns: Vec<f64> = Vec::new();
    let along: Vec<&Box3d> =
        objects.iter().map(|l| &l.box3d).filter(|b| b.dimensions.length > 2.5 && is_along(b)).collect();
    turns.extend(along.iter().map(|b| askew(b.yaw)));
    turns.sort_by(f64::total_cmp);
    // Half of them are straighter and half more askew; few vehicles say little.
    let trust = turns.len() as f64 / (turns.len() as f64 + 1.0);
    let turn = turns.get(turns.len() / 2).copied().unwrap_or(0.0).clamp(-0.25, 0.25) * trust;
    let offsets = along.iter().map(|b| {
        // To the right of the road's axis through the camera.
        b.location[0] * libm::cos(turn) - b.location[2] * libm::sin(turn)
    });
    let near: Vec<f64> = offsets.filter(|d| d.abs() < 13.0).collect();
    let left = near.iter().copied().fold(-3.2, f64::min) - 1.25;
    let right = near.iter().copied().fold(0.9, f64::max) + 1.25;
    let count = |class: ObjectClass| objects.iter().filter(|label| label.class == class).count();
    RoadEstimate {
        turn,
        edges: [left, right],
        people: count(ObjectClass::Pedestrian),
        vehicles: along.len(),
        bends: Vec::new(),
    }
}

/// Angle between an axis and straight ahead, radians in `(-pi/2, pi/2]`, positive to the right.
fn askew(yaw: f64) -> f64 {
    use std::f64::consts::{FRAC_PI_2, PI};
    let turn = farsight_core::wrapped_angle(yaw + FRAC_PI_2);
    if turn > FRAC_PI_2 {
        turn - PI
    } else if turn <= -FRAC_PI_2 {
        turn + PI
    } else {
        turn
    }
}

fn is_along(box3d: &Box3d) -> bool {
    askew(box3d.yaw).abs() < ALONG_ROAD_RAD
}

/// The part of the view of an object that must stay free.
pub(crate) fn sightline(label: &Label) -> Option<Sightline> {
    let kept = match label.occlusion {
        1 => 0.5,
        2 => 0.2,
        3 => 0.0,
        _ => 1.0,
    };
    let corners = label.box3d.corners();
    let ahead = corners.iter().filter(|c| c[2] > 0.5);
    let tangents: Vec<f64> = ahead.map(|c| c[0] / c[2]).collect();
    let low = tangents.iter().copied().fold(f64::INFINITY, f64::min);
    let high = tangents.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let farthest = corners.iter().map(|c| c[2]).fold(0.0, f64::max);
    let (middle, half) = (f64::midpoint(low, high), (high - low) / 2.0 * kept);
    (kept > 0.0 && high >= low).then_some(Sightline { tangents: [middle - half, middle + half], depth_m: farthest })
}

/// A ground through the bottoms of the boxes: least squares towards a flat one, weighted so that few strays do not
/// bend it (Huber 1964, by repeated weighting).
pub(crate) fn fitted_ground(objects: &[&Label]) -> Ground {
    // Deviations that the ground's parameters are expected to have, and the noise of a label's bottom, metres.
    const EXPECTED: [f64; 4] = [0.08, 0.02, 0.02, 2e-4];
    const NOISE_M: f64 = 0.1;
    let usable = |b: &Box3d| b.location.iter().all(|v| v.is_finite()) && b.location[2].abs() < 120.0;
    let points: Vec<[f64; 3]> = objects.iter().map(|l| l.box3d).filter(usable).map(|b| b.location).collect();
    let row = |[x, _, z]: [f64; 3]| [1.0, x.clamp(-70.0, 70.0), z, bent(z)];
    let mut solution = [0.0; 4];
    for _ in 0..6 {
        let (mut matrix, mut right) = ([[0.0; 4]; 4], [0.0; 4]);
        for (i, expected) in EXPECTED.into_iter().enumerate() {
            matrix[i][i] = (NOISE_M / expected) * (NOISE_M / expected);
        }
        for &point in &points {
            let terms = row(point);
            let above = point[1] - CAMERA_HEIGHT_M;
            let error: f64 = above - dot(&terms, &solution);
            let weight = (1.5 * NOISE_M / error.abs().max(1e-9)).min(1.0);
            for i in 0..4 {
                for j in 0..4 {
                    matrix[i][j] += weight * terms[i] * terms[j];
                }
                right[i] += weight * terms[i] * above;
            }
        }
        // The diagonal is never zero, so there is a solution.
        solution = solved(matrix, right).unwrap_or(solution);
    }
    let [rise, across, along, bend] = solution;
    Ground { at_camera: (CAMERA_HEIGHT_M + rise).clamp(0.8, 3.0), across, along, bend, twist: 0.0 }
}

/// The ground's bend at depth z, the term of `Ground`.
fn bent(z: f64) -> f64 {
    Ground { at_camera: 0.0, across: 0.0, along: 0.0, bend: 1.0, twist: 0.0 }.y([0.0, z])
}
