//! Label files of KITTI's tracking benchmark rebuilt: the labelled objects where they are in each frame, in a random
//! street through which the camera drives as it did.

use std::collections::BTreeMap;

use farsight_core::{Camera, Label, ObjectClass};

use super::camera::EgoStep;
use super::frame::{Body, Placement};
use super::mover::Moment;
use super::{SEQUENCE_STREAM, Sequence, Step};
use crate::generator::builder::SceneBuilder;
use crate::generator::ground::Ground;
use crate::generator::light::Light;
use crate::generator::plan::{Plan, RoadEstimate};
use crate::generator::view::View;
use crate::generator::{SceneConfig, build_surroundings, textures};
use crate::layout::{estimated_road, fitted_ground, sightline};
use crate::region::Participant;
use crate::rng::{SENSOR_STREAM, SceneRng};
use crate::sensor::{Device, SensorModel};

/// Brake lamps are lit from this deceleration on, m/s², over so many frames.
const BRAKE_LAMPS_MPS2: f64 = 1.0;
const BRAKE_FRAMES: usize = 2;

/// Who moves faster than this over the ground, m/s, drives.
const MOVING_MPS: f64 = 1.0;

/// The scenery's look at an object is kept free from places along the way that are so far apart, metres.
const STATION_M: usize = 4;

/// The camera and the labels of a sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct SequenceLayout {
    /// The labels of each frame with their identities, in the coordinates of `camera`.
    pub frames: Vec<Vec<(u32, Label)>>,
    /// Speed ahead, m/s, and yaw rate to the left, rad/s, of the camera in each frame; empty for a camera that stands.
    pub motion: Vec<[f64; 2]>,
    /// Frames a second, above 0.
    pub fps: f64,
    /// The same in all frames.
    pub camera: Camera,
    /// Width and height, pixels.
    pub image_size: [usize; 2],
}

/// A sequence rebuilt in a street drawn from `seed`: [`SequenceStream::twin`](super::SequenceStream::twin).
pub(super) fn sequence_from_labels(config: &SceneConfig, layout: &SequenceLayout, seed: u64) -> Sequence {
    let mut rng = SceneRng::new(seed, 0, SEQUENCE_STREAM);
    let region = config.regions.sample(&mut rng);
    let first: Vec<&Label> =
        layout.frames.first().into_iter().flatten().map(|(_, label)| label).filter(|label| is_object(label)).collect();
    let ground = Ground { across: 0.0, along: 0.0, bend: 0.0, twist: 0.0, ..fitted_ground(&first) };
    let egos = ego_steps(layout);
    let steps: Vec<(EgoStep, Placement)> =
        egos.into_iter().map(|ego| (ego, Placement::new(ego.point, 0.0, ego.heading))).collect();
    let tracks = tracks(layout, &steps);

    let device = config.cameras.first().map_or(Device::Any, |camera| camera.device);
    let mut view = View::new(layout.camera, layout.image_size, ground.at_camera, 0.0);
    view.device = device;
    let unusual = rng.chance(config.unusual_share);
    let weather = rng.weighted(&config.weather.table());
    let mut light = Light::of(weather, config, unusual, [seed, 0], &mut rng);
    // As in other sequences.
    light.sun.canopy = None;
    let road = road(layout, &tracks);
    let view = view.travelling(road.bends.len() as f64);
    let plan = Plan::around(&road, region, &mut rng);
    let mut builder = SceneBuilder::new(view, ground, light, unusual, region);
    builder.stations = (0..=road.bends.len()).step_by(STATION_M).map(|s| plan.main.path.at(s as f64).point).collect();
    builder.sightlines.extend(first.iter().filter_map(|label| sightline(label)));
    let mut bodies = Vec::new();
    for track in tracks.values() {
        let Track { label, moments } = track;
        let size = label.box3d.dimensions;
        let kind = region.and_then(|region| region.kind_of(&label.class, size, &mut rng));
        let who = Participant { class: label.class.clone(), size, kind };
        let moves = moments.iter().flatten().any(|moment| moment.velocity[0].hypot(moment.velocity[1]) > MOVING_MPS);
        let lights_on = moves && rng.chance(builder.light.lights_share);
        let distance = |(moment, (ego, _)): (&Option<Moment>, &(EgoStep, Placement))| {
            let [x, _, z] = moment.as_ref()?.box3d.location;
            Some((x - ego.point[0]).hypot(z - ego.point[1]))
        };
        let nearest_m = moments.iter().zip(&steps).filter_map(distance).fold(f64::INFINITY, f64::min);
        bodies.push(Body::build(&who, lights_on, nearest_m, &mut builder, rng.fork()));
    }
    let distracting = rng.chance(config.distractor_share);
    build_surroundings(&mut builder, &plan, distracting, config.clutter, &mut rng);
    let mut street = builder.finish();
    if rng.chance(config.textured_share) {
        textures::spread(&mut street.scene.materials, &mut rng);
    }
    let sensor = &mut SceneRng::new(seed, 0, SENSOR_STREAM);
    let mut sensor = SensorModel::sample_of(street.scene.device, &street.scene.atmosphere, sensor.inner());
    sensor.motion_px = [0.0; 2];
    let ids = tracks.keys().copied().collect();
    let steps = steps
        .into_iter()
        .enumerate()
        .map(|(frame, (ego, _))| Step { ego, movers: tracks.values().map(|track| track.moments[frame]).collect() })
        .collect();
    Sequence {
        street,
        ground,
        bodies,
        ids,
        steps,
        sensor,
        fps: layout.fps,
        readout_s: config.readout_s,
        is_mirrored: false,
    }
}

