//! A scene seen from where the camera is.

use farsight_core::{Box3d, Label, ObjectClass};

use super::mover::Moment;
use super::readout::Readout;
use super::{Sequence, SequenceFrame, Step, TrackTruth};
use crate::generator::builder::{SceneBuilder, add_contact_shadow, has_contact_shadow, headlights};
use crate::generator::mirror::mirror;
use crate::generator::view::{tilted, turn};
use crate::labels::LabelRules;
use crate::mesh_builder::MeshBuilder;
use crate::objects::{self, Detail, ObjectState, STRIDE};
use crate::region::Participant;
use crate::render::render;
use crate::rng::SceneRng;
use crate::scene::{LabelledObject, LabelledScene, MaterialId, Mesh, Object, Vec3, Vertex};

/// Two steps of someone who is 1.7 m tall, metres.
const STRIDE_M: f64 = 1.45;
const STRIDE_HEIGHT_M: f64 = 1.7;

/// Frames of a sequence have noise of their own.
const NOISE_OF_FRAME: u64 = 0x9E37_79B9_7F4A_7C15;

/// The looks of somebody who moves.
pub(super) struct Body {
    class: ObjectClass,
    /// As they usually look; of people on foot, at each part of two steps.
    meshes: Vec<Mesh>,
    /// With its brake lamps lit.
    braking: Option<Mesh>,
    plate: Option<MaterialId>,
    contact_shadow: MaterialId,
    /// It lights the street.
    lights_on: bool,
}

impl Body {
    /// Builds the meshes of somebody who comes as near as `nearest_m` to the camera.
    pub(super) fn build(
        who: &Participant,
        has_lights_on: bool,
        nearest_m: f64,
        builder: &mut SceneBuilder,
        rng: SceneRng,
    ) -> Self {
        let detail = Detail::at(nearest_m, builder.view.focal_px());
        let Participant { class, size, kind } = who;
        let (size, kind) = (*size, *kind);
        let lights_on = builder.light.lamps_on && has_lights_on;
        let state = ObjectState { lights_on: has_lights_on, moving: true, ..ObjectState::default() };
        let mut plate = None;
        let mut braking = None;
        let first = builder.palette.materials.len();
        let meshes = if *class == ObjectClass::Pedestrian {
            objects::walker(size, |stride| {
                // The same draws make the same materials.
                builder.palette.materials.truncate(first);
                builder.mesh(class, None, size, detail, ObjectState { stride, ..state }, rng.clone()).0
            })
        } else {
            let (mesh, its_plate) = builder.mesh(class, kind, size, detail, state, rng.clone());
            plate = its_plate;
            if has_contact_shadow(class) {
                braking = Some(builder.mesh(class, kind, size, detail, ObjectState { braking: true, ..state }, rng).0);
            }
            vec![mesh]
        };
        Self { class: class.clone(), meshes, braking, plate, contact_shadow: builder.contact_shadow(), lights_on }
    }

    pub(super) fn class(&self) -> &ObjectClass {
        &self.class
    }

    /// The mesh of a moment.
    fn mesh(&self, moment: &Moment) -> &Mesh {
        if let (true, Some(mesh)) = (moment.is_braking, &self.braking) {
            return mesh;
        }
        let stride_m = STRIDE_M * moment.box3d.dimensions.height / STRIDE_HEIGHT_M;
        let part = (moment.gone_m / stride_m).fract() * f64::from(STRIDE);
        &self.meshes[(part as usize).min(self.meshes.len() - 1)]
    }
}

/// From the street's coordinates to level ones at the camera.
pub(super) struct Placement {
    sin: f64,
    cos: f64,
    heading: f64,
    origin: Vec3d,
}

type Vec3d = [f64; 3];

impl Placement {
    /// Of a camera at this point of the street, which lies `rise` lower than where the street begins, with a heading to
    /// the right of z.
    pub(super) fn new([x, z]: [f64; 2], rise: f64, heading: f64) -> Self {
        Self { sin: libm::sin(heading), cos: libm::cos(heading), heading, origin: [x, rise, z] }
    }

    /// A box at the camera in the street's coordinates.
    pub(super) fn street_box(&self, box3d: &Box3d) -> Box3d {
        let [x, y, z] = box3d.location;
        let [sin, cos] = [self.sin, self.cos];
        let turned = [x * cos + z * sin, y, z * cos - x * sin];
        let location = [0, 1, 2].map(|axis| turned[axis] + self.origin[axis]);
        Box3d { location, yaw: farsight_core::wrapped_angle(box3d.yaw + self.heading), ..*box3d }
    }

