//! Things that stand beside roads.

use super::builder::SceneBuilder;
use crate::mesh_builder::MeshBuilder;
use crate::objects::{Detail, bicycle};
use crate::palette::{any_color, grey, matte, varied};
use crate::rng::SceneRng;
use crate::scene::{Color, Lamp, Material, MaterialId, Mesh, Pattern, Vec3};

/// Materials of plants and street furniture, drawn once a scene so that a place has its own look.
#[derive(Debug, Clone)]
pub(crate) struct StreetMaterials {
    /// Leaves with gaps, and the dark inside of the same crown.
    pub(crate) leaves: Vec<[MaterialId; 2]>,
    /// The same in large tufts, for crowns so far away that small gaps would run together into a haze.
    pub(crate) far_leaves: Vec<[MaterialId; 2]>,
    pub(crate) hedges: Vec<MaterialId>,
    pub(crate) bark: MaterialId,
    pub(crate) metal: MaterialId,
    pub(crate) dark: MaterialId,
    pub(crate) wood: MaterialId,
    pub(crate) stone: MaterialId,
}

const GREENS: [(Color, f64); 6] = [
    ([0.045, 0.09, 0.018], 4.0),
    ([0.025, 0.055, 0.015], 4.0),
    ([0.10, 0.14, 0.02], 2.0),
    ([0.16, 0.13, 0.02], 0.6),
    ([0.02, 0.035, 0.015], 2.0),
    ([0.14, 0.06, 0.02], 0.25),
];

impl StreetMaterials {
    pub(crate) fn sample(builder: &mut SceneBuilder, rng: &mut SceneRng) -> Self {
        let mut foliage = |rng: &mut SceneRng, density: f32, scale: f32| {
            let color = if builder.unusual && rng.chance(0.5) { any_color(rng) } else { rng.weighted(&GREENS) };
            let bright = rng.range32(1.2, 2.6);
            let color = crate::palette::times(varied(rng, color, 0.35), bright);
            let other = crate::palette::times(color, rng.range32(0.0, 0.15));
            let mut layer = |density: f32, dark: f32| {
                let [color, other] = [color, other].map(|c| crate::palette::times(c, dark));
                let pattern = Pattern::Leaves { other, scale, density, seed: rng.seed() };
                builder.palette.add(Material { pattern, ..matte(color) })
            };
            [layer(density, 1.0), layer(1.0, 0.45)]
        };
        let mut leaves = Vec::new();
        let mut far_leaves = Vec::new();
        for _ in 0..4 {
            let density = rng.range32(0.45, 0.75);
            let scale = rng.log_range(0.06, 0.2) as f32;
            leaves.push(foliage(rng, density, scale));
            far_leaves.push(foliage(rng, 0.5 * (1.0 + density), 5.0 * scale));
        }
        let hedges = (0..2).map(|_| foliage(rng, 1.0, 0.1)[0]).collect();
        let palette = &mut builder.palette;
        let bark = varied(rng, [0.09, 0.065, 0.045], 0.4);
        let wood = varied(rng, [0.2, 0.13, 0.08], 0.5);
        let metal = rng.range32(0.08, 0.4);
        Self {
            leaves,
            far_leaves,
            hedges,
            bark: palette.noise(bark, bark.map(|c| c * 0.4), 0.15, rng.seed()),
            metal: palette.glossy(grey(metal), 0.4, 30.0, 0.08),
            dark: palette.glossy(grey(0.02), 0.2, 20.0, 0.02),
            wood: palette.noise(wood, wood.map(|c| c * 0.6), 0.3, rng.seed()),
            stone: palette.noise(grey(rng.range32(0.2, 0.45)), grey(0.15), 0.5, rng.seed()),
        }
    }
}

/// Faces of a house.
#[derive(Debug, Clone, Copy)]
pub(crate) struct HouseLook {
    pub(crate) front: MaterialId,
    pub(crate) side: MaterialId,
    pub(crate) roof: MaterialId,
    pub(crate) ground_floor: MaterialId,
    /// Distance between windows, across and up.
    pub(crate) pitch: [f32; 2],
    /// Gables over the sides; flat otherwise.
    pub(crate) pitched: bool,
}

