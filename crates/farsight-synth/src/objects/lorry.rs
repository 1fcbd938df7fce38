//! Lorries that KITTI's city has few of: articulated ones, open ones, small ones; and buses with a bonnet.

use super::context::BuildContext;
use super::load::{self, Load};
use super::paint::{VehicleMaterials, fleet_materials};
use super::truck::{Hull, WALL_BEHIND_WHEELS, axle_wheels, cab_face, chassis, panel, pillars, plate, rear_face};
use crate::mesh_builder::MeshBuilder;
use crate::palette::{any_color, grey, matte, varied};
use crate::rng::SceneRng;
use crate::scene::{Material, MaterialId, Mesh, Pattern};

/// Height of the floor of a semi-trailer, metres.
const TRAILER_FLOOR_M: f32 = 1.15;

/// A tractor without a bonnet and its semi-trailer.
pub(super) fn articulated(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let [height, width, length] = hwl;
    let materials = fleet_materials(context);
    let front = length / 2.0;
    let mut shape = MeshBuilder::default();
    let cab_length = context.rng.range32(2.0, 2.4);
    let roof = height * context.rng.range32(0.85, 0.99);
    cab(&mut shape, hwl, [front - cab_length, front], roof, &materials);
    let trailer_front = front - cab_length - context.rng.range32(0.5, 0.9);
    trailer(&mut shape, hwl, trailer_front, &materials, context);
    chassis(&mut shape, hwl, [front - cab_length, TRAILER_FLOOR_M], &materials);
    let from_front = [1.4, 5.0, length - 4.9, length - 3.6, length - 2.3];
    axle_wheels(&mut shape, [height, width, length], &from_front.map(|m| m / length), &materials, context);
    shape.mesh
}

/// A tractor with its engine in front and often a bed behind the driver, and its semi-trailer.
pub(super) fn bonneted_articulated(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let [height, width, length] = hwl;
    let materials = fleet_materials(context);
    let front = length / 2.0;
    let mut shape = MeshBuilder::default();
    let sleeps = context.rng.chance(0.7);
    let hood = context.rng.range32(1.7, 2.3);
    let cab_rear = front - hood - if sleeps { 3.6 } else { 1.7 };
    bonnet(&mut shape, hwl, [front - hood, front], height * context.rng.range32(0.42, 0.5), &materials);
    let roof = height * if sleeps { context.rng.range32(0.85, 0.98) } else { 0.72 };
    let low = 0.46 * height;
    let half = width / 2.0 - 0.1;
    let cab = Hull { rear: cab_rear, front: front - hood + 0.3, floor: 0.45, roof, half, round: 0.2, rake: 0.45 };
    cab.build(&mut shape, [low, low + 0.2 * height], [materials.body, materials.glass, materials.under]);
    for side in [-1.0f32, 1.0] {
        let z = side * (half + 0.02);
        if context.rng.chance(0.7) {
            shape.tube([cab_rear + 0.1, -1.0, z], [cab_rear + 0.1, -height * 0.97, z], [0.08; 2], 8, materials.chrome);
        }
        // Tanks under the doors, and the closed wall of the bed behind the side window.
        shape.tube(
            [cab_rear + 0.3, -0.75, side * half * 0.82],
            [front - hood - 0.2, -0.75, side * half * 0.82],
            [0.3; 2],
            9,
            materials.chrome,
        );
        if sleeps {
            let wall = [[cab_rear, -low, z], [front - hood - 1.3, -low, z]];
            let top = low + 0.2 * height;
            let points = [wall[0], wall[1], [wall[1][0], -top, z], [wall[0][0], -top, z]];
            shape.quad(points, materials.body, 0);
        }
    }
    let trailer_front = (cab_rear - context.rng.range32(0.4, 0.9)).max(front - 7.5);
    trailer(&mut shape, hwl, trailer_front, &materials, context);
    chassis(&mut shape, hwl, [cab_rear, TRAILER_FLOOR_M], &materials);
    let drive = front - cab_rear;
    let from_front = [1.15, drive - 0.4, drive + 0.9, length - 3.4, length - 2.1];
    axle_wheels(&mut shape, [height, width, length], &from_front.map(|m| m / length), &materials, context);
    shape.mesh
}