fn is_object(label: &Label) -> bool {
    label.class != ObjectClass::DontCare
}

/// Where the camera is in each frame.
fn ego_steps(layout: &SequenceLayout) -> Vec<EgoStep> {
    let dt_s = 1.0 / layout.fps;
    let motion = |frame: usize| {
        let last = layout.motion.len().saturating_sub(1);
        layout.motion.get(frame.min(last)).copied().unwrap_or([0.0; 2])
    };
    let (mut point, mut heading) = ([0.0; 2], 0.0);
    (0..layout.frames.len())
        .map(|frame| {
            if frame > 0 {
                let [before, now] = [motion(frame - 1), motion(frame)];
                let [speed, yaw_rate] = [0, 1].map(|k| f64::midpoint(before[k], now[k]));
                let middle = heading - yaw_rate * dt_s / 2.0;
                point = [point[0] + speed * dt_s * libm::sin(middle), point[1] + speed * dt_s * libm::cos(middle)];
                heading -= yaw_rate * dt_s;
            }
            let [speed_mps, yaw_rate] = motion(frame);
            let [next, _] = motion(frame + 1);
            EgoStep {
                point,
                heading,
                speed_mps,
                velocity: [speed_mps * libm::sin(heading), speed_mps * libm::cos(heading)],
                yaw_rate,
                acceleration_mps2: (next - speed_mps) / dt_s,
                pitch: 0.0,
                roll: 0.0,
                nod_rates: [0.0; 2],
            }
        })
        .collect()
}

/// Somebody who is labelled.
struct Track {
    /// The first label.
    label: Label,
    /// In each frame.
    moments: Vec<Option<Moment>>,
}

/// Everybody in the street's coordinates, by their identities.
fn tracks(layout: &SequenceLayout, steps: &[(EgoStep, Placement)]) -> BTreeMap<u32, Track> {
    let mut tracks: BTreeMap<u32, Track> = BTreeMap::new();
    for (frame, (labels, (_, placement))) in layout.frames.iter().zip(steps).enumerate() {
        for (id, label) in labels.iter().filter(|(_, label)| is_object(label)) {
            let track = tracks
                .entry(*id)
                .or_insert_with(|| Track { label: label.clone(), moments: vec![None; layout.frames.len()] });
            let box3d = farsight_core::Box3d { dimensions: track.label.box3d.dimensions, ..label.box3d };
            let box3d = placement.street_box(&box3d);
            track.moments[frame] = Some(Moment { box3d, velocity: [0.0; 2], is_braking: false, gone_m: 0.0 });
        }
    }
    for track in tracks.values_mut() {
        set_motion(&mut track.moments, layout.fps);
    }
    tracks
}

/// Velocities, brake lamps and ways from the places.
fn set_motion(moments: &mut [Option<Moment>], fps: f64) {
    let places: Vec<Option<[f64; 2]>> =
        moments.iter().map(|moment| moment.map(|m| [m.box3d.location[0], m.box3d.location[2]])).collect();
    let place = |frame: Option<usize>| frame.and_then(|frame| *places.get(frame)?);
    let velocity = |frame: usize| {
        let now = place(Some(frame))?;
        let (before, after) = (place(frame.checked_sub(1)), place(Some(frame + 1)));
        let frames = f64::from(u8::from(before.is_some()) + u8::from(after.is_some())).max(1.0);
        let (before, after) = (before.unwrap_or(now), after.unwrap_or(now));
        Some([0, 1].map(|axis| (after[axis] - before[axis]) * fps / frames))
    };
    let velocities: Vec<Option<[f64; 2]>> = (0..moments.len()).map(velocity).collect();
    let speed = |frame: Option<usize>| frame.and_then(|frame| *velocities.get(frame)?).map(|[x, z]| x.hypot(z));
    let mut gone_m = 0.0;
    for (frame, moment) in moments.iter_mut().enumerate() {
        let Some(moment) = moment else { continue };
        let slower = speed(frame.checked_sub(BRAKE_FRAMES)).zip(speed(Some(frame + BRAKE_FRAMES)));
        let braking = slower.map_or(0.0, |(before, after)| (before - after) * fps / (2 * BRAKE_FRAMES) as f64);
        moment.velocity = velocities[frame].unwrap_or_default();
        moment.is_braking = braking > BRAKE_LAMPS_MPS2;
        moment.gone_m = gone_m;
        gone_m += moment.velocity[0].hypot(moment.velocity[1]) / fps;
    }
}

