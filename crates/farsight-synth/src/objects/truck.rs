//! Trucks, buses, trams and trailers.

use super::context::BuildContext;
use super::load::{self, Load, upright};
use super::paint::{VehicleMaterials, fleet_materials};
use super::wheels::Wheel;
use crate::mesh_builder::MeshBuilder;
use crate::scene::{MaterialId, Mesh, Vec3};

/// How far walls stay behind the tyres, metres: there are no arches, and a wheel's dish is 5 cm deep.
pub(super) const WALL_BEHIND_WHEELS: f32 = 0.06;

/// A rigid truck: cab and box, tipper or flat bed. KITTI counts buses among them.
pub(super) fn truck(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let long = hwl[2] > 9.0;
    match context.rng.weighted(&[(0, 1.0), (1, 0.5), (2, if long { 0.7 } else { 0.1 })]) {
        0 => rigid_truck(hwl, true, context),
        1 => rigid_truck(hwl, false, context),
        _ => bus(hwl, context),
    }
}

/// Where a vehicle of straight walls lies: x of its rear and front, height of floor and roof, half width.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hull {
    pub(super) rear: f32,
    pub(super) front: f32,
    pub(super) floor: f32,
    pub(super) roof: f32,
    pub(super) half: f32,
    /// Radius of the edges.
    pub(super) round: f32,
    /// How far the front leans back.
    pub(super) rake: f32,
}

impl Hull {
    /// Walls with rounded upper edges; bands from the floor: skirt, wall, windows, wall above, roof.
    pub(super) fn build(&self, shape: &mut MeshBuilder, windows: [f32; 2], materials: [MaterialId; 3]) {
        let [wall, glass, under] = materials;
        let heights = [self.floor, self.floor + 0.02, windows[0], windows[1], self.roof - self.round];
        let section = |x: f32, narrow: f32, lean: f32| {
            let half = self.half * narrow;
            let mut points: Vec<[f32; 2]> = vec![[0.0, self.floor]];
            points.extend(heights.map(|h| [half, h]));
            points.extend([
                [half - 0.3 * self.round, self.roof - 0.3 * self.round],
                [half - self.round, self.roof],
                [0.0, self.roof],
            ]);
            let span = self.roof - self.floor;
            let at = |[z, h]: [f32; 2], side: f32| {
                let up = ((h - windows[0]) / span).max(0.0);
                [x - lean * self.rake * up, -h, side * z]
            };
            let right: Vec<Vec3> = points.iter().map(|&p| at(p, 1.0)).collect();
            let left: Vec<Vec3> = points.iter().rev().skip(1).map(|&p| at(p, -1.0)).collect();
            [right, left].concat()
        };
        let round = 0.12f32.min((self.front - self.rear) / 4.0);
        let sections = [
            section(self.rear, 0.94, 0.0),
            section(self.rear + round, 1.0, 0.0),
            section(self.front - 2.0 * round, 1.0, 0.5),
            section(self.front - 0.4 * round, 0.985, 1.0),
            section(self.front, 0.9, 1.0),
        ];
        let columns = sections[0].len() - 1;
        let band = |j: usize| if j < columns / 2 { j } else { columns - 1 - j };
        shape.loft(&sections, |_, j| {
            Some(match band(j) {
                0 => under,
                3 => glass,
                _ => wall,
            })
        });
        for (end, window) in [(0, false), (sections.len() - 1, true)] {
            let section = &sections[end];
            for j in 0..columns / 2 {
                let [a, b] = [section[j], section[j + 1]];
                let [c, d] = [section[columns - j - 1], section[columns - j]];
                let material = if band(j) == 3 && window { glass } else { wall };
                shape.quad([d, a, b, c], material, 0);
            }
        }
    }
}

pub(super) fn rigid_truck(hwl: [f32; 3], closed: bool, context: &mut BuildContext) -> Mesh {
    let [height, width, length] = hwl;
    let materials = fleet_materials(context);
    let rng = &mut context.rng;
    let cab_length = rng.range32(1.7, 2.3).min(length * 0.4);
    let cab_height = if height > 2.6 { height * rng.range32(0.72, 0.97) } else { height * 0.95 };
    let load_height = if closed { height } else { height * rng.range32(0.55, 0.75) };
    let (front, rear) = (length / 2.0, -length / 2.0);
    let bed = 0.95f32.min(height * 0.35);
    let load_front = front - cab_length - rng.range32(0.1, 0.5);
    let mut shape = MeshBuilder::default();
    let cab = Hull {
        rear: front - cab_length,
        front,
        floor: 0.4,
        roof: cab_height,
        half: width / 2.0 - WALL_BEHIND_WHEELS,
        round: 0.18,
        rake: 0.35,
    };
    let sill = 0.4 + (cab_height - 0.4) * 0.5;
    cab.build(&mut shape, [sill, sill + (cab_height - 0.4) * 0.32], [materials.body, materials.glass, materials.under]);
    cab_face(&mut shape, &cab, sill, &materials);
    let load = Load {
        ends: [rear + 0.02, load_front],
        heights: [bed, load_height],
        half: width / 2.0 - 0.02,
        material: load::material(context, closed, &materials),
    };
    load.build(&mut shape);
    if closed {
        load.doors(&mut shape, &materials, &mut context.rng);
        if context.rng.chance(0.6) {
            load.lettering(&mut shape, context);
        }
    } else {
        // A headboard reaches to the top.
        shape.cuboid(
            [load_front - 0.1, -height, -width / 2.0 * 0.95],
            [load_front + 0.02, -bed + 0.02, width / 2.0 * 0.95],
            materials.second,
        );
    }
    chassis(&mut shape, hwl, [cab.rear, bed], &materials);
    let axles: &[f32] = if length > 9.0 { &[0.14, 0.72, 0.84] } else { &[0.17, 0.78] };
    axle_wheels(&mut shape, hwl, axles, &materials, context);
    shape.mesh
}