    fn point(&self, point: Vec3d) -> Vec3d {
        self.direction([0, 1, 2].map(|axis| point[axis] - self.origin[axis]))
    }

    fn direction(&self, [x, y, z]: Vec3d) -> Vec3d {
        [x * self.cos - z * self.sin, y, x * self.sin + z * self.cos]
    }

    pub(super) fn box3d(&self, box3d: &Box3d) -> Box3d {
        let yaw = farsight_core::wrapped_angle(box3d.yaw - self.heading);
        Box3d { location: self.point(box3d.location), yaw, ..*box3d }
    }

    fn narrow_point(&self, point: Vec3) -> Vec3 {
        self.point(point.map(f64::from)).map(|v| v as f32)
    }

    fn narrow_direction(&self, direction: Vec3) -> Vec3 {
        self.direction(direction.map(f64::from)).map(|v| v as f32)
    }
}

impl Sequence {
    pub(super) fn placement(&self, step: &Step) -> Placement {
        let rise = self.ground.y(step.ego.point) - self.ground.at_camera;
        Placement::new(step.ego.point, rise, step.ego.heading)
    }

    /// Frame number `index`, rendered and captured.
    ///
    /// # Panics
    /// When there are not so many.
    pub fn frame(&self, index: usize) -> SequenceFrame {
        let step = &self.steps[index];
        let (labelled, velocities) = self.scene(step);
        let LabelledScene { scene, objects } = &labelled;
        let rendered = render(scene);
        let mut sensor = self.sensor.clone();
        sensor.seed = sensor.seed.wrapping_add((index as u64 + 1).wrapping_mul(NOISE_OF_FRAME));
        let image = sensor.capture(&rendered);
        let ego = self.ego(step);
        let labels = LabelRules::for_width(scene.image_size[0]).labels(scene, objects, &rendered);
        let (mut tracks, mut dont_care) = (Vec::new(), Vec::new());
        for label in labels {
            let found = objects.iter().position(|object| object.box3d == label.box3d);
            match found.filter(|_| label.class != ObjectClass::DontCare) {
                Some(place) => {
                    let [velocity_mps, [speed_mps, ..]] = velocities[place];
                    let label = tilted_label(label, ego.pitch_rad, ego.roll_rad);
                    tracks.push(TrackTruth { id: self.ids[place], label, velocity_mps, speed_mps });
                }
                None => dont_care.push(label),
            }
        }
        let mut camera = self.street.scene.camera;
        if self.is_mirrored {
            camera = camera.mirrored(scene.image_size[0]);
        }
        SequenceFrame { time_s: index as f64 / self.fps, image, camera, tracks, dont_care, ego }
    }

