//! Motorcycles and scooters, with those who ride them.

use super::context::{BuildContext, Detail};
use super::human::HumanMesh;
use super::outfit::Outfit;
use crate::mesh_builder::MeshBuilder;
use crate::palette::{any_color, grey};
use crate::scene::{MaterialId, Mesh, Vec3};

/// Share of riders with a helmet, and of machines with somebody behind the rider.
const HELMETS: f64 = 0.8;
const PILLIONS: f64 = 0.22;

/// What a machine is made of.
struct Materials {
    paint: MaterialId,
    dark: MaterialId,
    metal: MaterialId,
    head_lamp: MaterialId,
    tail_lamp: MaterialId,
}

/// Where somebody sits: hips, neck, hands and feet of the right side (z is mirrored for the left).
struct Seat {
    hips: Vec3,
    neck: Vec3,
    hand: Vec3,
    ankle: Vec3,
}

/// A motorcycle about 2.1 m long with its rider.
pub(super) fn motorcycle(context: &mut BuildContext) -> Mesh {
    let materials = materials(context);
    let detail = context.detail;
    let mut shape = MeshBuilder::default();
    let [rear, front] = [[-0.66, -0.31, 0.0], [0.70, -0.31, 0.0]];
    for (hub, width) in [(rear, 0.14), (front, 0.1)] {
        wheel(&mut shape, hub, [0.31, width], &materials, detail);
    }
    for side in [-0.09, 0.09] {
        shape.tube([0.70, -0.31, side], [0.46, -0.92, side], [0.025; 2], 5, materials.metal);
        shape.tube([-0.66, -0.31, side], [-0.05, -0.42, side], [0.025; 2], 4, materials.dark);
        shape.tube([-0.6, -0.36, side], [-0.42, -0.72, side], [0.03; 2], 5, materials.metal);
    }
    shape.cuboid([-0.15, -0.55, -0.14], [0.27, -0.2, 0.14], materials.metal);
    shape.ellipsoid([0.17, -0.78, 0.0], [0.3, 0.13, 0.14], [6, 10], materials.paint, || 0.0);
    shape.cuboid([-0.72, -0.84, -0.12], [-0.08, -0.74, 0.12], materials.dark);
    shape.cuboid([-0.92, -0.86, -0.07], [-0.66, -0.76, 0.07], materials.paint);
    shape.tube([0.1, -0.22, 0.16], [-0.75, -0.34, 0.19], [0.03, 0.05], 6, materials.metal);
    shape.cuboid([-0.95, -0.8, -0.06], [-0.92, -0.72, 0.06], materials.tail_lamp);
    handlebar(&mut shape, [0.36, -1.02], 0.36, &materials);
    shape.disc([0.58, -0.88, 0.0], [1.0, 0.0, 0.0], [0.0, 0.09], 10, &[materials.head_lamp]);
    shape.cuboid([0.46, -0.98, -0.09], [0.57, -0.8, 0.09], materials.paint);
    let lean = context.rng.range32(-0.04, 0.16);
    let rider = Seat {
        hips: [-0.22, -0.88, 0.0],
        neck: [-0.16 + lean, -1.46 + 0.3 * lean.max(0.0), 0.0],
        hand: [0.33, -1.03, 0.3],
        ankle: [0.02, -0.33, 0.2],
    };
    people(&mut shape, &rider, context);
    shape.mesh
}

/// A scooter about 1.85 m long with its rider.
pub(super) fn scooter(context: &mut BuildContext) -> Mesh {
    let materials = materials(context);
    let detail = context.detail;
    let mut shape = MeshBuilder::default();
    let radius = context.rng.range32(0.2, 0.25);
    for x in [-0.62, 0.64] {
        wheel(&mut shape, [x, -radius, 0.0], [radius, 0.1], &materials, detail);
    }
    // Shield for the legs, floor, body under the seat.
    shape.tube([0.64, -radius, 0.0], [0.44, -0.9, 0.0], [0.05, 0.06], 6, materials.dark);
    let shield = [[0.52, -0.32, -0.19], [0.52, -0.32, 0.19], [0.4, -0.86, 0.22], [0.4, -0.86, -0.22]];
    shape.quad(shield, materials.paint, 0);
    shape.cuboid([0.36, -1.0, -0.13], [0.5, -0.8, 0.13], materials.paint);
    shape.cuboid([-0.15, -0.36, -0.18], [0.5, -0.25, 0.18], materials.dark);
    shape.ellipsoid([-0.48, -0.5, 0.0], [0.42, 0.24, 0.19], [6, 10], materials.paint, || 0.0);
    shape.cuboid([-0.82, -0.82, -0.14], [-0.08, -0.7, 0.14], materials.dark);
    shape.cuboid([-0.92, -0.62, -0.1], [-0.86, -0.5, 0.1], materials.tail_lamp);
    shape.cuboid([0.66, -radius * 2.0 - 0.05, -0.07], [0.86, -radius * 2.0, 0.07], materials.paint);
    handlebar(&mut shape, [0.36, -1.04], 0.32, &materials);
    shape.disc([0.51, -0.92, 0.0], [1.0, 0.0, 0.0], [0.0, 0.08], 9, &[materials.head_lamp]);
    let rider = Seat {
        hips: [-0.3, -0.85, 0.0],
        neck: [-0.26, -1.43, 0.0],
        hand: [0.31, -1.05, 0.27],
        ankle: [0.12, -0.42, 0.12],
    };
    people(&mut shape, &rider, context);
    shape.mesh
}

