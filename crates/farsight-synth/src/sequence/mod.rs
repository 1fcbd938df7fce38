//! Scenes that move: traffic that follows, brakes, overtakes, turns and crosses, seen by a camera that drives along.
//!
//! [`SequenceStream`] draws sequences by number. A [`Sequence`] is the street with all that stands on it, built once,
//! and what moves in each frame; [`Sequence::frame`] puts the camera where it is then, and renders. Labels, velocities
//! and the camera's motion come from the simulation, so they are exact. The bytes depend on configuration, seed and
//! number alone.
//!
//! | module | what it is for |
//! |---|---|
//! | `mover` | somebody who moves along a path |
//! | `follow` | how drivers keep their distance |
//! | `traffic` | who is there, and what they do step by step |
//! | `camera` | the camera's car: way, pitch, roll |
//! | `layout` | label files of KITTI's tracking benchmark rebuilt |
//! | `frame` | a scene seen from where the camera is |
//! | `readout` | rows that are exposed one after the other |
//! | `unrendered` | the same without a picture |

mod camera;
mod follow;
mod frame;
mod layout;
mod mover;
mod readout;
mod traffic;
mod unrendered;

use std::f64::consts::FRAC_PI_2;

use farsight_core::{Camera, Label};
use image::RgbImage;

use crate::generator::builder::SceneBuilder;
use crate::generator::ground::Ground;
use crate::generator::light::Light;
use crate::generator::plan::Plan;
use crate::generator::traffic::Traffic as Standing;
use crate::generator::view::View;
use crate::generator::{SceneConfig, build_surroundings, textures};
use crate::rng::{SENSOR_STREAM, SceneRng, twin_seed};
use crate::scene::LabelledScene;
use crate::sensor::SensorModel;
use camera::EgoStep;
use frame::Body;
use layout::sequence_from_labels;
use traffic::Simulation;

pub use layout::SequenceLayout;
pub use unrendered::UnrenderedFrame;

/// The stream of draws of sequences; scenes, layouts, sensors and light have 0 to 3.
const SEQUENCE_STREAM: u64 = 4;

/// Random sequences of one seed, each there whenever it is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct SequenceStream {
    /// What the scenes look like and which cameras see them; without a [`problem`](SceneConfig::problem). Cameras look
    /// ahead from a vehicle: their `heading_deg` must be 0.
    pub config: SceneConfig,
    /// Which sequences.
    pub seed: u64,
    /// How many frames each has, at least 1.
    pub frames: usize,
    /// Frames a second, above 0.
    pub fps: f64,
}

/// One sequence.
pub struct Sequence {
    street: LabelledScene,
    ground: Ground,
    bodies: Vec<Body>,
    /// Identities of what stands in the street and of the bodies.
    ids: Vec<u32>,
    steps: Vec<Step>,
    sensor: SensorModel,
    fps: f64,
    /// From the first row's exposure to the last one's, seconds.
    readout_s: f64,
    is_mirrored: bool,
}

/// What moves in one frame.
struct Step {
    ego: EgoStep,
    /// Of each body; none who is not there (yet, or any more).
    movers: Vec<Option<mover::Moment>>,
}

/// A finished frame.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SequenceFrame {
    /// Its time, seconds; the first has 0. Where rows are exposed one after the other, all that is told is so at the
    /// middle row's time.
    pub time_s: f64,
    /// The picture.
    pub image: RgbImage,
    /// The camera as it is mounted: the same in all frames. Labels are in its coordinates, which pitch and roll with
    /// it.
    pub camera: Camera,
    /// Who the picture shows and a label file would hold, by their identities.
    pub tracks: Vec<TrackTruth>,
    /// Regions without labels.
    pub dont_care: Vec<Label>,
    /// How the camera moves.
    pub ego: EgoTruth,
}

/// Somebody in one frame.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct TrackTruth {
    /// Its identity, the same in all frames: from 0, or that of the label file.
    pub id: u32,
    /// What a label file says.
    pub label: Label,
    /// To the right, down and ahead, relative to the camera, in level axes that turn with it, m/s.
    pub velocity_mps: [f64; 3],
    /// Over the ground, m/s.
    pub speed_mps: f64,
}

/// The motion of the camera's car.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct EgoTruth {
    /// Where the camera is, x and z in level axes of the first frame, metres.
    pub position_m: [f64; 2],
    /// To the left of the first frame's direction, radians.
    pub yaw_rad: f64,
    /// Ahead, m/s.
    pub speed_mps: f64,
    /// To the left, rad/s.
    pub yaw_rate: f64,
    /// Ahead, m/s².
    pub acceleration_mps2: f64,
    /// Downwards, beside the angle at which the camera is mounted, radians.
    pub pitch_rad: f64,
    /// To the right side, beside the angle at which the camera is mounted, radians.
    pub roll_rad: f64,
}

