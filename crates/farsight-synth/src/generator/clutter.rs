//! What stands about on pavements: what people are seen against in towns.
//!
//! Nothing of it is labelled. Built last, around the people that are there already, of whom it may hide parts: a scene
//! with it is the scene without it and more.

use farsight_core::{Box3d, Dimensions};

use super::builder::SceneBuilder;
use super::plants;
use super::props::{self, StreetMaterials};
use super::surroundings::Surroundings;
use crate::mesh_builder::{MeshBuilder, sin_cos};
use crate::objects::{Detail, bicycle};
use crate::palette::{any_color, grey, matte, times};
use crate::rng::SceneRng;
use crate::scene::{Color, Material, MaterialId, Mesh, Pattern};

/// Things stand between these distances along the street, metres.
const ALONG_M: [f64; 2] = [4.0, 60.0];

/// A thing to be put up: it looks towards +z, its length runs along x.
struct Thing {
    mesh: Mesh,
    length: f64,
    width: f64,
}

/// Makes a kind of thing.
type Maker = fn(&mut SceneBuilder, &StreetMaterials, &mut SceneRng) -> Thing;

impl Surroundings<'_> {
    /// Puts things along both sides of the street: about `self.clutter` for each ten metres of a side, as far as there
    /// is room.
    pub(super) fn clutter(&mut self) {
        let mean = self.clutter * (ALONG_M[1] - ALONG_M[0]) / 10.0;
        for side in 0..2 {
            for _ in 0..(mean * self.rng.range(0.0, 2.0)) as usize {
                self.put_thing(side);
            }
        }
    }

    fn put_thing(&mut self, side: usize) {
        let mut rng = self.rng.fork();
        let street = &self.plan.main;
        let border = street.borders[side];
        let kerb = street.edges[side].abs() + border.verge;
        let back = street.outer(side);
        // Against the wall, at the kerb, anywhere between.
        let d = match rng.weighted(&[(0, 5.0), (1, 3.0), (2, 2.0)]) {
            0 => back + rng.range(-0.5, 0.6),
            1 => kerb + rng.range(0.2, 0.6),
            _ => rng.range(kerb, back + 0.5),
        };
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let node = street.path.at(rng.log_range(ALONG_M[0], ALONG_M[1]));
        let point = node.beside(sign * d);
        let thing = Thing::sample(self.builder, &self.materials, &mut rng);
        let towards_road = if side == 1 { 0.0 } else { std::f64::consts::PI };
        let yaw = node.yaw() + towards_road + rng.normal(0.0, 0.08);
        let dimensions = Dimensions { height: 1.0, width: thing.width, length: thing.length };
        let location = [point[0], self.builder.ground.y(point), point[1]];
        let room = Box3d { dimensions, location, yaw };
        let reach = f64::midpoint(thing.length, thing.width);
        let crosses = self.plan.side.iter().any(|other| other.covers(point, 0.3));
        if crosses
            || !self.builder.is_free(&room, 0.1)
            || self.builder.hides(point, reach)
            || !self.builder.view.sees(point, 3.0)
        {
            return;
        }
        let at = self.builder.over(point, border.kerb);
        self.builder.solid.place(&thing.mesh, yaw, at);
        self.builder.take(&room);
    }
}

impl Thing {
    fn sample(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let kinds: [(Maker, f64); 11] = [
            (Self::banded_post, 2.0),
            (Self::bicycles, 3.0),
            (Self::planter, 2.0),
            (Self::cafe, 1.5),
            (Self::board, 1.5),
            (Self::column, 0.7),
            (Self::railing, 1.5),
            (Self::pile, 1.5),
            (Self::bench, 0.7),
            (Self::clothes_rack, 1.0),
            (Self::barrier, 0.7),
        ];
        rng.weighted(&kinds)(builder, materials, rng)
    }

    fn new(shape: MeshBuilder, length: f32, width: f32) -> Self {
        Self { mesh: shape.mesh, length: f64::from(length), width: f64::from(width) }
    }

    /// The same, across the street.
    fn turned(self) -> Self {
        let mut shape = MeshBuilder::default();
        shape.place(&self.mesh, std::f64::consts::FRAC_PI_2, [0.0; 3]);
        Self { mesh: shape.mesh, length: self.width, width: self.length }
    }