    /// The scene of a frame, and of each object its velocity in the camera's level axes and its speed over the ground.
    ///
    /// Objects are in the same order in all frames: who is not there is far behind the camera. Boxes are those of the
    /// middle row's time; the meshes are where each row sees them.
    fn scene(&self, step: &Step) -> (LabelledScene, Vec<[Vec3d; 2]>) {
        let placement = self.placement(step);
        let mut labelled = self.street.clone();
        let LabelledScene { scene, objects } = &mut labelled;
        for vertex in scene.objects.iter_mut().flat_map(|object| &mut object.mesh.vertices) {
            vertex.position = placement.narrow_point(vertex.position);
            vertex.normal = placement.narrow_direction(vertex.normal);
        }
        scene.sun.direction = placement.narrow_direction(scene.sun.direction);
        for lamp in &mut scene.lamps {
            lamp.position = placement.narrow_point(lamp.position);
            lamp.direction = placement.narrow_direction(lamp.direction);
        }
        for object in objects.iter_mut() {
            object.box3d = placement.box3d(&object.box3d);
        }
        let mut velocities: Vec<[Vec3d; 2]> =
            objects.iter().map(|object| relative(step, &placement, &object.box3d, [0.0; 2])).collect();
        let mut shadows = MeshBuilder::default();
        let own = self.over_ground(step.ego.velocity, step.ego.point);
        let drift = |velocity: Vec3d| placement.direction([0, 1, 2].map(|axis| velocity[axis] - own[axis]));
        scene.camera = tilted(&scene.camera, step.ego.pitch, step.ego.roll);
        let [pitch_rate, roll_rate] = step.ego.nod_rates;
        let rates = [step.ego.yaw_rate, pitch_rate, roll_rate];
        let readout = Readout::new(&scene.camera, scene.image_size[1], self.readout_s, rates);
        let expose = |vertices: &mut [Vertex], velocity: Vec3d| {
            if let Some(readout) = &readout {
                let drift = drift(velocity);
                for vertex in vertices {
                    vertex.position = readout.moved(vertex.position, drift);
                }
            }
        };
        scene.objects.iter_mut().for_each(|object| expose(&mut object.mesh.vertices, [0.0; 3]));
        for (body, moment) in self.bodies.iter().zip(&step.movers) {
            let instance = objects.len() as u16 + 1;
            let Some(moment) = moment else {
                let location = [0.0, 0.0, -1e4];
                let dimensions = farsight_core::Dimensions { height: 1.0, width: 1.0, length: 1.0 };
                let box3d = Box3d { dimensions, location, yaw: 0.0 };
                objects.push(LabelledObject { class: body.class.clone(), box3d, instance, plate: None });
                velocities.push([[0.0; 3]; 2]);
                scene.objects.push(Object { mesh: Mesh::default(), instance, casts_shadow: false });
                continue;
            };
            let box3d = placement.box3d(&moment.box3d);
            let [x, _, z] = moment.box3d.location;
            let velocity = self.over_ground(moment.velocity, [x, z]);
            let mut object = objects::placed(body.mesh(moment), &box3d, instance);
            expose(&mut object.mesh.vertices, velocity);
            scene.objects.push(object);
            if has_contact_shadow(&body.class) {
                let first = shadows.mesh.vertices.len();
                add_contact_shadow(&mut shadows, &box3d, body.contact_shadow);
                expose(&mut shadows.mesh.vertices[first..], velocity);
                if body.lights_on {
                    scene.lamps.extend(headlights(&box3d));
                }
            }
            velocities.push(relative(step, &placement, &box3d, moment.velocity));
            objects.push(LabelledObject { class: body.class.clone(), box3d, instance, plate: body.plate });
        }
        scene.objects.push(Object { mesh: shadows.mesh, instance: 0, casts_shadow: false });
        if self.is_mirrored {
            mirror(&mut labelled);
            for [velocity, _] in &mut velocities {
                velocity[0] = -velocity[0];
            }
        }
        (labelled, velocities)
    }
}

impl Sequence {
    /// A velocity over the ground, x and z, with the change of height that it brings at this point; m/s in the street's
    /// coordinates.
    fn over_ground(&self, [vx, vz]: [f64; 2], [x, z]: [f64; 2]) -> Vec3d {
        const INSTANT_S: f64 = 1e-2;
        let y = |time_s: f64| self.ground.y([x + time_s * vx, z + time_s * vz]);
        [vx, (y(INSTANT_S) - y(-INSTANT_S)) / (2.0 * INSTANT_S), vz]
    }
}

/// The velocity of something in the camera's axes, and its speed over the ground (in the first place).
pub(super) fn relative(step: &Step, placement: &Placement, box3d: &Box3d, velocity: [f64; 2]) -> [Vec3d; 2] {
    let (own, yaw_rate) = (step.ego.velocity, step.ego.yaw_rate);
    let [x, _, z] = box3d.location;
    let [vx, _, vz] = placement.direction([velocity[0] - own[0], 0.0, velocity[1] - own[1]]);
    // The axes turn: to the left, what is ahead goes to the right.
    let moved = [vx + yaw_rate * z, 0.0, vz - yaw_rate * x];
    [moved, [velocity[0].hypot(velocity[1]), 0.0, 0.0]]
}

/// A label in the coordinates of a camera that has pitched and rolled.
pub(super) fn tilted_label(mut label: Label, pitch: f64, roll: f64) -> Label {
    let rotation = turn(pitch, roll);
    let point = label.box3d.location;
    label.box3d.location = rotation.map(|row| (0..3).map(|axis| row[axis] * point[axis]).sum());
    label.alpha = label.box3d.alpha();
    label
}

#[cfg(test)]
mod tests {
    use farsight_core::{Box3d, Dimensions, Label, ObjectClass};

    use super::{Placement, render};
    use crate::generator::SceneConfig;
    use crate::sequence::{Sequence, SequenceLayout, sequence_from_labels};

    const READOUT_S: f64 = 0.03;
    const FOCAL: f64 = 360.0;
    const HEIGHT: usize = 188;

