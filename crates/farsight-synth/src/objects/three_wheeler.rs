//! Motor three-wheelers: a driver's cabin on one wheel, a bench under a hood on two.

use super::context::{BuildContext, Detail};
use super::paint::fleet_materials;
use super::person;
use super::truck::{Hull, panel, plate};
use super::wheels::Wheel;
use crate::mesh_builder::MeshBuilder;
use crate::palette::grey;
use crate::scene::Mesh;

/// A three-wheeler, for boxes of about 2.65 x 1.3 x 1.7 m.
pub(super) fn three_wheeler([height, width, length]: [f32; 3], context: &mut BuildContext) -> Mesh {
    let materials = fleet_materials(context);
    let hood_color = context.rng.pick(&[[0.03, 0.03, 0.03], [0.5, 0.36, 0.02], [0.03, 0.03, 0.03]]);
    let hood = context.palette.glossy(hood_color, 0.15, 15.0, 0.02);
    let bare = context.palette.matte(grey(0.012));
    let (front, rear) = (length / 2.0, -length / 2.0);
    let half = width / 2.0 - 0.03;
    let belt = 0.5 * height;
    let mut shape = MeshBuilder::default();
    // The tub with the bench, and the nose.
    let tub = Hull { rear, front: 0.1 * length, floor: 0.26, roof: belt, half, round: 0.08, rake: 0.0 };
    tub.build(&mut shape, [0.4, 0.42], [materials.body, materials.body, bare]);
    let nose =
        Hull { rear: 0.2 * length, front, floor: 0.3, roof: belt * 0.98, half: 0.62 * half, round: 0.2, rake: 0.25 };
    nose.build(&mut shape, [0.5, 0.52], [materials.body, materials.body, bare]);
    shape.cuboid([0.08 * length, -0.3, -half * 0.9], [0.22 * length, -0.24, half * 0.9], bare);
    // The hood with its rear wall, the windscreen and its posts.
    let top = [-height, -height + 0.1];
    shape.cuboid([rear + 0.04, top[0], -half], [0.26 * length, top[1], half], hood);
    shape.cuboid([rear + 0.03, top[1], -half], [rear + 0.07, -belt, half], hood);
    for side in [-1.0f32, 1.0] {
        let z = side * half * 0.96;
        shape.quad(
            [
                [rear + 0.05, -belt, z],
                [rear + 0.3 * length, -belt, z],
                [rear + 0.24 * length, top[1], z],
                [rear + 0.05, top[1], z],
            ],
            hood,
            0,
        );
        shape.tube([0.32 * length, -belt, side * 0.6 * half], [0.24 * length, top[1], z], [0.02; 2], 4, materials.trim);
        shape.tube([0.0, -belt, z], [0.0, top[1], z], [0.018; 2], 4, materials.trim);
    }
    let low = [[0.32 * length, -belt * 0.98, -0.6 * half], [0.32 * length, -belt * 0.98, 0.6 * half]];
    let high = [[0.25 * length, top[1], 0.9 * half], [0.25 * length, top[1], -0.9 * half]];
    shape.quad([low[0], low[1], high[0], high[1]], materials.window, 0);
    // Inside: the bench, the driver, those who are driven.
    shape.cuboid([rear + 0.3, -belt - 0.35, -half * 0.85], [rear + 0.42, -belt, half * 0.85], materials.seat);
    person::riding(&mut shape, [0.1 * length, -0.42 * height, 0.0], context);
    if context.rng.chance(0.5) {
        person::riding(&mut shape, [rear + 0.62, -0.42 * height, half * 0.4], context);
    }
    lamps(&mut shape, [height, width, length], &materials);
    plate(&mut shape, rear - 0.008, [0.36, 0.47], &materials);
    wheels(&mut shape, [front, rear, half], &materials, context.detail);
    shape.mesh
}

fn lamps(shape: &mut MeshBuilder, [_, width, length]: [f32; 3], materials: &super::paint::VehicleMaterials) {
    panel(shape, length / 2.0 + 0.006, [0.52, 0.68], [-0.08, 0.08], materials.head_lamp);
    for side in [-1.0f32, 1.0] {
        let (inner, outer) = (side * width * 0.36, side * width * 0.45);
        panel(shape, -length / 2.0 - 0.006, [0.5, 0.62], [inner.min(outer), inner.max(outer)], materials.brake_lamp);
    }
}

fn wheels(
    shape: &mut MeshBuilder,
    [front, rear, half]: [f32; 3],
    materials: &super::paint::VehicleMaterials,
    detail: Detail,
) {
    const RADIUS_M: f32 = 0.21;
    for side in [-1.0f32, 1.0] {
        let center = [rear + 0.5, -RADIUS_M, side * (half + 0.02)];
        Wheel { center, radius: RADIUS_M, width: 0.12, rim: 0.55, spokes: 6 }.build(shape, materials, detail);
    }
    let center = [front - 0.3, -RADIUS_M, 0.0];
    for side in [-0.06, 0.06] {
        let center = [center[0], center[1], side];
        Wheel { center, radius: RADIUS_M, width: 0.06, rim: 0.55, spokes: 6 }.build(shape, materials, detail);
    }
}