impl HouseLook {
    pub(crate) fn sample(builder: &mut SceneBuilder, lit: f32, rng: &mut SceneRng) -> Self {
        let wall = wall_color(builder.unusual, rng);
        let other = if rng.chance(0.85) { grey(rng.range32(0.01, 0.08)) } else { any_color(rng) };
        let pitch = [rng.range32(1.6, 4.2), rng.range32(2.6, 3.6)];
        let fill = [rng.range32(0.25, 0.7), rng.range32(0.35, 0.7)];
        let pattern = Pattern::Windows { other, pitch, fill, lit, seed: rng.seed() };
        let palette = &mut builder.palette;
        let front = palette.add(Material { pattern, specular: 0.1, shininess: 40.0, ..matte(wall) });
        let plain = plain_wall(wall, rng);
        let side = if rng.chance(0.5) { palette.add(plain) } else { front };
        let ground_floor = match rng.weighted(&[(0, 2.0), (1, 1.0), (2, 1.0)]) {
            0 => front,
            1 => palette.noise(grey(rng.range32(0.1, 0.4)), grey(0.1), 0.6, rng.seed()),
            _ => {
                let color = any_color(rng);
                let shop =
                    Pattern::Windows { other: grey(0.03), pitch, fill: [0.8, 0.7], lit: lit * 2.0, seed: rng.seed() };
                palette.add(Material { pattern: shop, ..matte(color) })
            }
        };
        let roof = rng.weighted(&[([0.25, 0.075, 0.04], 3.0), ([0.06, 0.055, 0.055], 2.0), ([0.16, 0.1, 0.07], 1.0)]);
        let roof = varied(rng, roof, 0.3);
        let tiles = Pattern::Bricks {
            other: roof.map(|c| c * 0.5),
            size: [0.3, 0.35],
            joint: 0.04,
            variation: 0.3,
            seed: rng.seed(),
        };
        let roof = palette.add(Material { pattern: tiles, ..matte(roof) });
        Self { front, side, roof, ground_floor, pitch, pitched: rng.chance(0.65) }
    }
}

fn wall_color(unusual: bool, rng: &mut SceneRng) -> Color {
    if unusual {
        return any_color(rng);
    }
    let color = rng.weighted(&[
        ([0.72, 0.70, 0.64], 4.0),
        ([0.62, 0.52, 0.32], 2.0),
        ([0.45, 0.42, 0.38], 2.0),
        ([0.30, 0.11, 0.07], 2.0),
        ([0.55, 0.35, 0.22], 1.0),
        ([0.3, 0.33, 0.36], 1.0),
        ([0.25, 0.3, 0.22], 0.5),
    ]);
    varied(rng, color, 0.2)
}

/// Plaster, bricks or concrete.
pub(crate) fn plain_wall(color: Color, rng: &mut SceneRng) -> Material {
    let seed = rng.seed();
    let pattern = if rng.chance(0.35) {
        Pattern::Bricks {
            other: color.map(|c| (c * 1.4).min(0.8)),
            size: [0.26, 0.085],
            joint: 0.012,
            variation: 0.35,
            seed,
        }
    } else {
        Pattern::Noise {
            other: color.map(|c| c * 0.75),
            scale: rng.range32(0.5, 4.0),
            amount: rng.range32(0.2, 1.0),
            seed,
        }
    };
    Material { pattern, ..matte(color) }
}

/// A house whose front (along x) lies at z = 0 and which reaches back to negative z; whole floors of about `height`
/// together.
pub(crate) fn house(width: f32, depth: f32, height: f32, look: &HouseLook, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let half = width / 2.0;
    let floor = rng.range32(3.0, 3.6);
    let [across, up] = look.pitch;
    let floors = ((height - floor) / up).round().max(1.0);
    let height = floor + floors * up;
    shape.cuboid([-half - 0.03, -0.35, -depth], [half + 0.03, 0.8, 0.03], look.side);
    let columns = |length: f32| (length / across).round().max(1.0) * across;
    let mut wall = |from: [f32; 2], to: [f32; 2], [low, high]: [f32; 2], rows: f32, material: MaterialId| {
        let length = columns(((to[0] - from[0]).abs() + (to[1] - from[1]).abs()).max(0.1));
        let points = [[from[0], -low, from[1]], [to[0], -low, to[1]], [to[0], -high, to[1]], [from[0], -high, from[1]]];
        let uvs = [[0.0, 0.0], [length, 0.0], [length, rows * up], [0.0, rows * up]];
        shape.quad_uv(points, uvs, material, 0);
    };
    wall([half, 0.0], [-half, 0.0], [0.0, floor], 1.0, look.ground_floor);
    wall([half, 0.0], [-half, 0.0], [floor, height], floors, look.front);
    for x in [-half, half] {
        wall([x, 0.0], [x, -depth], [0.0, floor], 1.0, look.side);
        wall([x, 0.0], [x, -depth], [floor, height], floors, look.side);
    }
    wall([-half, -depth], [half, -depth], [0.0, height], floors + 1.0, look.front);
    shape.quad(
        [[-half, -height, 0.0], [half, -height, 0.0], [half, -height, -depth], [-half, -height, -depth]],
        look.roof,
        0,
    );
    if look.pitched {
        gable_roof(&mut shape, half, depth, height, look, rng);
    }
    if rng.chance(0.5) {
        let x = rng.range32(-half * 0.7, half * 0.7);
        shape.cuboid(
            [x - 0.4, -height - depth * 0.45, -depth * 0.6],
            [x + 0.4, -height + 0.5, -depth * 0.45],
            look.side,
        );
    }
    if rng.chance(0.35) && half > 3.5 {
        // Balconies, or bays.
        let x = rng.range32(-half * 0.6, half * 0.6);
        for k in 0..floors as usize {
            let level = floor + up * k as f32;
            let out = 1.0;
            shape.cuboid([x - 1.4, -level - 0.95, out - 0.06], [x + 1.4, -level + 0.05, out], look.side);
            shape.cuboid([x - 1.4, -level, 0.0], [x + 1.4, -level + 0.12, out], look.side);
        }
    }
    door(&mut shape, half, look, rng);
    shape.mesh
}