/// A cab over its wheels, between these x, with its face.
fn cab(
    shape: &mut MeshBuilder,
    [_, width, _]: [f32; 3],
    [rear, front]: [f32; 2],
    roof: f32,
    materials: &VehicleMaterials,
) {
    let half = width / 2.0 - WALL_BEHIND_WHEELS;
    let cab = Hull { rear, front, floor: 0.4, roof, half, round: 0.18, rake: 0.3 };
    let sill = 0.4 + (roof - 0.4) * 0.45;
    cab.build(shape, [sill, sill + (roof - 0.4) * 0.27], [materials.body, materials.glass, materials.under]);
    cab_face(shape, &cab, sill, materials);
}

/// An engine's bonnet with grille and lamps.
fn bonnet(
    shape: &mut MeshBuilder,
    [_, width, _]: [f32; 3],
    [rear, front]: [f32; 2],
    top: f32,
    materials: &VehicleMaterials,
) {
    let half = width / 2.0 * 0.72;
    let hood = Hull { rear, front, floor: 0.6, roof: top, half, round: 0.25, rake: 0.3 };
    let middle = 0.6 * top;
    hood.build(shape, [middle, middle + 0.05], [materials.body, materials.body, materials.under]);
    let x = front + 0.01;
    panel(shape, x, [0.75, top - 0.3], [-half * 0.6, half * 0.6], materials.grille);
    for side in [-1.0f32, 1.0] {
        let (inner, outer) = (side * half * 0.68, side * half * 0.88);
        panel(shape, x, [0.8, 1.05], [inner.min(outer), inner.max(outer)], materials.head_lamp);
    }
    shape.cuboid([front - 0.3, -0.7, -width / 2.0 * 0.95], [front + 0.06, -0.4, width / 2.0 * 0.95], materials.chrome);
    if materials.front_plate {
        plate(shape, front + 0.07, [0.5, 0.61], materials);
    }
}

/// A semi-trailer up to `front`: a box, a tank or a container, as high as the lorry.
fn trailer(
    shape: &mut MeshBuilder,
    [height, width, length]: [f32; 3],
    front: f32,
    materials: &VehicleMaterials,
    context: &mut BuildContext,
) {
    let rear = -length / 2.0 + 0.02;
    let half = width / 2.0 - 0.02;
    let kind = context.rng.weighted(&[(0, 6.0), (1, 1.0), (2, 1.5)]);
    let material = load::material(context, true, materials);
    let load = Load { ends: [rear, front], heights: [TRAILER_FLOOR_M, height], half, material };
    match kind {
        1 => {
            let radius = (height - TRAILER_FLOOR_M) / 2.0;
            let middle = -(TRAILER_FLOOR_M + radius);
            let round = radius.min(half);
            shape.tube([rear + 0.1, middle, 0.0], [front - 0.1, middle, 0.0], [round; 2], 16, materials.chrome);
            for (x, axis) in [(rear + 0.1, -1.0), (front - 0.1, 1.0)] {
                shape.disc([x, middle, 0.0], [axis, 0.0, 0.0], [0.0, round], 16, &[materials.chrome]);
            }
            shape.cuboid([rear, -TRAILER_FLOOR_M - 0.25, -half], [front, -TRAILER_FLOOR_M, half], materials.trim);
            shape.cuboid([rear + 0.6, -height, -0.25], [front - 0.6, -height + 0.12, 0.25], materials.trim);
        }
        2 => {
            let steel = corrugated(context);
            Load { material: steel, ..load }.build(shape);
            load.doors(shape, materials, &mut context.rng);
        }
        _ => {
            load.build(shape);
            load.doors(shape, materials, &mut context.rng);
            if context.rng.chance(0.6) {
                load.lettering(shape, context);
            }
        }
    }
}