/// What is below the load: frame, guards at the sides, lamps, plate and bumper in the rear.
pub(super) fn chassis(
    shape: &mut MeshBuilder,
    [_, width, length]: [f32; 3],
    [cab_rear, bed]: [f32; 2],
    materials: &VehicleMaterials,
) {
    let (front, rear) = (length / 2.0, -length / 2.0);
    shape.cuboid([rear + 0.1, -bed - 0.02, -0.45], [front - 0.3, -0.5, 0.45], materials.under);
    for side in [-1.0f32, 1.0] {
        let z = side * width / 2.0 * 0.98;
        let [a, b] = [rear + length * 0.35, cab_rear - 0.6];
        if b > a + 0.5 {
            shape.quad([[a, -0.45, z], [b, -0.45, z], [b, -bed, z], [a, -bed, z]], materials.trim, 0);
        }
        let [near, far] = [side * width / 2.0 * 0.55, side * width / 2.0 * 0.95];
        panel(shape, rear - 0.01, [0.7, 0.85], [near, far], materials.brake_lamp);
    }
    plate(shape, rear - 0.01, [0.62, 0.73], materials);
    shape.cuboid([rear, -0.6, -width / 2.0 * 0.9], [rear + 0.08, -0.45, width / 2.0 * 0.9], materials.trim);
}

/// A flat piece across the vehicle at `x`, between two heights and from left to right.
pub(super) fn panel(shape: &mut MeshBuilder, x: f32, heights: [f32; 2], sides: [f32; 2], material: MaterialId) {
    shape.quad(upright(x, heights, sides), material, 0);
}

/// A plate in the middle; of a region's format it has its own size about the middle of these heights.
pub(super) fn plate(shape: &mut MeshBuilder, x: f32, heights: [f32; 2], materials: &VehicleMaterials) {
    let middle = f32::midpoint(heights[0], heights[1]);
    let (heights, half) = match materials.plate_size {
        None => (heights, 0.26),
        Some([width, height]) => ([middle - height / 2.0, middle + height / 2.0], width / 2.0),
    };
    panel(shape, x, heights, [-half, half], materials.plate);
}

/// Grille, lamps, bumper and plate in front of a cab.
pub(super) fn cab_face(shape: &mut MeshBuilder, cab: &Hull, sill: f32, materials: &VehicleMaterials) {
    let half = cab.half * 0.88;
    let bumper = cab.front + 0.01;
    panel(shape, bumper, [cab.floor, cab.floor + 0.3], [-half, half], materials.trim);
    panel(shape, bumper, [cab.floor + 0.4, sill - 0.15], [-half * 0.7, half * 0.7], materials.trim);
    let on_bumper = cab.front + 0.02;
    let lamp = [cab.floor + 0.12, cab.floor + 0.3];
    panel(shape, on_bumper, lamp, [-half, -half * 0.65], materials.head_lamp);
    panel(shape, on_bumper, lamp, [half * 0.65, half], materials.head_lamp);
    if materials.front_plate {
        plate(shape, on_bumper, [cab.floor + 0.05, cab.floor + 0.16], materials);
    }
}

pub(super) fn axle_wheels(
    shape: &mut MeshBuilder,
    [height, width, length]: [f32; 3],
    axles: &[f32],
    materials: &VehicleMaterials,
    context: &mut BuildContext,
) {
    let radius = 0.5f32.min(height * 0.16).min(length * 0.09);
    for &t in axles {
        for side in [-1.0f32, 1.0] {
            let center = [length * (0.5 - t), -radius, side * width / 2.0];
            Wheel { center, radius, width: 0.35, rim: 0.55, spokes: 10 }.build(shape, materials, context.detail);
        }
    }
}

pub(super) fn bus(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let [height, width, length] = hwl;
    let materials = fleet_materials(context);
    let mut shape = MeshBuilder::default();
    let hull = Hull {
        rear: -length / 2.0,
        front: length / 2.0,
        floor: 0.32,
        roof: height,
        half: width / 2.0 - WALL_BEHIND_WHEELS,
        round: 0.2,
        rake: 0.25,
    };
    let sill = height * context.rng.range32(0.36, 0.44);
    hull.build(&mut shape, [sill, height * 0.78], [materials.body, materials.glass, materials.under]);
    cab_face(&mut shape, &hull, sill, &materials);
    pillars(&mut shape, hwl, [sill, height * 0.78], 1.5, (materials.body, 0));
    rear_face(&mut shape, hwl, sill, &materials);
    axle_wheels(&mut shape, hwl, &[0.2, 0.72], &materials, context);
    shape.mesh
}