    /// A tall van across the way, which goes so fast to the right, m/s, 12 m before a camera that moves so (speed and
    /// yaw rate); in frame 1 of 3.
    fn van(aside_mps: f64, motion: [f64; 2], readout_s: f64) -> Sequence {
        let fps = 10.0;
        let label = |frame: f64| {
            let dimensions = Dimensions { height: 4.0, width: 1.8, length: 3.0 };
            // Labels turn with the camera.
            let yaw = motion[1] * (frame - 1.0) / fps;
            let (x, (sin, cos)) = (aside_mps * (frame - 1.0) / fps, yaw.sin_cos());
            let location = [x * cos + 12.0 * sin, 1.65, 12.0 * cos - x * sin];
            let box3d = Box3d { dimensions, location, yaw };
            let (class, box2d) = (ObjectClass::Van, farsight_core::Box2d::new(0.0, 0.0, 1.0, 1.0));
            vec![(3, Label { class, truncation: 0.0, occlusion: 0, alpha: box3d.alpha(), box2d, box3d })]
        };
        let camera = farsight_core::Camera::from_intrinsics(FOCAL, FOCAL, 310.0, 90.0).unwrap();
        let frames = [0.0, 1.0, 2.0].map(label).to_vec();
        let layout = SequenceLayout { frames, motion: vec![motion; 3], fps, camera, image_size: [620, HEIGHT] };
        sequence_from_labels(&SceneConfig { readout_s, ..SceneConfig::default() }, &layout, 5)
    }

    /// By how many pixels a row sees the van's left edge farther right with a rolling exposure, in the rows of its
    /// upper and of its lower part.
    fn sheared(aside_mps: f64, motion: [f64; 2]) -> [f64; 2] {
        let edges = [0.0, READOUT_S].map(|readout_s| {
            let sequence = van(aside_mps, motion, readout_s);
            let (labelled, _) = sequence.scene(&sequence.steps[1]);
            let rendered = render(&labelled.scene);
            let instance = labelled.objects.last().unwrap().instance;
            move |row: usize| {
                let line = &rendered.instance[row * 620..][..620];
                line.iter().position(|one| *one == instance).unwrap() as f64
            }
        });
        // The van fills rows 21 to 139.
        [40..60, 120..136].map(|rows: std::ops::Range<usize>| {
            let count = rows.len() as f64;
            rows.map(|row| edges[1](row) - edges[0](row)).sum::<f64>() / count
        })
    }

    /// Where a row in the middle of those is on the way from the first row's time to the last one's, against the
    /// middle.
    fn time_s(row: f64) -> f64 {
        READOUT_S * (row / (HEIGHT - 1) as f64 - 0.5)
    }

    /// Edges are found to whole pixels.
    const EDGE_PX: f64 = 0.75;

    #[test]
    fn a_rolling_exposure_of_what_stands_still_changes_nothing() {
        let pictures = [0.0, READOUT_S].map(|readout_s| van(0.0, [0.0, 0.0], readout_s).frame(1));
        assert_eq!(pictures[0], pictures[1]);
        let pictures = [0.0, READOUT_S].map(|readout_s| van(0.0, [8.0, 0.0], readout_s).frame(1).image);
        assert_ne!(pictures[0], pictures[1]);
    }

    #[test]
    fn a_camera_that_turns_shears_upright_edges() {
        // To the left: what stands goes to the right, and lower rows are later.
        let yaw_rate = 1.2;
        let found = sheared(0.0, [0.0, yaw_rate]);
        for (found, row) in found.into_iter().zip([49.5, 127.5]) {
            // The edge is 1.5 m left of the axis, at the near side 11.1 m away.
            let tangent = 1.5 / 11.1_f64;
            let expected = FOCAL * (1.0 + tangent * tangent) * yaw_rate * time_s(row);
            assert!((found - expected).abs() < EDGE_PX, "row {row}: {found} for {expected}");
        }
    }

    #[test]
    fn what_passes_leans() {
        // To the right: lower rows see it farther right.
        let found = sheared(20.0, [0.0, 0.0]);
        for (found, row) in found.into_iter().zip([49.5, 127.5]) {
            let expected = FOCAL / 11.1 * 20.0 * time_s(row);
            assert!((found - expected).abs() < EDGE_PX, "row {row}: {found} for {expected}");
        }
    }

    #[test]
    fn the_way_to_the_street_is_the_way_back() {
        let placement = Placement::new([12.0, 40.0], 0.3, 0.7);
        let box3d = Box3d {
            dimensions: Dimensions { height: 1.5, width: 1.7, length: 4.2 },
            location: [-3.0, 1.6, 18.0],
            yaw: 2.9,
        };
        let back = placement.box3d(&placement.street_box(&box3d));
        for (found, expected) in back.location.into_iter().zip(box3d.location) {
            assert!((found - expected).abs() < 1e-12, "{back:?}");
        }
        assert!((back.yaw - box3d.yaw).abs() < 1e-12);
    }
}