/// The ribs of a container.
fn corrugated(context: &mut BuildContext) -> MaterialId {
    let rng = &mut context.rng;
    let color = varied(
        rng,
        rng.clone().pick(&[[0.3, 0.06, 0.03], [0.04, 0.1, 0.25], [0.05, 0.15, 0.08], [0.5, 0.5, 0.48]]),
        0.3,
    );
    let pattern = Pattern::Bricks {
        other: color.map(|c| c * 0.55),
        size: [0.28, 9.0],
        joint: 0.1,
        variation: 0.05,
        seed: rng.seed(),
    };
    context.palette.add(Material { pattern, ..matte(color) })
}

/// A lorry with an open bed, and perhaps something on it.
pub(super) fn flatbed(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let [height, width, length] = hwl;
    let materials = fleet_materials(context);
    let (front, rear) = (length / 2.0, -length / 2.0);
    let mut shape = MeshBuilder::default();
    let cab_length = context.rng.range32(1.6, 2.1).min(length * 0.36);
    cab(&mut shape, hwl, [front - cab_length, front], height * context.rng.range32(0.86, 0.99), &materials);
    let floor = (0.34 * height).min(1.05);
    let ends = [rear + 0.02, front - cab_length - 0.15];
    let side = height * context.rng.range32(0.08, 0.35);
    open_bed(&mut shape, ends, [floor, floor + side], width / 2.0 - 0.02, &materials);
    goods(&mut shape, ends, [floor, height * context.rng.range32(0.6, 1.0)], width / 2.0 - 0.15, context);
    // A headboard reaches to the top.
    let board = [ends[1] - 0.08, ends[1]];
    shape.cuboid([board[0], -height, -width * 0.46], [board[1], -floor, width * 0.46], materials.second);
    chassis(&mut shape, hwl, [front - cab_length, floor], &materials);
    let axles: &[f32] = if length > 8.5 { &[0.14, 0.72, 0.84] } else { &[0.17, 0.76] };
    axle_wheels(&mut shape, hwl, axles, &materials, context);
    shape.mesh
}

/// A very small lorry.
pub(super) fn mini_truck(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let [height, width, length] = hwl;
    let materials = fleet_materials(context);
    let (front, rear) = (length / 2.0, -length / 2.0);
    let mut shape = MeshBuilder::default();
    let cab_rear = front - 0.38 * length;
    cab(&mut shape, hwl, [cab_rear, front], height, &materials);
    let ends = [rear + 0.01, cab_rear - 0.04];
    open_bed(&mut shape, ends, [0.36 * height, 0.53 * height], width / 2.0 - 0.01, &materials);
    goods(&mut shape, ends, [0.36 * height, height * context.rng.range32(0.5, 0.98)], width / 2.0 - 0.1, context);
    let x = rear - 0.005;
    for side in [-1.0f32, 1.0] {
        let (inner, outer) = (side * width * 0.36, side * width * 0.47);
        panel(
            &mut shape,
            x,
            [0.24 * height, 0.33 * height],
            [inner.min(outer), inner.max(outer)],
            materials.brake_lamp,
        );
    }
    plate(&mut shape, x - 0.01, [0.24 * height, 0.24 * height + 0.11], &materials);
    axle_wheels(&mut shape, hwl, &[0.14, 0.78], &materials, context);
    shape.mesh
}

/// A floor with four low walls.
fn open_bed(
    shape: &mut MeshBuilder,
    [rear, front]: [f32; 2],
    [floor, top]: [f32; 2],
    half: f32,
    materials: &VehicleMaterials,
) {
    shape.cuboid([rear, -floor - 0.05, -half], [front, -floor + 0.12, half], materials.second);
    for side in [-1.0f32, 1.0] {
        let (inner, outer) = (side * (half - 0.04), side * half);
        shape.cuboid([rear, -top, inner.min(outer)], [front, -floor - 0.05, inner.max(outer)], materials.body);
    }
    shape.cuboid([rear, -top, -half + 0.04], [rear + 0.04, -floor - 0.05, half - 0.04], materials.body);
}

