//! Things that stand beside roads.

use super::stage::Stage;
use crate::actors::{Detail, bicycle};
use crate::dice::Dice;
use crate::palette::{any_color, grey, matte, varied};
use crate::scene::{Color, Lamp, Material, MaterialId, Mesh, Pattern, Vec3};
use crate::shape::Shape;

/// Materials of plants and street furniture, drawn once a scene so that a place has its own look.
#[derive(Debug, Clone)]
pub(crate) struct Stock {
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

impl Stock {
    pub(crate) fn draw(stage: &mut Stage, dice: &mut Dice) -> Self {
        let mut foliage = |dice: &mut Dice, density: f32, scale: f32| {
            let color = if stage.unusual && dice.chance(0.5) { any_color(dice) } else { dice.weighted(&GREENS) };
            let bright = dice.range32(1.2, 2.6);
            let color = crate::palette::times(varied(dice, color, 0.35), bright);
            let other = crate::palette::times(color, dice.range32(0.0, 0.15));
            let mut layer = |density: f32, dark: f32| {
                let [color, other] = [color, other].map(|c| crate::palette::times(c, dark));
                let pattern = Pattern::Leaves { other, scale, density, seed: dice.seed() };
                stage.palette.add(Material { pattern, ..matte(color) })
            };
            [layer(density, 1.0), layer(1.0, 0.45)]
        };
        let mut leaves = Vec::new();
        let mut far_leaves = Vec::new();
        for _ in 0..4 {
            let density = dice.range32(0.45, 0.75);
            let scale = dice.log_range(0.06, 0.2) as f32;
            leaves.push(foliage(dice, density, scale));
            far_leaves.push(foliage(dice, 0.5 * (1.0 + density), 5.0 * scale));
        }
        let hedges = (0..2).map(|_| foliage(dice, 1.0, 0.1)[0]).collect();
        let palette = &mut stage.palette;
        let bark = varied(dice, [0.09, 0.065, 0.045], 0.4);
        let wood = varied(dice, [0.2, 0.13, 0.08], 0.5);
        let metal = dice.range32(0.08, 0.4);
        Self {
            leaves,
            far_leaves,
            hedges,
            bark: palette.noise(bark, bark.map(|c| c * 0.4), 0.15, dice.seed()),
            metal: palette.glossy(grey(metal), 0.4, 30.0, 0.08),
            dark: palette.glossy(grey(0.02), 0.2, 20.0, 0.02),
            wood: palette.noise(wood, wood.map(|c| c * 0.6), 0.3, dice.seed()),
            stone: palette.noise(grey(dice.range32(0.2, 0.45)), grey(0.15), 0.5, dice.seed()),
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
    pub(crate) fn draw(stage: &mut Stage, lit: f32, dice: &mut Dice) -> Self {
        let wall = wall_color(stage.unusual, dice);
        let other = if dice.chance(0.85) { grey(dice.range32(0.01, 0.08)) } else { any_color(dice) };
        let pitch = [dice.range32(1.6, 4.2), dice.range32(2.6, 3.6)];
        let fill = [dice.range32(0.25, 0.7), dice.range32(0.35, 0.7)];
        let pattern = Pattern::Windows { other, pitch, fill, lit, seed: dice.seed() };
        let palette = &mut stage.palette;
        let front = palette.add(Material { pattern, gloss: 0.1, shininess: 40.0, ..matte(wall) });
        let plain = plain_wall(wall, dice);
        let side = if dice.chance(0.5) { palette.add(plain) } else { front };
        let ground_floor = match dice.weighted(&[(0, 2.0), (1, 1.0), (2, 1.0)]) {
            0 => front,
            1 => palette.noise(grey(dice.range32(0.1, 0.4)), grey(0.1), 0.6, dice.seed()),
            _ => {
                let color = any_color(dice);
                let shop =
                    Pattern::Windows { other: grey(0.03), pitch, fill: [0.8, 0.7], lit: lit * 2.0, seed: dice.seed() };
                palette.add(Material { pattern: shop, ..matte(color) })
            }
        };
        let roof = dice.weighted(&[([0.25, 0.075, 0.04], 3.0), ([0.06, 0.055, 0.055], 2.0), ([0.16, 0.1, 0.07], 1.0)]);
        let roof = varied(dice, roof, 0.3);
        let tiles = Pattern::Bricks {
            other: roof.map(|c| c * 0.5),
            size: [0.3, 0.35],
            joint: 0.04,
            variation: 0.3,
            seed: dice.seed(),
        };
        let roof = palette.add(Material { pattern: tiles, ..matte(roof) });
        Self { front, side, roof, ground_floor, pitch, pitched: dice.chance(0.65) }
    }
}

fn wall_color(unusual: bool, dice: &mut Dice) -> Color {
    if unusual {
        return any_color(dice);
    }
    let color = dice.weighted(&[
        ([0.72, 0.70, 0.64], 4.0),
        ([0.62, 0.52, 0.32], 2.0),
        ([0.45, 0.42, 0.38], 2.0),
        ([0.30, 0.11, 0.07], 2.0),
        ([0.55, 0.35, 0.22], 1.0),
        ([0.3, 0.33, 0.36], 1.0),
        ([0.25, 0.3, 0.22], 0.5),
    ]);
    varied(dice, color, 0.2)
}

/// Plaster, bricks or concrete.
pub(crate) fn plain_wall(color: Color, dice: &mut Dice) -> Material {
    let seed = dice.seed();
    let pattern = if dice.chance(0.35) {
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
            scale: dice.range32(0.5, 4.0),
            amount: dice.range32(0.2, 1.0),
            seed,
        }
    };
    Material { pattern, ..matte(color) }
}

/// A house whose front (along x) lies at z = 0 and which reaches back to negative z; whole floors of about `height` together.
pub(crate) fn house(width: f32, depth: f32, height: f32, look: &HouseLook, dice: &mut Dice) -> Mesh {
    let mut shape = Shape::default();
    let half = width / 2.0;
    let floor = dice.range32(3.0, 3.6);
    let [across, up] = look.pitch;
    let floors = ((height - floor) / up).round().max(1.0);
    let height = floor + floors * up;
    shape.block([-half - 0.03, -0.35, -depth], [half + 0.03, 0.8, 0.03], look.side);
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
        gable_roof(&mut shape, half, depth, height, look, dice);
    }
    if dice.chance(0.5) {
        let x = dice.range32(-half * 0.7, half * 0.7);
        shape.block(
            [x - 0.4, -height - depth * 0.45, -depth * 0.6],
            [x + 0.4, -height + 0.5, -depth * 0.45],
            look.side,
        );
    }
    if dice.chance(0.35) && half > 3.5 {
        // Balconies, or bays.
        let x = dice.range32(-half * 0.6, half * 0.6);
        for k in 0..floors as usize {
            let level = floor + up * k as f32;
            let out = 1.0;
            shape.block([x - 1.4, -level - 0.95, out - 0.06], [x + 1.4, -level + 0.05, out], look.side);
            shape.block([x - 1.4, -level, 0.0], [x + 1.4, -level + 0.12, out], look.side);
        }
    }
    door(&mut shape, half, look, dice);
    shape.mesh
}

/// A front door with a step.
fn door(shape: &mut Shape, half: f32, look: &HouseLook, dice: &mut Dice) {
    let x = dice.range32(-half * 0.8, half * 0.8);
    shape.block([x - 0.55, -2.3, 0.0], [x + 0.55, 0.1, 0.05], look.roof);
    shape.block([x - 0.9, -0.18, 0.0], [x + 0.9, 0.3, 0.5], look.side);
}

fn gable_roof(shape: &mut Shape, half: f32, depth: f32, height: f32, look: &HouseLook, dice: &mut Dice) {
    let rise = depth * dice.range32(0.25, 0.55);
    let eaves = 0.4;
    let along_street = dice.chance(0.7);
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
pub(crate) fn street_lamp(stage: &mut Stage, at: Vec3, yaw: f64, height: f32, stock: &Stock, dice: &mut Dice) {
    let mut shape = Shape::default();
    let reach = dice.range32(0.5, 2.2);
    shape.tube([0.0, 0.1, 0.0], [0.0, -height, 0.0], [0.08, 0.05], 7, stock.metal);
    shape.tube([0.0, -height, 0.0], [0.0, -height - 0.15, reach], [0.05, 0.04], 5, stock.metal);
    let on = stage.light.lamps_on;
    let head = stage.palette.glowing(grey(0.3), if on { [4.0, 3.2, 2.0] } else { [0.0; 3] });
    shape.block(
        [-0.12, -height - 0.22, reach - 0.1],
        [0.12, -height - 0.1, reach + 0.5],
        if on { head } else { stock.metal },
    );
    stage.solid.place(&shape.mesh, yaw, at);
    if on && stage.lamps.len() < 24 {
        let out = crate::shape::Turn::new(yaw).apply([0.0, -height - 0.05, reach + 0.2]);
        let position = crate::vector::add(at, out);
        let warm = dice.range32(0.45, 0.95);
        let color = [30.0, 30.0 * (0.5 + 0.5 * warm), 30.0 * warm * 0.8];
        stage.lamps.push(Lamp { position, direction: [0.0, 1.0, 0.0], cone_cos: 0.25, color, reach_m: 28.0 });
    }
}

/// A sign on a post; it faces -x.
pub(crate) fn sign(stage: &mut Stage, stock: &Stock, dice: &mut Dice) -> Mesh {
    let mut shape = Shape::default();
    let height = dice.range32(2.0, 3.0);
    shape.tube([0.0, 0.1, 0.0], [0.0, -height, 0.0], [0.035; 2], 6, stock.metal);
    let colors: [Color; 5] =
        [[0.5, 0.02, 0.02], [0.02, 0.08, 0.5], [0.75, 0.75, 0.72], [0.75, 0.5, 0.02], [0.02, 0.2, 0.08]];
    let (rim, face) = (dice.pick(&colors), dice.pick(&colors));
    let (rim, face) = (stage.palette.matte(rim), stage.palette.matte(face));
    let radius = dice.range32(0.25, 0.42);
    let center = [-0.05, -height + radius, 0.0];
    let sides = dice.pick(&[3, 4, 12, 12]);
    shape.disc(center, [-1.0, 0.0, 0.0], [0.0, radius], sides, &[rim]);
    shape.disc([-0.055, center[1], 0.0], [-1.0, 0.0, 0.0], [0.0, radius * 0.75], sides, &[face]);
    shape.mesh
}

/// A traffic light on a post; it faces -x.
pub(crate) fn traffic_light(stage: &mut Stage, stock: &Stock, dice: &mut Dice) -> Mesh {
    let mut shape = Shape::default();
    let height = dice.range32(2.6, 3.4);
    shape.tube([0.0, 0.1, 0.0], [0.0, -height, 0.0], [0.07; 2], 7, stock.metal);
    shape.block([-0.15, -height - 0.1, -0.17], [0.12, -height + 0.85, 0.17], stock.dark);
    let shown = dice.whole(0, 2);
    let lit: [Color; 3] = [[3.0, 0.1, 0.05], [3.0, 1.6, 0.1], [0.1, 2.6, 1.2]];
    for (k, emission) in lit.into_iter().enumerate() {
        let material = stage.palette.glowing(emission.map(|c| c * 0.03), if k == shown { emission } else { [0.0; 3] });
        shape.disc([-0.16, -height + 0.05 + 0.27 * k as f32, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.1], 10, &[material]);
    }
    shape.mesh
}

/// A bollard or a thick post.
pub(crate) fn post(stock: &Stock, dice: &mut Dice) -> Mesh {
    let mut shape = Shape::default();
    let height = dice.range32(0.7, 1.3);
    let radius = dice.range32(0.04, 0.1);
    let material = dice.pick(&[stock.metal, stock.dark, stock.wood, stock.stone]);
    shape.tube([0.0, 0.1, 0.0], [0.0, -height, 0.0], [radius; 2], 7, material);
    shape.disc([0.0, -height, 0.0], [0.0, -1.0, 0.0], [0.0, radius], 7, &[material]);
    shape.mesh
}

/// A bin, a box of the power company, a column for posters.
pub(crate) fn bin(stage: &mut Stage, dice: &mut Dice) -> Mesh {
    let mut shape = Shape::default();
    let color = any_color(dice);
    let material = stage.palette.glossy(color, 0.2, 20.0, 0.02);
    let (half, height) = (dice.range32(0.2, 0.5), dice.range32(0.7, 1.6));
    shape.block([-half, -height, -half], [half, 0.05, half], material);
    shape.mesh
}

/// A bicycle that nobody rides; its length along x.
pub(crate) fn parked_bicycle(stage: &mut Stage, dice: &mut Dice) -> Mesh {
    let mut shape = Shape::default();
    let color = any_color(dice);
    let frame = stage.palette.matte(color);
    let dark = stage.palette.matte(grey(0.02));
    for _ in 0..dice.whole(1, 3) {
        let mut one = Shape::default();
        bicycle(&mut one, frame, dark, Detail::Middle);
        let at = [dice.range32(-0.3, 0.3), 0.0, shape.mesh.vertices.len() as f32 * 0.0006];
        shape.place(&one.mesh, dice.range(-0.2, 0.2), at);
    }
    shape.mesh
}

/// A block, a ball or a slab of any colour.
pub(crate) fn oddment(stage: &mut Stage, size: f32, dice: &mut Dice) -> Mesh {
    let mut shape = Shape::default();
    let color = any_color(dice);
    let material = stage.palette.glossy(color, dice.range32(0.0, 0.9), 40.0, dice.range32(0.0, 0.2));
    let half = [0, 1, 2].map(|_| size * dice.range32(0.1, 0.5));
    match dice.whole(0, 2) {
        0 => shape.block(half.map(|h| -h), half, material),
        1 => shape.ball([0.0; 3], half, [5, 8], material, || dice.range32(-0.3, 0.3)),
        _ => shape.tube([0.0, half[1], 0.0], [half[0], -half[1], half[2]], [half[0], half[2]], 9, material),
    }
    shape.mesh
}