    /// A bollard or a pole with bands.
    fn banded_post(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let height = if rng.chance(0.7) { rng.range32(0.8, 1.2) } else { rng.range32(2.0, 3.2) };
        let radius = rng.range32(0.03, 0.09);
        let light = builder.palette.matte(grey(rng.range32(0.4, 0.8)));
        let colors: [Color; 3] = [[0.5, 0.02, 0.02], [0.02; 3], [0.02, 0.06, 0.3]];
        let color = rng.pick(&colors);
        let bands = [builder.palette.matte(color), light];
        let plain = rng.pick(&[materials.dark, materials.metal, bands[0]]);
        let from = height * rng.range32(0.0, 0.6);
        shape.tube([0.0, 0.1, 0.0], [0.0, -from, 0.0], [radius; 2], 8, plain);
        let count = rng.whole(2, 6);
        let step = (height - from) / count as f32;
        for k in 0..count {
            let y = from + step * k as f32;
            shape.tube([0.0, -y, 0.0], [0.0, -y - step, 0.0], [radius; 2], 8, bands[k % 2]);
        }
        shape.ellipsoid([0.0, -height, 0.0], [radius; 3], [4, 8], plain, || 0.0);
        Self::new(shape, 2.0 * radius, 2.0 * radius)
    }

    /// Bicycles in a row, across the pavement or leaning along a wall.
    fn bicycles(builder: &mut SceneBuilder, _: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let count = rng.whole(1, 6);
        let pitch = rng.range32(0.35, 0.75);
        let across = rng.chance(0.6);
        let dark = builder.palette.matte(grey(0.02));
        for k in 0..count {
            let color = any_color(rng);
            let frame = builder.palette.matte(color);
            let mut one = MeshBuilder::default();
            bicycle(&mut one, frame, dark, Detail::Middle);
            let along = pitch * (k as f32 - (count - 1) as f32 / 2.0);
            let (yaw, at) = if across {
                (rng.pick(&[1.0, -1.0]) * (1.3 + rng.symmetric(0.3)), [along, 0.0, 0.0])
            } else {
                (rng.symmetric(0.1), [rng.range32(-0.4, 0.4), 0.0, along * 0.6])
            };
            shape.place(&one.mesh, yaw, at);
        }
        let row = pitch * count as f32;
        if across { Self::new(shape, row + 0.8, 2.0) } else { Self::new(shape, 2.7, 0.6 * row + 0.8) }
    }

    /// A tub with a bush, or a row of them.
    fn planter(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let (half, height) = (rng.range32(0.2, 0.5), rng.range32(0.3, 0.8));
        let tub = rng.pick(&[materials.stone, materials.wood, materials.dark]);
        let tub = if rng.chance(0.3) { surface(builder, rng) } else { tub };
        let count = rng.whole(1, 3);
        for k in 0..count {
            let x = (k as f32 - (count - 1) as f32 / 2.0) * 2.4 * half;
            shape.cuboid([x - half, -height, -half], [x + half, 0.05, half], tub);
            let bush = plants::bush(rng.range32(0.4, 1.5), 2.2 * half, materials, true, rng);
            shape.place(&bush, 0.0, [x, -height, 0.0]);
        }
        Self::new(shape, 2.4 * half * count as f32, 2.0 * half)
    }

    /// Tables and chairs, often under a parasol.
    fn cafe(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let wood = rng.pick(&[materials.wood, materials.metal, materials.dark]);
        let cloth = surface(builder, rng);
        let pole = materials.metal;
        shape.tube([0.0, 0.0, 0.0], [0.0, -0.72, 0.0], [0.04; 2], 6, pole);
        shape.disc([0.0, -0.73, 0.0], [0.0, -1.0, 0.0], [0.0, rng.range32(0.3, 0.6)], 10, &[wood]);
        for k in 0..rng.whole(2, 4) {
            let (sin, cos) = sin_cos(std::f32::consts::FRAC_PI_2 * k as f32 + rng.range32(-0.3, 0.3));
            let chair = chair(if rng.chance(0.5) { wood } else { cloth }, materials.metal);
            // The chair looks along its x, at the table.
            let yaw = -f64::from(libm::atan2f(-sin, -cos));
            shape.place(&chair, yaw, [0.8 * cos, 0.0, 0.8 * sin]);
        }
        let mut reach = 1.1;
        if rng.chance(0.6) {
            reach = rng.range32(1.1, 1.7);
            parasol(&mut shape, reach, rng.range32(2.1, 2.5), cloth, pole);
        }
        Self::new(shape, 2.0 * reach, 2.0 * reach)
    }

