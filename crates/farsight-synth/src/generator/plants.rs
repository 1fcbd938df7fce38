//! Trees and bushes: leafy balls around dark insides, with boughs that stick out.

use super::props::StreetMaterials;
use crate::mesh_builder::MeshBuilder;
use crate::rng::SceneRng;
use crate::scene::{MaterialId, Mesh, Vec3};

/// A tree of a height; its crown is a heap of leafy balls.
pub(crate) fn tree(height: f32, materials: &StreetMaterials, fine: bool, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let leaves = rng.pick(if fine { &materials.leaves } else { &materials.far_leaves });
    if rng.chance(0.15) {
        conifer(&mut shape, height, materials, leaves, rng);
        return shape.mesh;
    }
    let trunk = height * rng.range32(0.2, 0.42);
    let radius = (height * rng.range32(0.014, 0.03)).clamp(0.08, 0.5);
    let lean = [rng.range32(-0.05, 0.05) * height, -trunk * 1.3, rng.range32(-0.05, 0.05) * height];
    shape.tube([0.0, 0.3, 0.0], lean, [radius, radius * 0.7], if fine { 8 } else { 5 }, materials.bark);
    let crown = (height - trunk) / 2.0;
    let wide = crown * rng.range32(0.6, 1.1);
    let balls = if fine { rng.whole(5, 9) } else { 2 };
    let sides = if fine { [5, 8] } else { [4, 6] };
    for k in 0..balls {
        let around = std::f32::consts::TAU * (k as f32 / balls as f32 + rng.range32(0.0, 0.15));
        let (sin, cos) = crate::mesh_builder::sin_cos(around);
        let out = wide * rng.range32(0.2, 0.6);
        let up = rng.range32(-0.45, 0.5) * crown;
        let center = [lean[0] + cos * out, -trunk - crown + up, lean[2] + sin * out];
        let grow = rng.range32(0.45, 0.75);
        let radii = [wide * grow, crown * grow * 0.9, wide * grow];
        leafy_ball(&mut shape, center, radii, sides, leaves, rng);
        if fine {
            sprays(&mut shape, center, radii, 8, leaves[0], rng);
        }
    }
    for _ in 0..if fine { rng.whole(1, 3) } else { 0 } {
        let to = [rng.range32(-0.5, 0.5) * wide, -trunk - crown * rng.range32(0.4, 1.0), rng.range32(-0.5, 0.5) * wide];
        shape.tube([lean[0] * 0.8, lean[1] * 0.9, lean[2] * 0.8], to, [radius * 0.6, 0.03], 5, materials.bark);
    }
    shape.mesh
}

fn conifer(
    shape: &mut MeshBuilder,
    height: f32,
    materials: &StreetMaterials,
    leaves: [MaterialId; 2],
    rng: &mut SceneRng,
) {
    shape.tube([0.0, 0.2, 0.0], [0.0, -height * 0.3, 0.0], [0.18, 0.15], 6, materials.bark);
    let wide = height * rng.range32(0.16, 0.28);
    for k in 0..4 {
        let low = height * (0.12 + 0.2 * k as f32);
        let radius = wide * (1.0 - 0.22 * k as f32);
        let first = shape.mesh.vertices.len();
        shape.tube(
            [0.0, -low, 0.0],
            [0.0, -(low + height * 0.3).min(height), 0.0],
            [radius, radius * 0.1],
            8,
            leaves[0],
        );
        shape.tube(
            [0.0, -low, 0.0],
            [0.0, -(low + height * 0.26).min(height), 0.0],
            [radius * 0.8, radius * 0.05],
            7,
            leaves[1],
        );
        shape.project_patterns(first);
        sprays(shape, [0.0, -low - height * 0.1, 0.0], [radius, height * 0.1, radius], 6, leaves[0], rng);
    }
}

/// Part of a crown: leaves with gaps around a dark inside.
pub(crate) fn leafy_ball(
    shape: &mut MeshBuilder,
    center: Vec3,
    radii: Vec3,
    sides: [usize; 2],
    leaves: [MaterialId; 2],
    rng: &mut SceneRng,
) {
    shape.ellipsoid(center, radii, sides, leaves[0], || rng.range32(-0.25, 0.25));
    shape.ellipsoid(center, radii.map(|r| r * 0.8), [3, 6], leaves[1], || rng.range32(-0.2, 0.2));
}

/// Single boughs that stick out of a crown, so that its outline is ragged.
fn sprays(shape: &mut MeshBuilder, center: Vec3, radii: Vec3, count: usize, leaves: MaterialId, rng: &mut SceneRng) {
    for _ in 0..count {
        let out = crate::vector::unit([rng.range32(-1.0, 1.0), rng.range32(-1.0, 1.0), rng.range32(-1.0, 1.0)]);
        let from = [0, 1, 2].map(|i| center[i] + out[i] * radii[i] * 0.8);
        let reach = radii[0] * rng.range32(0.25, 0.5);
        let side = crate::vector::unit([out[2], rng.range32(-0.4, 0.4), -out[0]]);
        let corner = |a: f32, b: f32| [0, 1, 2].map(|i| from[i] + (out[i] * a + side[i] * b) * reach);
        let first = shape.mesh.vertices.len();
        shape.quad([corner(-0.3, -0.7), corner(0.0, 0.8), corner(1.1, 0.4), corner(0.8, -0.6)], leaves, 0);
        shape.project_patterns(first);
    }
}

/// A bush of a size.
pub(crate) fn bush(height: f32, wide: f32, materials: &StreetMaterials, fine: bool, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let leaves = rng.pick(if fine { &materials.leaves } else { &materials.far_leaves });
    for _ in 0..if fine { 3 } else { 1 } {
        let center = [rng.range32(-0.3, 0.3) * wide, -height * 0.45, rng.range32(-0.3, 0.3) * wide];
        let grow = rng.range32(0.7, 1.0);
        let radii = [wide / 2.0 * grow, height * 0.55, wide / 2.0 * grow];
        leafy_ball(&mut shape, center, radii, [4, 7], leaves, rng);
        if fine {
            sprays(&mut shape, center, radii, 6, leaves[0], rng);
        }
    }
    shape.mesh
}