/// What lies on an open bed: nothing, a heap, crates, pipes or beams.
fn goods(
    shape: &mut MeshBuilder,
    [rear, front]: [f32; 2],
    [floor, top]: [f32; 2],
    half: f32,
    context: &mut BuildContext,
) {
    let BuildContext { palette, rng, .. } = context;
    let (middle, reach) = (f32::midpoint(rear, front), (front - rear) / 2.0 - 0.12);
    match rng.weighted(&[(0, 2.0), (1, 1.5), (2, 2.0), (3, 1.0)]) {
        0 => {}
        1 => {
            let color = varied(rng, [0.3, 0.22, 0.14], 0.5);
            let earth = palette.noise(color, color.map(|c| c * 0.5), 0.3, rng.seed());
            let bumps: &mut SceneRng = rng;
            shape.ellipsoid([middle, -floor, 0.0], [reach, (top - floor) * 0.8, half], [6, 12], earth, || {
                bumps.range32(-0.06, 0.06)
            });
        }
        2 => {
            let count = ((2.0 * reach / 1.1) as usize).clamp(1, 8);
            for k in 0..count {
                let x = middle - reach + (k as f32 + 0.5) * 2.0 * reach / count as f32;
                let (long, tall) = (reach / count as f32 * 0.94, (top - floor) * rng.range32(0.35, 1.0));
                let crate_color = any_color(rng);
                let crate_color = if rng.chance(0.6) { varied(rng, [0.35, 0.24, 0.13], 0.4) } else { crate_color };
                let material = palette.noise(crate_color, crate_color.map(|c| c * 0.6), 0.2, rng.seed());
                shape.cuboid([x - long, -floor - tall, -half * 0.92], [x + long, -floor - 0.06, half * 0.92], material);
            }
        }
        _ => {
            let tone = rng.range32(0.05, 0.4);
            let material = palette.glossy(grey(tone), 0.3, 20.0, 0.03);
            for k in 0..5 {
                let z = half * (k as f32 - 2.0) * 0.4;
                let radius = half * 0.17;
                let lift = floor + 0.06 + radius * if k % 2 == 0 { 1.0 } else { 2.6 };
                shape.tube([rear + 0.1, -lift, z], [front - 0.1, -lift, z], [radius; 2], 7, material);
            }
        }
    }
}

/// A school bus: a long box behind a bonnet, with black rails along its sides.
pub(super) fn school_bus(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let [height, width, length] = hwl;
    let materials = fleet_materials(context);
    let (front, rear) = (length / 2.0, -length / 2.0);
    let mut shape = MeshBuilder::default();
    let hood = context.rng.range32(1.2, 1.6);
    bonnet(&mut shape, hwl, [front - hood, front], 0.52 * height, &materials);
    let half = width / 2.0 - WALL_BEHIND_WHEELS;
    let hull = Hull { rear, front: front - hood + 0.2, floor: 0.45, roof: height, half, round: 0.35, rake: 0.3 };
    let windows = [0.55 * height, 0.78 * height];
    hull.build(&mut shape, windows, [materials.body, materials.glass, materials.under]);
    pillars(&mut shape, [height, 2.0 * half, length - hood * 2.2], windows, 0.75, (materials.body, 0));
    for side in [-1.0f32, 1.0] {
        let z = side * (half + 0.012);
        for level in [0.33, 0.42, 0.52] {
            let [low, high] = [level * height, level * height + 0.06];
            let [a, b] = [rear + 0.15, front - hood - 0.1];
            shape.quad([[a, -low, z], [b, -low, z], [b, -high, z], [a, -high, z]], materials.trim, 0);
        }
    }
    rear_face(&mut shape, hwl, windows[0], &materials);
    // Warning lamps over the windows, and a black bumper.
    for (x, out) in [(rear, -1.0f32), (front - hood + 0.2, 1.0)] {
        for side in [-1.0f32, 1.0] {
            let (inner, outer) = (side * half * 0.55, side * half * 0.75);
            let heights = [0.85 * height, 0.91 * height];
            panel(&mut shape, x + out * 0.02, heights, [inner.min(outer), inner.max(outer)], materials.brake_lamp);
        }
    }
    axle_wheels(&mut shape, hwl, &[0.1, 0.68], &materials, context);
    shape.mesh
}