    /// A board that stands on the pavement, or a poster on legs.
    fn board(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let half = rng.range32(0.25, 0.65);
        let height = half * rng.range32(2.4, 3.4);
        let face = printed(builder, rng);
        let lean = rng.range32(0.05, 0.25);
        for z in [-lean, lean] {
            shape.quad([[-half, 0.0, z], [half, 0.0, z], [half, -height, 0.0], [-half, -height, 0.0]], face, 0);
        }
        let edge = 0.03;
        for x in [-half, half] {
            shape.cuboid([x - edge, -height - edge, -edge], [x + edge, 0.05, edge], materials.dark);
        }
        let thing = Self::new(shape, 2.0 * half, 2.0 * lean);
        if rng.pick(&[false, false, true]) { thing.turned() } else { thing }
    }

    /// A column or a box that carries posters.
    fn column(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let posters = printed(builder, rng);
        let (radius, height) = (rng.range32(0.3, 0.75), rng.range32(1.1, 3.2));
        if rng.chance(0.5) {
            shape.tube([0.0, 0.1, 0.0], [0.0, -height, 0.0], [radius; 2], 14, posters);
            shape.disc([0.0, -height, 0.0], [0.0, -1.0, 0.0], [0.0, radius * 1.1], 14, &[materials.dark]);
        } else {
            shape.cuboid([-radius, -height, -0.2], [radius, 0.05, 0.2], posters);
        }
        Self::new(shape, 2.0 * radius, 2.0 * radius)
    }

    /// Upright bars between two rails.
    fn railing(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let (half, height) = (rng.range32(0.8, 2.5), rng.range32(0.8, 1.4));
        let painted = any_color(rng);
        let painted = builder.palette.glossy(painted, 0.3, 30.0, 0.03);
        let bar = rng.pick(&[materials.metal, materials.dark, painted]);
        for y in [0.12, height] {
            shape.tube([-half, -y, 0.0], [half, -y, 0.0], [0.025; 2], 5, bar);
        }
        let pitch = rng.range32(0.1, 0.5);
        let count = (2.0 * half / pitch) as usize;
        for k in 0..=count {
            let x = -half + 2.0 * half * k as f32 / count as f32;
            shape.tube([x, 0.0, 0.0], [x, -height, 0.0], [0.015; 2], 4, bar);
        }
        Self::new(shape, 2.0 * half, 0.1)
    }

    /// Crates, cartons, bags, a cabinet.
    fn pile(builder: &mut SceneBuilder, _: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let reach = rng.range32(0.2, 0.9);
        for _ in 0..rng.whole(1, 7) {
            let size = rng.range32(0.15, 0.5);
            let mesh = props::distractor(builder, 2.0 * size, rng);
            let at = [rng.range32(-reach, reach), -rng.range32(0.4, 1.8) * size, rng.range32(-0.3, 0.3)];
            shape.place(&mesh, rng.range(0.0, 6.3), at);
        }
        if rng.chance(0.4) {
            let material = surface(builder, rng);
            let half = rng.range32(0.25, 0.6);
            shape.cuboid([-half, -rng.range32(0.8, 1.5), -0.45], [half, 0.05, -0.1], material);
        }
        Self::new(shape, 2.0 * reach + 1.5, 2.1)
    }

    fn bench(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let half = rng.range32(0.6, 1.0);
        let seat = if rng.chance(0.6) { materials.wood } else { surface(builder, rng) };
        shape.cuboid([-half, -0.46, -0.22], [half, -0.41, 0.22], seat);
        if rng.chance(0.6) {
            shape.cuboid([-half, -0.9, -0.26], [half, -0.6, -0.22], seat);
        }
        for x in [-0.8 * half, 0.8 * half] {
            shape.cuboid([x - 0.04, -0.9, -0.22], [x + 0.04, 0.05, -0.16], materials.dark);
            shape.cuboid([x - 0.04, -0.41, 0.14], [x + 0.04, 0.05, 0.2], materials.dark);
        }
        Self::new(shape, 2.0 * half, 0.5)
    }

