//! Bicycles, ridden and parked.

use super::context::Detail;
use crate::mesh_builder::{MeshBuilder, sin_cos};
use crate::scene::MaterialId;

/// Where the cranks turn.
pub(super) const CRANK: [f32; 3] = [-0.08, -0.3, 0.0];

/// A bicycle 1.75 m long.
pub(crate) fn bicycle(shape: &mut MeshBuilder, frame: MaterialId, dark: MaterialId, detail: Detail) {
    let sides = detail.sides(18);
    let axis = [0.0, 0.0, 1.0];
    let [rear, front] = [[-0.535, -0.34, 0.0], [0.535, -0.34, 0.0]];
    for hub in [rear, front] {
        for z in [-0.018, 0.018] {
            shape.disc([hub[0], hub[1], z], axis, [0.30, 0.34], sides, &[dark]);
        }
        if detail == Detail::Near {
            let spokes = [frame, dark];
            for k in 0..8 {
                let (sin, cos) = sin_cos(std::f32::consts::TAU * k as f32 / 8.0);
                let rim = [hub[0] + 0.3 * cos, hub[1] + 0.3 * sin, 0.0];
                shape.tube(hub, rim, [0.004; 2], 3, spokes[k % 2]);
            }
        }
    }
    let [seat, head] = [[-0.22, -0.85, 0.0], [0.36, -0.88, 0.0]];
    for (a, b) in [(rear, CRANK), (CRANK, seat), (CRANK, head), (seat, head), (rear, seat), (head, front)] {
        shape.tube(a, b, [0.02; 2], 5, frame);
    }
    shape.tube([0.4, -1.03, -0.29], [0.4, -1.03, 0.29], [0.016; 2], 5, dark);
    shape.tube(head, [0.4, -1.03, 0.0], [0.018; 2], 5, dark);
    shape.cuboid([-0.35, -0.95, -0.07], [-0.1, -0.89, 0.07], dark);
}
