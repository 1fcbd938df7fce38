//! What is seen through the windows of cars: lining, dashboard, seats, people.

use super::body::Body;
use super::context::{BuildContext, Detail};
use super::paint::VehicleMaterials;
use super::person;
use crate::mesh_builder::MeshBuilder;

/// How far seats are from the middle, share of the car's width.
const SEAT: f32 = 0.21;

/// From a driver's hips to the roof, metres.
const HIPS_TO_ROOF_M: f32 = 0.93;

/// Furnishes a body that is seen from near enough.
pub(super) fn build_surroundings(
    shape: &mut MeshBuilder,
    body: &Body,
    hwl: [f32; 3],
    materials: &VehicleMaterials,
    context: &mut BuildContext,
) {
    body.line(shape, materials);
    let p = &body.profile;
    let [height, width, _] = hwl;
    let rear_seat = p.pillar + 0.6 * (p.rear[1] - p.pillar);
    shelf(shape, body, [p.screen[0] + 0.02, p.screen[0] + 0.1], materials);
    shelf(shape, body, [rear_seat, p.rear[1] - 0.01], materials);
    let half = 0.14 * width;
    for side in [-1.0f32, 1.0] {
        seat(shape, [body.x(p.pillar), side * SEAT * width], half, height, materials);
    }
    seat(shape, [body.x(rear_seat), 0.0], 0.37 * width, height, materials);
    let driver = if context.rng.chance(0.85) { 1.0 } else { -1.0 };
    if context.detail == Detail::Near {
        let wheel = [body.x(p.pillar) + 0.62, -0.63 * height, driver * SEAT * width];
        shape.disc(wheel, [-0.9, -0.4, 0.0], [0.16, 0.19], 14, &[materials.trim]);
    }
    let hips = |side: f32| [body.x(p.pillar) + 0.2, HIPS_TO_ROOF_M - height, side * SEAT * width];
    if context.state.moving {
        person::riding(shape, hips(driver), context);
        if context.rng.chance(0.3) {
            person::riding(shape, hips(-driver), context);
        }
    }
}

/// A dashboard, or what lies behind the rear seats, between two places along the car, a little below the windows.
fn shelf(shape: &mut MeshBuilder, body: &Body, [front, back]: [f32; 2], materials: &VehicleMaterials) {
    let ([half, front_level], [other_half, back_level]) = (body.shoulder(front), body.shoulder(back));
    let half = 0.9 * half.min(other_half);
    let level = front_level.min(back_level) - 0.04;
    shape.cuboid([body.x(back), -level, -half], [body.x(front), -level + 0.12, half], materials.trim);
}

/// The back of a seat or bench, with headrests.
fn seat(shape: &mut MeshBuilder, [x, z]: [f32; 2], half: f32, height: f32, materials: &VehicleMaterials) {
    let back = [0.3, 0.73].map(|share| -share * height);
    shape.cuboid([x - 0.07, back[1], z - half], [x + 0.07, back[0], z + half], materials.seat);
    let heads: &[f32] = if half > 0.4 { &[-0.6, 0.6] } else { &[0.0] };
    for head in heads {
        let middle = z + head * half;
        let level = [0.755, 0.85].map(|share| -share * height);
        shape.cuboid([x - 0.06, level[1], middle - 0.12], [x + 0.03, level[0], middle + 0.12], materials.seat);
    }
}
