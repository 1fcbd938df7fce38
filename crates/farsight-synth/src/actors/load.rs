//! What lorries and trailers carry: boxes with doors and lettering.

use super::paint::Livery;
use super::workshop::Workshop;
use crate::dice::Dice;
use crate::palette::{any_color, grey, matte};
use crate::scene::{Material, MaterialId, Pattern, Vec3};
use crate::shape::Shape;

/// Layers of what lies in one plane of the rear: frame, lettering over it, gaps over both.
const FRAME: u8 = 0;
const LETTERING: u8 = 1;
const GAP: u8 = 2;

/// How far what is painted or mounted on a wall stands off it, metres.
const PROUD_M: f32 = 0.01;

/// A load: x of its rear and front, heights of its floor and roof above the ground, half its width; metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Load {
    pub(super) ends: [f32; 2],
    pub(super) heights: [f32; 2],
    pub(super) half: f32,
    pub(super) material: MaterialId,
}

impl Load {
    pub(super) fn build(&self, shape: &mut Shape) {
        let ([rear, front], [low, high]) = (self.ends, self.heights);
        shape.block([rear, -high, -self.half], [front, -low, self.half], self.material);
    }

    /// Two doors in the rear, or a shutter, in their frame.
    pub(super) fn doors(&self, shape: &mut Shape, livery: &Livery, dice: &mut Dice) {
        let frame = if dice.chance(0.5) { livery.trim } else { livery.chrome };
        let [low, high] = self.heights;
        let half = self.half;
        for side in [-1.0f32, 1.0] {
            self.on_rear(shape, [low, high], [side * (half - 0.09), side * half], (frame, FRAME));
        }
        self.on_rear(shape, [high - 0.1, high], [-half, half], (frame, FRAME));
        let between = [0.09 - half, half - 0.09];
        self.on_rear(shape, [low, low + 0.12], between, (livery.trim, FRAME));
        if dice.chance(0.3) {
            let slats = ((high - low) / 0.3) as usize;
            for k in 1..slats {
                let level = low + 0.12 + k as f32 * 0.3;
                self.on_rear(shape, [level, level + 0.02], between, (livery.gap, GAP));
            }
            return;
        }
        self.on_rear(shape, [low + 0.12, high - 0.1], [-0.015, 0.015], (livery.gap, GAP));
        // The bars that lock the doors.
        for share in [0.2, 0.62] {
            for side in [-1.0f32, 1.0] {
                let z = side * share * half;
                // Over the lettering.
                let x = self.ends[0] - 2.0 * PROUD_M;
                shape.quad(upright(x, [low + 0.06, high - 0.04], [z - 0.02, z + 0.02]), livery.chrome, FRAME);
            }
        }
    }

    /// The firm's name, sign and colours on the rear and on both sides.
    pub(super) fn lettering(&self, shape: &mut Shape, workshop: &mut Workshop) {
        let letters = letters(workshop);
        let dice = &mut workshop.dice;
        let ([rear, front], [low, high]) = (self.ends, self.heights);
        let tall = (high - low) * dice.range32(0.12, 0.4);
        let level = low + (high - low) * dice.range32(0.35, 0.55);
        let heights = [level, level + tall];
        if dice.chance(0.6) {
            let [from, to] = [dice.range32(-0.8, -0.2), dice.range32(0.2, 0.8)];
            self.on_rear(shape, heights, [from * self.half, to * self.half], (letters, LETTERING));
        }
        let [from, to] = [dice.range32(0.05, 0.35), dice.range32(0.5, 0.95)].map(|share| rear + share * (front - rear));
        for side in [-1.0f32, 1.0] {
            let z = side * (self.half + PROUD_M);
            let [bottom, top] = heights.map(|h| -h);
            shape.quad([[from, bottom, z], [to, bottom, z], [to, top, z], [from, top, z]], letters, LETTERING);
        }
    }

    fn on_rear(&self, shape: &mut Shape, heights: [f32; 2], sides: [f32; 2], (material, layer): (MaterialId, u8)) {
        shape.quad(upright(self.ends[0] - PROUD_M, heights, sides), material, layer);
    }
}

/// Corners of a flat piece across the vehicle at `x`, between two heights and from left to right.
pub(super) fn upright(x: f32, [low, high]: [f32; 2], [left, right]: [f32; 2]) -> [Vec3; 4] {
    [[x, -low, left], [x, -low, right], [x, -high, right], [x, -high, left]]
}

/// The cloth, metal or boards of a load, sometimes with the firm's stripes.
pub(super) fn material(workshop: &mut Workshop, closed: bool, livery: &Livery) -> MaterialId {
    let dice = &mut workshop.dice;
    let color = match dice.weighted(&[(0, 3.0), (1, 2.0), (2, 1.5)]) {
        0 => grey(dice.range32(0.5, 0.8)),
        1 => any_color(dice),
        _ => workshop.palette.materials[usize::from(livery.body)].color,
    };
    let other = any_color(dice);
    let stripes = Pattern::Stripes { other, period: dice.range32(1.0, 3.0), share: dice.range32(0.1, 0.4) };
    let dirt = Pattern::Noise { other: color.map(|c| c * 0.6), scale: 1.5, amount: 0.6, seed: dice.seed() };
    let pattern = if closed && dice.chance(0.4) { stripes } else { dirt };
    workshop.palette.add(Material { pattern, gloss: 0.2, shininess: 15.0, mirror: 0.02, ..matte(color) })
}

/// Large letters, or a sign in one colour.
fn letters(workshop: &mut Workshop) -> MaterialId {
    let dice = &mut workshop.dice;
    let (ground, ink) = (any_color(dice), any_color(dice));
    let size = dice.range32(0.25, 0.7);
    let rows = Pattern::Windows {
        other: ink,
        pitch: [0.7 * size, size],
        fill: [dice.range32(0.5, 0.8), dice.range32(0.5, 0.8)],
        lit: 0.0,
        seed: dice.seed(),
    };
    let pattern = if dice.chance(0.7) { rows } else { Pattern::Plain };
    workshop.palette.add(Material { pattern, ..matte(ground) })
}
