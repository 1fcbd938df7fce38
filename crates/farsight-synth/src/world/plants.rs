//! Trees and bushes: leafy balls around dark insides, with boughs that stick out.

use super::props::Stock;
use crate::dice::Dice;
use crate::scene::{MaterialId, Mesh, Vec3};
use crate::shape::Shape;

/// A tree of a height; its crown is a heap of leafy balls.
pub(crate) fn tree(height: f32, stock: &Stock, fine: bool, dice: &mut Dice) -> Mesh {
    let mut shape = Shape::default();
    let leaves = dice.pick(if fine { &stock.leaves } else { &stock.far_leaves });
    if dice.chance(0.15) {
        conifer(&mut shape, height, stock, leaves, dice);
        return shape.mesh;
    }
    let trunk = height * dice.range32(0.2, 0.42);
    let radius = (height * dice.range32(0.014, 0.03)).clamp(0.08, 0.5);
    let lean = [dice.range32(-0.05, 0.05) * height, -trunk * 1.3, dice.range32(-0.05, 0.05) * height];
    shape.tube([0.0, 0.3, 0.0], lean, [radius, radius * 0.7], if fine { 8 } else { 5 }, stock.bark);
    let crown = (height - trunk) / 2.0;
    let wide = crown * dice.range32(0.6, 1.1);
    let balls = if fine { dice.whole(5, 9) } else { 2 };
    let sides = if fine { [5, 8] } else { [4, 6] };
    for k in 0..balls {
        let around = std::f32::consts::TAU * (k as f32 / balls as f32 + dice.range32(0.0, 0.15));
        let (sin, cos) = crate::shape::sin_cos(around);
        let out = wide * dice.range32(0.2, 0.6);
        let up = dice.range32(-0.45, 0.5) * crown;
        let center = [lean[0] + cos * out, -trunk - crown + up, lean[2] + sin * out];
        let grow = dice.range32(0.45, 0.75);
        let radii = [wide * grow, crown * grow * 0.9, wide * grow];
        leafy_ball(&mut shape, center, radii, sides, leaves, dice);
        if fine {
            sprays(&mut shape, center, radii, 8, leaves[0], dice);
        }
    }
    for _ in 0..if fine { dice.whole(1, 3) } else { 0 } {
        let to =
            [dice.range32(-0.5, 0.5) * wide, -trunk - crown * dice.range32(0.4, 1.0), dice.range32(-0.5, 0.5) * wide];
        shape.tube([lean[0] * 0.8, lean[1] * 0.9, lean[2] * 0.8], to, [radius * 0.6, 0.03], 5, stock.bark);
    }
    shape.mesh
}

fn conifer(shape: &mut Shape, height: f32, stock: &Stock, leaves: [MaterialId; 2], dice: &mut Dice) {
    shape.tube([0.0, 0.2, 0.0], [0.0, -height * 0.3, 0.0], [0.18, 0.15], 6, stock.bark);
    let wide = height * dice.range32(0.16, 0.28);
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
        sprays(shape, [0.0, -low - height * 0.1, 0.0], [radius, height * 0.1, radius], 6, leaves[0], dice);
    }
}

/// Part of a crown: leaves with gaps around a dark inside.
pub(crate) fn leafy_ball(
    shape: &mut Shape,
    center: Vec3,
    radii: Vec3,
    sides: [usize; 2],
    leaves: [MaterialId; 2],
    dice: &mut Dice,
) {
    shape.ball(center, radii, sides, leaves[0], || dice.range32(-0.25, 0.25));
    shape.ball(center, radii.map(|r| r * 0.8), [3, 6], leaves[1], || dice.range32(-0.2, 0.2));
}

/// Single boughs that stick out of a crown, so that its outline is ragged.
fn sprays(shape: &mut Shape, center: Vec3, radii: Vec3, count: usize, leaves: MaterialId, dice: &mut Dice) {
    for _ in 0..count {
        let out = crate::vector::unit([dice.range32(-1.0, 1.0), dice.range32(-1.0, 1.0), dice.range32(-1.0, 1.0)]);
        let from = [0, 1, 2].map(|i| center[i] + out[i] * radii[i] * 0.8);
        let reach = radii[0] * dice.range32(0.25, 0.5);
        let side = crate::vector::unit([out[2], dice.range32(-0.4, 0.4), -out[0]]);
        let corner = |a: f32, b: f32| [0, 1, 2].map(|i| from[i] + (out[i] * a + side[i] * b) * reach);
        let first = shape.mesh.vertices.len();
        shape.quad([corner(-0.3, -0.7), corner(0.0, 0.8), corner(1.1, 0.4), corner(0.8, -0.6)], leaves, 0);
        shape.project_patterns(first);
    }
}

/// A bush of a size.
pub(crate) fn bush(height: f32, wide: f32, stock: &Stock, fine: bool, dice: &mut Dice) -> Mesh {
    let mut shape = Shape::default();
    let leaves = dice.pick(if fine { &stock.leaves } else { &stock.far_leaves });
    for _ in 0..if fine { 3 } else { 1 } {
        let center = [dice.range32(-0.3, 0.3) * wide, -height * 0.45, dice.range32(-0.3, 0.3) * wide];
        let grow = dice.range32(0.7, 1.0);
        let radii = [wide / 2.0 * grow, height * 0.55, wide / 2.0 * grow];
        leafy_ball(&mut shape, center, radii, [4, 7], leaves, dice);
        if fine {
            sprays(&mut shape, center, radii, 6, leaves[0], dice);
        }
    }
    shape.mesh
}