    /// A rail with coats: as high and as colourful as people.
    fn clothes_rack(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let count = rng.whole(1, 9);
        let half = 0.07 * count as f32 + 0.1;
        let top = rng.range32(1.3, 1.8);
        for x in [-half, half] {
            shape.tube([x, 0.0, 0.0], [x, -top, 0.0], [0.015; 2], 5, materials.metal);
        }
        shape.tube([-half, -top, 0.0], [half, -top, 0.0], [0.015; 2], 5, materials.metal);
        for k in 0..count {
            let x = 0.14 * (k as f32 - (count - 1) as f32 / 2.0);
            let (reach, low) = (rng.range32(0.18, 0.3), rng.range32(0.2, 0.9));
            let cloth = surface(builder, rng);
            shape.cuboid([x - 0.05, -top + 0.05, -reach], [x + 0.05, -low, reach], cloth);
        }
        let thing = Self::new(shape, 2.0 * half + 0.2, 0.8);
        if rng.pick(&[false, true]) { thing.turned() } else { thing }
    }

    /// Striped boards between posts, as around road works.
    fn barrier(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Self {
        let mut shape = MeshBuilder::default();
        let half = rng.range32(0.6, 1.6);
        let red: Color = [0.55, 0.03, 0.02];
        let stripes = Pattern::Bricks { other: red, size: [0.5, 2.0], joint: 0.25, variation: 0.0, seed: rng.seed() };
        let board = builder.palette.add(Material { pattern: stripes, ..matte(grey(0.7)) });
        for y in [0.35, 1.0] {
            shape.cuboid([-half, -y, -0.02], [half, -y + 0.22, 0.02], board);
        }
        for x in [-half, half] {
            shape.cuboid([x - 0.03, -1.05, -0.03], [x + 0.03, 0.05, 0.03], materials.dark);
        }
        Self::new(shape, 2.0 * half, 0.2)
    }
}

/// A chair that looks along +x.
fn chair(seat: MaterialId, frame: MaterialId) -> Mesh {
    let mut shape = MeshBuilder::default();
    shape.cuboid([-0.2, -0.47, -0.2], [0.2, -0.43, 0.2], seat);
    shape.cuboid([-0.22, -0.88, -0.2], [-0.18, -0.55, 0.2], seat);
    for (x, top) in [(-0.2, 0.88), (0.2, 0.45)] {
        for z in [-0.19, 0.19] {
            shape.tube([x, 0.0, z], [x, -top, z], [0.015; 2], 4, frame);
        }
    }
    shape.mesh
}

fn parasol(shape: &mut MeshBuilder, radius: f32, height: f32, cloth: MaterialId, pole: MaterialId) {
    shape.tube([0.0, 0.0, 0.0], [0.0, -height - 0.3, 0.0], [0.025; 2], 6, pole);
    let rim = |k: usize| {
        let (sin, cos) = sin_cos(std::f32::consts::TAU * k as f32 / 8.0);
        [radius * cos, -height, radius * sin]
    };
    let top = [0.0, -height - 0.3 * radius, 0.0];
    for k in 0..8 {
        shape.triangle([top, rim(k), rim(k + 1)], [[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]], cloth, 0);
    }
}

/// Something printed: posters, letters.
pub(super) fn printed(builder: &mut SceneBuilder, rng: &mut SceneRng) -> MaterialId {
    let (paper, other, seed) = (any_color(rng), any_color(rng), rng.seed());
    let pattern = if rng.chance(0.6) {
        let pitch = [rng.log_range(0.08, 0.7) as f32, rng.log_range(0.1, 0.7) as f32];
        Pattern::Windows { other, pitch, fill: [rng.range32(0.3, 0.9), rng.range32(0.3, 0.9)], lit: 0.0, seed }
    } else {
        Pattern::Noise { other, scale: rng.log_range(0.1, 0.8) as f32, amount: 1.0, seed }
    };
    builder.palette.add(Material { pattern, ..matte(paper) })
}

/// Cloth, paint or plastic: mostly plain, sometimes striped.
pub(super) fn surface(builder: &mut SceneBuilder, rng: &mut SceneRng) -> MaterialId {
    let (color, other) = (any_color(rng), any_color(rng));
    let pattern = match rng.weighted(&[(0, 3.0), (1, 1.0), (2, 2.0)]) {
        0 => Pattern::Plain,
        1 => Pattern::Stripes { other, period: rng.log_range(0.1, 0.6) as f32, share: rng.range32(0.2, 0.8) },
        _ => {
            let other = times(color, rng.range32(0.3, 0.8));
            Pattern::Noise { other, scale: rng.log_range(0.1, 1.0) as f32, amount: 0.8, seed: rng.seed() }
        }
    };
    builder.palette.add(Material { pattern, ..matte(color) })
}
