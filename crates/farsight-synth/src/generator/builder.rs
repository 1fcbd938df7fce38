//! A scene in the making.

use farsight_core::overlap::Block;
use farsight_core::{Box3d, Dimensions, ObjectClass};

use super::ground::Ground;
use super::light::Light;
use super::view::View;
use crate::mesh_builder::MeshBuilder;
use crate::objects::{self, BuildContext, Detail, ObjectState};
use crate::palette::{Palette, grey};
use crate::region::{Region, VehicleKind};
use crate::rng::SceneRng;
use crate::scene::LabelledScene;
use crate::scene::{LabelledObject, Lamp, MaterialId, Mesh, Object, Scene, Vec3};

/// Layers of paint on the ground, from below.
pub(crate) mod layer {
    pub(crate) const FIELD: u8 = 0;
    pub(crate) const ROAD: u8 = 1;
    pub(crate) const PATCH: u8 = 2;
    pub(crate) const MARKING: u8 = 3;
    pub(crate) const CONTACT_SHADOW: u8 = 4;
}

/// A view that must stay free: between two directions (x over z), up to a depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sightline {
    pub(crate) tangents: [f64; 2],
    pub(crate) depth_m: f64,
}

/// Collects what a scene consists of.
pub(crate) struct SceneBuilder {
    pub(crate) palette: Palette,
    pub(crate) view: View,
    pub(crate) ground: Ground,
    pub(crate) light: Light,
    pub(crate) unusual: bool,
    /// Where in the world; none for KITTI's city.
    pub(crate) region: Option<&'static Region>,
    /// The ground and what is painted on it: throws no shadow.
    pub(crate) flat: MeshBuilder,
    /// What stands on it.
    pub(crate) solid: MeshBuilder,
    pub(crate) lamps: Vec<Lamp>,
    /// What props must not hide.
    pub(crate) sightlines: Vec<Sightline>,
    /// Where the camera will be, x and z, if it moves.
    pub(crate) stations: Vec<[f64; 2]>,
    labelled: Vec<LabelledObject>,
    objects: Vec<Object>,
    taken: Vec<Block>,
    contact_shadow: MaterialId,
}

impl SceneBuilder {
    pub(crate) fn new(
        view: View,
        ground: Ground,
        light: Light,
        unusual: bool,
        region: Option<&'static Region>,
    ) -> Self {
        let mut palette = Palette::default();
        let contact_shadow = palette.matte(grey(0.01));
        let mut builder = Self {
            palette,
            view,
            ground,
            light,
            unusual,
            region,
            flat: MeshBuilder::default(),
            solid: MeshBuilder::default(),
            lamps: Vec::new(),
            sightlines: Vec::new(),
            stations: Vec::new(),
            labelled: Vec::new(),
            objects: Vec::new(),
            taken: Vec::new(),
            contact_shadow,
        };
        builder.take_room_for_camera();
        builder
    }

    /// The car that carries the camera keeps others away.
    ///
    /// On a mast it has none.
    fn take_room_for_camera(&mut self) {
        let heading = self.view.heading_rad;
        let on_mast = self.region.is_some() && self.view.is_on_mast();
        let (width, length) = if on_mast { (2.0, 2.0) } else { (2.3, 6.0) };
        let dimensions = Dimensions { height: 2.0, width, length };
        let yaw = -std::f64::consts::FRAC_PI_2 - heading;
        let back = if on_mast { 0.0 } else { 0.8 };
        let location = [back * libm::sin(heading), self.ground.at_camera, -back * libm::cos(heading)];
        self.taken.push(Block::new(&Box3d { dimensions, location, yaw }));
    }

    /// A point over the ground.
    pub(crate) fn over(&self, point: [f64; 2], lift: f64) -> Vec3 {
        [point[0], self.ground.y(point) - lift, point[1]].map(|v| v as f32)
    }

    /// Whether something of this radius would hide what must be seen.
    pub(crate) fn hides(&self, [x, z]: [f64; 2], radius: f64) -> bool {
        let near = (z - radius).max(0.3);
        let (low, high) = ((x - radius) / near, (x + radius) / near);
        let (low, high) =
            (low.min((x - radius) / (z + radius).max(0.3)), high.max((x + radius) / (z + radius).max(0.3)));
        let covers = |line: &Sightline| near < line.depth_m && low < line.tangents[1] && high > line.tangents[0];
        z + radius > 0.0 && self.sightlines.iter().any(covers)
    }

    /// Whether a box with `room` around it touches nothing that has been placed.
    pub(crate) fn is_free(&self, box3d: &Box3d, room: f64) -> bool {
        let grown = Block::new(&grown(box3d, room));
        self.taken.iter().all(|other| grown.intersection_area(other) == 0.0)
    }

    /// Keeps the room of a box free of others.
    pub(crate) fn take(&mut self, box3d: &Box3d) {
        self.taken.push(Block::new(box3d));
    }

    /// Adds a labelled object that stands in its box.
    pub(crate) fn add_labelled(
        &mut self,
        class: ObjectClass,
        kind: Option<&'static VehicleKind>,
        box3d: Box3d,
        state: ObjectState,
        rng: SceneRng,
    ) {
        let instance = self.labelled.len() as u16 + 1;
        let detail = self.detail(&box3d);
        let (mesh, plate) = self.mesh(&class, kind, box3d.dimensions, detail, state, rng);
        self.objects.push(objects::placed(&mesh, &box3d, instance));
        if has_contact_shadow(&class) {
            add_contact_shadow(&mut self.flat, &box3d, self.contact_shadow);
            if self.light.lamps_on && state.lights_on {
                self.lamps.extend(headlights(&box3d));
            }
        }
        self.take(&box3d);
        self.labelled.push(LabelledObject { class, box3d, instance, plate });
    }