impl SequenceStream {
    /// The labelled sequence `layout`, called `name`, rebuilt in a street of its own: the same camera on the same way,
    /// an object with the class and box of each label (`DontCare` left out) in each frame. An object keeps the size of
    /// its first label. How many frames there are, and how many a second, the layout says.
    ///
    /// The street is flat and bends as the camera's way does. Its scenery hides nothing that is labelled in the first
    /// frame.
    pub fn twin(&self, layout: &SequenceLayout, name: &str) -> Sequence {
        sequence_from_labels(&self.config, layout, twin_seed(self.seed, name))
    }

    /// Sequence number `index`.
    pub fn sequence(&self, index: u64) -> Sequence {
        let (config, seed) = (&self.config, self.seed);
        let mut rng = SceneRng::new(seed, index, SEQUENCE_STREAM);
        let region = config.regions.sample(&mut rng);
        let view = View::sample(&config.cameras, &mut rng);
        let place = rng.weighted(&config.places.table());
        let weather = rng.weighted(&config.weather.table());
        let unusual = rng.chance(config.unusual_share);
        let mut light = Light::of(weather, config, unusual, [seed, index], &mut rng);
        // Patches of sun are fixed to the camera's axes, in which they would move along with it.
        light.sun.canopy = None;
        let ground = Ground::sample(view.height_m, &mut rng);
        let left_hand = rng.chance(region.map_or(config.left_hand_share, |region| region.left_hand_share));
        // Traffic on the left is the mirror image of traffic on the right.
        let is_mirrored = left_hand;
        let view = if is_mirrored { view.mirrored() } else { view };
        let duration_s = self.frames as f64 / self.fps;
        let usual_mps = traffic::usual_speed_mps(place, &mut rng);
        let view = view.travelling(usual_mps * traffic::MAX_SPEED_SHARE * duration_s);
        let plan = Plan::sample(place, &view, region, false, &mut rng);
        let mut builder = SceneBuilder::new(view, ground, light, unusual, region);
        let reach = builder.view.travel_m as usize;
        builder.stations = (0..=reach).step_by(4).map(|s| plan.main.path.at(s as f64).point).collect();
        let density = rng.range(config.density[0], config.density[1]);
        let mut standing = Standing {
            builder: &mut builder,
            plan: &plan,
            density,
            people_density: density * config.people_factor,
            heavy_factor: config.heavy_factor,
            farthest_m: config.farthest_m + reach as f64,
            region,
            rng: rng.fork(),
        };
        let mut simulation = Simulation::new(&mut standing, usual_mps, duration_s, &mut rng.fork());
        standing.place_standing();
        let steps = simulation.run(self.frames, self.fps, &ground, &mut rng.fork());
        let bodies = simulation.bodies(&mut builder, &steps, &mut rng.fork());
        let distracting = rng.chance(config.distractor_share);
        build_surroundings(&mut builder, &plan, distracting, config.clutter, &mut rng);
        let mut street = builder.finish();
        if rng.chance(config.textured_share) {
            textures::spread(&mut street.scene.materials, &mut rng);
        }
        let sensor = &mut SceneRng::new(seed, index, SENSOR_STREAM);
        let mut sensor = SensorModel::sample_of(street.scene.device, &street.scene.atmosphere, sensor.inner());
        // Its path during the exposure would be another in each frame.
        sensor.motion_px = [0.0; 2];
        let ids = (0..(street.objects.len() + bodies.len()) as u32).collect();
        Sequence { street, ground, bodies, ids, steps, sensor, fps: self.fps, readout_s: config.readout_s, is_mirrored }
    }
}

impl Sequence {
    /// How many frames it has.
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// The height of the camera above the road at the first frame, metres.
    pub fn camera_height_m(&self) -> f64 {
        self.ground.at_camera
    }

    /// The camera's motion in a frame.
    fn ego(&self, step: &Step) -> EgoTruth {
        let EgoStep { point, heading, speed_mps, yaw_rate, acceleration_mps2, pitch, roll, .. } = step.ego;
        let side = if self.is_mirrored { -1.0 } else { 1.0 };
        let first = &self.steps[0].ego;
        let (sin, cos) = (libm::sin(first.heading), libm::cos(first.heading));
        let [x, z] = [point[0] - first.point[0], point[1] - first.point[1]];
        EgoTruth {
            position_m: [side * (x * cos - z * sin), x * sin + z * cos],
            yaw_rad: -side * farsight_core::wrapped_angle(heading - first.heading),
            speed_mps,
            yaw_rate: side * yaw_rate,
            acceleration_mps2,
            pitch_rad: pitch,
            roll_rad: side * roll,
        }
    }
}

/// Angle to the right of z of a direction (x, z) on the ground, radians.
fn heading([x, z]: [f64; 2]) -> f64 {
    libm::atan2(x, z)
}

/// The yaw of a box whose heading is so far to the right of z.
fn yaw_from_heading(heading: f64) -> f64 {
    farsight_core::wrapped_angle(heading - FRAC_PI_2)
}