/// What labels and way say of the road.
fn road(layout: &SequenceLayout, tracks: &BTreeMap<u32, Track>) -> RoadEstimate {
    let first_place = |track: &Track| {
        let moment = track.moments.iter().flatten().next()?;
        Some(Label { box3d: moment.box3d, ..track.label.clone() })
    };
    let labels: Vec<Label> = tracks.values().filter_map(first_place).collect();
    let road = estimated_road(&labels.iter().collect::<Vec<_>>());
    let mut bends = Vec::new();
    let mut way_m = 0.0;
    for [speed, yaw_rate] in &layout.motion {
        way_m += speed.max(0.0) / layout.fps;
        let bend = if *speed > MOVING_MPS { (-yaw_rate / speed).clamp(-MAX_BEND, MAX_BEND) } else { 0.0 };
        bends.resize(way_m as usize, bend);
    }
    // The camera's own way tells the direction where it drives.
    let turn = if bends.is_empty() { road.turn } else { 0.0 };
    RoadEstimate { turn, bends, ..road }
}

/// Streets bend no more, 1/m.
const MAX_BEND: f64 = 0.1;

#[cfg(test)]
mod tests {
    use farsight_core::{Box2d, Box3d, Dimensions};

    use super::*;

    fn label(x: f64, z: f64) -> Label {
        let dimensions = Dimensions { height: 1.5, width: 1.7, length: 4.2 };
        let box3d = Box3d { dimensions, location: [x, 1.65, z], yaw: -std::f64::consts::FRAC_PI_2 };
        Label {
            class: ObjectClass::Car,
            truncation: 0.0,
            occlusion: 0,
            alpha: box3d.alpha(),
            box2d: Box2d::new(0.0, 0.0, 1.0, 1.0),
            box3d,
        }
    }

    fn layout(motion: Vec<[f64; 2]>) -> SequenceLayout {
        // 7 stands at the roadside, 3 drives ahead as fast as the camera and is not there at first.
        let frames = (0..6)
            .map(|frame| {
                let gone = f64::from(frame);
                let mut labels = vec![(7, label(4.0, 20.0 - gone))];
                if frame > 1 {
                    labels.push((3, label(0.0, 15.0)));
                }
                labels
            })
            .collect();
        let camera = Camera::from_intrinsics(360.0, 360.0, 310.0, 90.0).unwrap();
        SequenceLayout { frames, motion, fps: 10.0, camera, image_size: [620, 188] }
    }

    #[test]
    fn labels_come_back_with_their_identities_places_and_velocities() {
        let sequence = sequence_from_labels(&SceneConfig::default(), &layout(vec![[10.0, 0.0]; 6]), 5);
        assert_eq!(sequence.len(), 6);
        for number in [0, 3] {
            let frame = sequence.frame(number);
            let mut found: Vec<_> = frame.tracks.iter().map(|t| (t.id, t.label.box3d.location, t.speed_mps)).collect();
            found.sort_by_key(|(id, ..)| *id);
            let gone = number as f64;
            let mut expected = vec![(7, [4.0, 1.65, 20.0 - gone], 0.0)];
            if number > 1 {
                expected.insert(0, (3, [0.0, 1.65, 15.0], 10.0));
            }
            assert_eq!(found.len(), expected.len(), "{found:?}");
            for ((id, place, speed), (expected_id, expected_place, expected_speed)) in found.into_iter().zip(expected) {
                assert_eq!(id, expected_id);
                assert!((0..3).all(|k| (place[k] - expected_place[k]).abs() < 1e-9), "{place:?}");
                assert!((speed - expected_speed).abs() < 1e-6, "{speed}");
            }
        }
    }

    #[test]
    fn a_camera_that_turns_left_goes_left() {
        let steps = ego_steps(&layout(vec![[10.0, 0.5]; 6]));
        let last = steps[5];
        assert!((last.heading + 0.25).abs() < 1e-12);
        // A circle of 20 m.
        let expected = [20.0 * (f64::cos(0.25) - 1.0), 20.0 * f64::sin(0.25)];
        assert!((0..2).all(|k| (last.point[k] - expected[k]).abs() < 0.01), "{last:?}");
    }

    #[test]
    fn nobody_and_nothing_is_a_street_all_the_same() {
        let empty = SequenceLayout { frames: vec![Vec::new(); 2], motion: Vec::new(), ..layout(Vec::new()) };
        let sequence = sequence_from_labels(&SceneConfig::default(), &empty, 1);
        assert_eq!(sequence.frame(1).tracks, []);
    }
}