fn materials(context: &mut BuildContext) -> Materials {
    let BuildContext { palette, rng, state, .. } = context;
    let color = if rng.chance(0.55) { grey(rng.pick(&[0.02, 0.03, 0.06, 0.5])) } else { any_color(rng) };
    let lit = |emission: [f32; 3], on: bool| if on { emission } else { [0.0; 3] };
    Materials {
        paint: palette.glossy(color, 0.6, 60.0, 0.07),
        dark: palette.matte(grey(0.018)),
        metal: palette.glossy(grey(0.25), 0.6, 40.0, 0.2),
        head_lamp: palette.glowing(grey(0.5), lit([6.0, 5.8, 5.2], state.lights_on || rng.chance(0.4))),
        tail_lamp: palette.glowing([0.3, 0.012, 0.012], lit([2.0, 0.08, 0.05], state.lights_on || state.braking)),
    }
}

/// A wheel around a hub; radius and width.
fn wheel(shape: &mut MeshBuilder, hub: Vec3, [radius, width]: [f32; 2], materials: &Materials, detail: Detail) {
    let sides = detail.sides(18);
    let half = width / 2.0;
    let at = |z: f32| [hub[0], hub[1], z];
    shape.tube(at(-half), at(half), [radius; 2], sides, materials.dark);
    for z in [-half, half] {
        let axis = [0.0, 0.0, z.signum()];
        shape.disc(at(z), axis, [0.62 * radius, radius], sides, &[materials.dark]);
        shape.disc(at(0.7 * z), axis, [0.0, 0.64 * radius], sides, &[materials.metal, materials.dark]);
    }
}

/// Handles and mirrors.
fn handlebar(shape: &mut MeshBuilder, [x, y]: [f32; 2], half: f32, materials: &Materials) {
    shape.tube([x, y, -half], [x, y, half], [0.02; 2], 5, materials.dark);
    for side in [-1.0f32, 1.0] {
        let z = side * half * 0.75;
        shape.tube([x, y, z], [x + 0.03, y - 0.16, z + side * 0.06], [0.008; 2], 3, materials.dark);
        let low = [x + 0.02, y - 0.22, z + side * 0.06 - 0.05];
        shape.cuboid(low, [low[0] + 0.02, y - 0.14, low[2] + 0.1], materials.metal);
    }
}

/// The rider, and sometimes somebody behind.
fn people(shape: &mut MeshBuilder, seat: &Seat, context: &mut BuildContext) {
    person(shape, seat, context);
    if context.rng.chance(PILLIONS) {
        let back = |[x, y, z]: Vec3, up: f32| [x - 0.36, y - up, z];
        let behind = Seat {
            hips: back(seat.hips, 0.05),
            neck: back(seat.neck, 0.03),
            hand: [seat.hips[0] + 0.02, seat.hips[1] - 0.18, 0.2],
            ankle: [seat.hips[0] - 0.2, -0.42, 0.2],
        };
        person(shape, &behind, context);
    }
}

fn person(shape: &mut MeshBuilder, seat: &Seat, context: &mut BuildContext) {
    let outfit = Outfit::sample(context);
    let helmet = context.rng.chance(HELMETS).then(|| {
        let color = any_color(&mut context.rng);
        context.palette.glossy(if context.rng.chance(0.6) { grey(0.03) } else { color }, 0.6, 60.0, 0.05)
    });
    let mut figure = HumanMesh { shape, detail: context.detail, outfit: &outfit };
    for side in [-1.0f32, 1.0] {
        let mirrored = |[x, y, z]: Vec3| [x, y, side * z];
        let hip = [seat.hips[0] + 0.02, seat.hips[1] + 0.02, side * 0.1];
        figure.leg(hip, mirrored(seat.ankle), [0.17, 0.05, 0.0]);
        let shoulder = [seat.neck[0], seat.neck[1] + 0.08, side * 0.185];
        figure.arm(shoulder, mirrored(seat.hand), [-0.4, 1.0, side]);
    }
    figure.trunk(seat.hips, seat.neck);
    figure.head(seat.neck, helmet);
}