/// A front door with a step.
fn door(shape: &mut MeshBuilder, half: f32, look: &HouseLook, rng: &mut SceneRng) {
    let x = rng.range32(-half * 0.8, half * 0.8);
    shape.cuboid([x - 0.55, -2.3, 0.0], [x + 0.55, 0.1, 0.05], look.roof);
    shape.cuboid([x - 0.9, -0.18, 0.0], [x + 0.9, 0.3, 0.5], look.side);
}

fn gable_roof(shape: &mut MeshBuilder, half: f32, depth: f32, height: f32, look: &HouseLook, rng: &mut SceneRng) {
    let rise = depth * rng.range32(0.25, 0.55);
    let eaves = 0.4;
    let along_street = rng.chance(0.7);
    let (a, b) = if along_street { (half + 0.3, depth / 2.0 + eaves) } else { (half + eaves, depth / 2.0 + 0.3) };
    let center = -depth / 2.0;
    let y = -height + 0.1;
    let top = y - rise;
    // The ridge runs along x, or along z.
    let at =
        |x: f32, y: f32, z: f32| if along_street { [x, y, center + z] } else { [z * a / b, y, center + x * b / a] };
    shape.quad([at(-a, y, b), at(a, y, b), at(a, top, 0.0), at(-a, top, 0.0)], look.roof, 0);
    shape.quad([at(a, y, -b), at(-a, y, -b), at(-a, top, 0.0), at(a, top, 0.0)], look.roof, 0);
    for x in [-a + 0.3, a - 0.3] {
        let uv = [[0.0, 0.0], [2.0 * b, 0.0], [b, rise]];
        shape.triangle([at(x, y, -b), at(x, y, b), at(x, top, 0.0)], uv, look.side, 0);
    }
}

/// A lamp on a mast that leans over the road (towards +z).
pub(crate) fn street_lamp(
    builder: &mut SceneBuilder,
    at: Vec3,
    yaw: f64,
    height: f32,
    materials: &StreetMaterials,
    rng: &mut SceneRng,
) {
    let mut shape = MeshBuilder::default();
    let reach = rng.range32(0.5, 2.2);
    shape.tube([0.0, 0.1, 0.0], [0.0, -height, 0.0], [0.08, 0.05], 7, materials.metal);
    shape.tube([0.0, -height, 0.0], [0.0, -height - 0.15, reach], [0.05, 0.04], 5, materials.metal);
    let on = builder.light.lamps_on;
    let head = builder.palette.glowing(grey(0.3), if on { [4.0, 3.2, 2.0] } else { [0.0; 3] });
    shape.cuboid(
        [-0.12, -height - 0.22, reach - 0.1],
        [0.12, -height - 0.1, reach + 0.5],
        if on { head } else { materials.metal },
    );
    builder.solid.place(&shape.mesh, yaw, at);
    if on && builder.lamps.len() < 24 {
        let out = crate::mesh_builder::Turn::new(yaw).apply([0.0, -height - 0.05, reach + 0.2]);
        let position = crate::vector::add(at, out);
        let warm = rng.range32(0.45, 0.95);
        let color = [30.0, 30.0 * (0.5 + 0.5 * warm), 30.0 * warm * 0.8];
        builder.lamps.push(Lamp { position, direction: [0.0, 1.0, 0.0], cone_cos: 0.25, color, reach_m: 28.0 });
    }
}