/// Upright bars on both sides, one every `pitch` metres.
pub(super) fn pillars(
    shape: &mut MeshBuilder,
    [_, width, length]: [f32; 3],
    [low, high]: [f32; 2],
    pitch: f32,
    (material, layer): (MaterialId, u8),
) {
    let count = ((length / pitch) as usize).max(2);
    for k in 1..count {
        let x = length * (k as f32 / count as f32 - 0.5);
        for side in [-1.0f32, 1.0] {
            let z = side * (width / 2.0 + 0.004);
            shape.quad(
                [[x - 0.06, -low, z], [x + 0.06, -low, z], [x + 0.06, -high, z], [x - 0.06, -high, z]],
                material,
                layer,
            );
        }
    }
}

pub(super) fn rear_face(
    shape: &mut MeshBuilder,
    [height, width, length]: [f32; 3],
    sill: f32,
    materials: &VehicleMaterials,
) {
    let x = -length / 2.0 - 0.005;
    let half = width / 2.0 * 0.9;
    panel(shape, x, [sill, height * 0.8], [-half * 0.8, half * 0.8], materials.glass);
    panel(shape, x, [0.6, 0.9], [-half, -half * 0.8], materials.brake_lamp);
    panel(shape, x, [0.6, 0.9], [half * 0.8, half], materials.brake_lamp);
    plate(shape, x, [0.5, 0.62], materials);
    panel(shape, x, [0.34, 0.48], [-half, half], materials.trim);
}

/// A tram: one long hull with bands of windows and joints.
pub(super) fn tram(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let [height, width, length] = hwl;
    let materials = fleet_materials(context);
    let mut shape = MeshBuilder::default();
    let hull = Hull {
        rear: -length / 2.0,
        front: length / 2.0,
        floor: 0.3,
        roof: height * 0.93,
        half: width / 2.0,
        round: 0.25,
        rake: 0.7,
    };
    let sill = height * context.rng.range32(0.32, 0.42);
    let top = height * 0.74;
    hull.build(&mut shape, [sill, top], [materials.body, materials.glass, materials.under]);
    pillars(&mut shape, hwl, [sill, top], 1.7, (materials.body, 0));
    // The joints between its parts.
    pillars(&mut shape, hwl, [0.35, height * 0.9], 9.0, (materials.gap, 1));
    rear_face(&mut shape, hwl, sill, &materials);
    cab_face(&mut shape, &hull, sill, &materials);
    // Stripe, roof equipment and bogies.
    for side in [-1.0f32, 1.0] {
        let z = side * (width / 2.0 + 0.003);
        let [a, b] = [-length * 0.48, length * 0.47];
        shape.quad([[a, -0.5, z], [b, -0.5, z], [b, -0.75, z], [a, -0.75, z]], materials.second, 0);
    }
    shape.cuboid([-length * 0.3, -height, -width * 0.3], [length * 0.2, -height * 0.92, width * 0.3], materials.trim);
    shape.cuboid([-length * 0.4, -0.35, -width * 0.42], [-length * 0.25, 0.0, width * 0.42], materials.under);
    shape.cuboid([length * 0.25, -0.35, -width * 0.42], [length * 0.4, 0.0, width * 0.42], materials.under);
    shape.mesh
}

/// A trailer: what KITTI's `Misc` mostly is.
pub(super) fn trailer(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let [height, width, length] = hwl;
    let materials = fleet_materials(context);
    let load = load::material(context, true, &materials);
    let mut shape = MeshBuilder::default();
    let floor = (height * 0.3).min(0.6);
    let draw_bar = (length * 0.2).min(1.2);
    let wall = width / 2.0 - WALL_BEHIND_WHEELS;
    shape.cuboid([-length / 2.0, -height, -wall], [length / 2.0 - draw_bar, -floor, wall], load);
    shape.cuboid(
        [-length / 2.0 + 0.05, -floor - 0.02, -width * 0.4],
        [length / 2.0 - draw_bar, -floor * 0.7, width * 0.4],
        materials.under,
    );
    shape.tube(
        [length / 2.0 - draw_bar, -floor * 0.8, 0.0],
        [length / 2.0, -floor * 0.8, 0.0],
        [0.05; 2],
        6,
        materials.trim,
    );
    let x = -length / 2.0 - 0.004;
    let half = width / 2.0;
    for side in [-1.0f32, 1.0] {
        let [a, b] = [side * half * 0.7, side * half * 0.95];
        panel(&mut shape, x, [floor + 0.05, floor + 0.18], [a, b], materials.brake_lamp);
    }
    axle_wheels(&mut shape, [height.max(1.5), width, length], &[0.55], &materials, context);
    shape.mesh
}