    /// A mesh in object coordinates, and what its plates are made of.
    pub(crate) fn mesh(
        &mut self,
        class: &ObjectClass,
        kind: Option<&'static VehicleKind>,
        size: Dimensions,
        detail: Detail,
        state: ObjectState,
        mut rng: SceneRng,
    ) -> (Mesh, Option<MaterialId>) {
        let unusual = self.unusual;
        let look = self.region.map(|region| region.look(kind, &mut rng));
        let mut context = BuildContext { palette: &mut self.palette, rng, detail, state, unusual, plate: None, look };
        let mesh = match kind {
            Some(kind) => kind.shape.build(size, &mut context),
            None if state.stride.is_some() => objects::unfitted_walker(size, &mut context),
            None => objects::build(class, size, &mut context),
        };
        (mesh, context.plate)
    }

    /// What the ground under vehicles is made of.
    pub(crate) fn contact_shadow(&self) -> MaterialId {
        self.contact_shadow
    }

    /// How finely a labelled object is built: by its distance, and more coarsely in a crowd.
    fn detail(&self, box3d: &Box3d) -> Detail {
        let [x, _, z] = box3d.location;
        let distance_m = if self.stations.is_empty() { box3d.center_distance_m() } else { self.passes_m([x, z]) };
        let wanted = Detail::at(distance_m, self.view.focal_px());
        match self.labelled_triangles() {
            0..45_000 => wanted,
            45_000..70_000 => wanted.min(Detail::Middle),
            _ => Detail::Far,
        }
    }

    /// How near to a point on the ground the camera comes, metres.
    pub(crate) fn passes_m(&self, point: [f64; 2]) -> f64 {
        let distance = |at: &[f64; 2]| {
            let [x, z] = [point[0] - at[0], point[1] - at[1]];
            (x * x + z * z).sqrt()
        };
        self.stations.iter().map(distance).reduce(f64::min).unwrap_or_else(|| distance(&[0.0; 2]))
    }

    /// Triangles of all labelled objects so far.
    pub(crate) fn labelled_triangles(&self) -> usize {
        self.objects.iter().map(|object| object.mesh.triangles.len()).sum()
    }

    pub(crate) fn finish(self) -> LabelledScene {
        let ground = Object { mesh: self.flat.mesh, instance: 0, casts_shadow: false };
        let solid = Object { mesh: self.solid.mesh, instance: 0, casts_shadow: true };
        let mut objects = vec![ground, solid];
        objects.extend(self.objects);
        let scene = Scene {
            camera: self.view.camera,
            image_size: self.view.image_size,
            objects,
            materials: self.palette.materials,
            sun: self.light.sun,
            lamps: self.lamps,
            sky: self.light.sky,
            atmosphere: self.light.atmosphere,
            device: self.view.device,
        };
        LabelledScene { scene, objects: self.labelled }
    }
}

/// Whether it is so near to the ground that it keeps the light from it.
pub(crate) fn has_contact_shadow(class: &ObjectClass) -> bool {
    matches!(class, ObjectClass::Car | ObjectClass::Van | ObjectClass::Truck | ObjectClass::Tram)
}

/// The ground under a vehicle, where hardly any light comes.
pub(crate) fn add_contact_shadow(flat: &mut MeshBuilder, box3d: &Box3d, material: MaterialId) {
    let half = [box3d.dimensions.length * 0.47, box3d.dimensions.width * 0.45].map(|v| v as f32);
    let corners =
        [[-1.0, -0.8], [-0.9, -1.0], [0.9, -1.0], [1.0, -0.8], [1.0, 0.8], [0.9, 1.0], [-0.9, 1.0], [-1.0, 0.8]];
    let points = corners.map(|[a, b]| objects::point_of(box3d, [a * half[0], -0.012, b * half[1]]));
    for quad in [[0, 1, 2, 3], [0, 3, 4, 7], [7, 4, 5, 6]] {
        flat.quad(quad.map(|i| points[i]), material, layer::CONTACT_SHADOW);
    }
}

/// The headlights of a vehicle that is near enough for them to matter.
pub(crate) fn headlights(box3d: &Box3d) -> impl Iterator<Item = Lamp> + use<> {
    let box3d = *box3d;
    let sides = if box3d.center_distance_m() > 60.0 { &[][..] } else { &[-0.36, 0.36][..] };
    sides.iter().map(move |side| {
        let Dimensions { height, width, length } = box3d.dimensions;
        let local = [length / 2.0 + 0.05, -0.42 * height.min(2.0), side * width].map(|v| v as f32);
        let position = objects::point_of(&box3d, local);
        let ahead = objects::point_of(&box3d, [local[0] + 10.0, -0.1, local[2]]);
        let direction = crate::vector::unit(crate::vector::sub(ahead, position));
        Lamp { position, direction, cone_cos: 0.86, color: [9.0, 8.5, 7.5], reach_m: 35.0 }
    })
}

pub(crate) fn grown(box3d: &Box3d, room: f64) -> Box3d {
    let mut grown = *box3d;
    grown.dimensions.length += 2.0 * room;
    grown.dimensions.width += 2.0 * room;
    grown
}