/// A sign on a post; it faces -x.
pub(crate) fn sign(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let height = rng.range32(2.0, 3.0);
    shape.tube([0.0, 0.1, 0.0], [0.0, -height, 0.0], [0.035; 2], 6, materials.metal);
    let colors: [Color; 5] =
        [[0.5, 0.02, 0.02], [0.02, 0.08, 0.5], [0.75, 0.75, 0.72], [0.75, 0.5, 0.02], [0.02, 0.2, 0.08]];
    let (rim, face) = (rng.pick(&colors), rng.pick(&colors));
    let (rim, face) = (builder.palette.matte(rim), builder.palette.matte(face));
    let radius = rng.range32(0.25, 0.42);
    let center = [-0.05, -height + radius, 0.0];
    let sides = rng.pick(&[3, 4, 12, 12]);
    shape.disc(center, [-1.0, 0.0, 0.0], [0.0, radius], sides, &[rim]);
    shape.disc([-0.055, center[1], 0.0], [-1.0, 0.0, 0.0], [0.0, radius * 0.75], sides, &[face]);
    shape.mesh
}

/// A traffic light on a post; it faces -x.
pub(crate) fn traffic_light(builder: &mut SceneBuilder, materials: &StreetMaterials, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let height = rng.range32(2.6, 3.4);
    shape.tube([0.0, 0.1, 0.0], [0.0, -height, 0.0], [0.07; 2], 7, materials.metal);
    shape.cuboid([-0.15, -height - 0.1, -0.17], [0.12, -height + 0.85, 0.17], materials.dark);
    let shown = rng.whole(0, 2);
    let lit: [Color; 3] = [[3.0, 0.1, 0.05], [3.0, 1.6, 0.1], [0.1, 2.6, 1.2]];
    for (k, emission) in lit.into_iter().enumerate() {
        let material =
            builder.palette.glowing(emission.map(|c| c * 0.03), if k == shown { emission } else { [0.0; 3] });
        shape.disc([-0.16, -height + 0.05 + 0.27 * k as f32, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.1], 10, &[material]);
    }
    shape.mesh
}

/// A bollard or a thick post.
pub(crate) fn post(materials: &StreetMaterials, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let height = rng.range32(0.7, 1.3);
    let radius = rng.range32(0.04, 0.1);
    let material = rng.pick(&[materials.metal, materials.dark, materials.wood, materials.stone]);
    shape.tube([0.0, 0.1, 0.0], [0.0, -height, 0.0], [radius; 2], 7, material);
    shape.disc([0.0, -height, 0.0], [0.0, -1.0, 0.0], [0.0, radius], 7, &[material]);
    shape.mesh
}

/// A bin, a box of the power company, a column for posters.
pub(crate) fn bin(builder: &mut SceneBuilder, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let color = any_color(rng);
    let material = builder.palette.glossy(color, 0.2, 20.0, 0.02);
    let (half, height) = (rng.range32(0.2, 0.5), rng.range32(0.7, 1.6));
    shape.cuboid([-half, -height, -half], [half, 0.05, half], material);
    shape.mesh
}

/// A bicycle that nobody rides; its length along x.
pub(crate) fn parked_bicycle(builder: &mut SceneBuilder, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let color = any_color(rng);
    let frame = builder.palette.matte(color);
    let dark = builder.palette.matte(grey(0.02));
    for _ in 0..rng.whole(1, 3) {
        let mut one = MeshBuilder::default();
        bicycle(&mut one, frame, dark, Detail::Middle);
        let at = [rng.range32(-0.3, 0.3), 0.0, shape.mesh.vertices.len() as f32 * 0.0006];
        shape.place(&one.mesh, rng.range(-0.2, 0.2), at);
    }
    shape.mesh
}

/// A block, a ball or a slab of any colour.
pub(crate) fn distractor(builder: &mut SceneBuilder, size: f32, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let color = any_color(rng);
    let material = builder.palette.glossy(color, rng.range32(0.0, 0.9), 40.0, rng.range32(0.0, 0.2));
    let half = [0, 1, 2].map(|_| size * rng.range32(0.1, 0.5));
    match rng.whole(0, 2) {
        0 => shape.cuboid(half.map(|h| -h), half, material),
        1 => shape.ellipsoid([0.0; 3], half, [5, 8], material, || rng.range32(-0.3, 0.3)),
        _ => shape.tube([0.0, half[1], 0.0], [half[0], -half[1], half[2]], [half[0], half[2]], 9, material),
    }
    shape.mesh
}
