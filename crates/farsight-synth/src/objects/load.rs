//! What trucks and trailers carry: boxes with doors and lettering.

use super::context::BuildContext;
use super::paint::VehicleMaterials;
use crate::mesh_builder::MeshBuilder;
use crate::palette::{any_color, grey, matte};
use crate::rng::SceneRng;
use crate::scene::{Material, MaterialId, Pattern, Vec3};

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
    pub(super) fn build(&self, shape: &mut MeshBuilder) {
        let ([rear, front], [low, high]) = (self.ends, self.heights);
        shape.cuboid([rear, -high, -self.half], [front, -low, self.half], self.material);
    }

    /// Two doors in the rear, or a shutter, in their frame.
    pub(super) fn doors(&self, shape: &mut MeshBuilder, materials: &VehicleMaterials, rng: &mut SceneRng) {
        let frame = if rng.chance(0.5) { materials.trim } else { materials.chrome };
        let [low, high] = self.heights;
        let half = self.half;
        for side in [-1.0f32, 1.0] {
            self.on_rear(shape, [low, high], [side * (half - 0.09), side * half], (frame, FRAME));
        }
        self.on_rear(shape, [high - 0.1, high], [-half, half], (frame, FRAME));
        let between = [0.09 - half, half - 0.09];
        self.on_rear(shape, [low, low + 0.12], between, (materials.trim, FRAME));
        if rng.chance(0.3) {
            let slats = ((high - low) / 0.3) as usize;
            for k in 1..slats {
                let level = low + 0.12 + k as f32 * 0.3;
                self.on_rear(shape, [level, level + 0.02], between, (materials.gap, GAP));
            }
            return;
        }
        self.on_rear(shape, [low + 0.12, high - 0.1], [-0.015, 0.015], (materials.gap, GAP));
        // The bars that lock the doors.
        for share in [0.2, 0.62] {
            for side in [-1.0f32, 1.0] {
                let z = side * share * half;
                // Over the lettering.
                let x = self.ends[0] - 2.0 * PROUD_M;
                shape.quad(upright(x, [low + 0.06, high - 0.04], [z - 0.02, z + 0.02]), materials.chrome, FRAME);
            }
        }
    }

    /// The firm's name, sign and colours on the rear and on both sides.
    pub(super) fn lettering(&self, shape: &mut MeshBuilder, context: &mut BuildContext) {
        let letters = letters(context);
        let rng = &mut context.rng;
        let ([rear, front], [low, high]) = (self.ends, self.heights);
        let tall = (high - low) * rng.range32(0.12, 0.4);
        let level = low + (high - low) * rng.range32(0.35, 0.55);
        let heights = [level, level + tall];
        if rng.chance(0.6) {
            let [from, to] = [rng.range32(-0.8, -0.2), rng.range32(0.2, 0.8)];
            self.on_rear(shape, heights, [from * self.half, to * self.half], (letters, LETTERING));
        }
        let [from, to] = [rng.range32(0.05, 0.35), rng.range32(0.5, 0.95)].map(|share| rear + share * (front - rear));
        for side in [-1.0f32, 1.0] {
            let z = side * (self.half + PROUD_M);
            let [bottom, top] = heights.map(|h| -h);
            shape.quad([[from, bottom, z], [to, bottom, z], [to, top, z], [from, top, z]], letters, LETTERING);
        }
    }

    fn on_rear(
        &self,
        shape: &mut MeshBuilder,
        heights: [f32; 2],
        sides: [f32; 2],
        (material, layer): (MaterialId, u8),
    ) {
        shape.quad(upright(self.ends[0] - PROUD_M, heights, sides), material, layer);
    }
}

/// Corners of a flat piece across the vehicle at `x`, between two heights and from left to right.
pub(super) fn upright(x: f32, [low, high]: [f32; 2], [left, right]: [f32; 2]) -> [Vec3; 4] {
    [[x, -low, left], [x, -low, right], [x, -high, right], [x, -high, left]]
}

/// The cloth, metal or boards of a load, sometimes with the firm's stripes.
pub(super) fn material(context: &mut BuildContext, closed: bool, materials: &VehicleMaterials) -> MaterialId {
    let rng = &mut context.rng;
    let color = match rng.weighted(&[(0, 3.0), (1, 2.0), (2, 1.5)]) {
        0 => grey(rng.range32(0.5, 0.8)),
        1 => any_color(rng),
        _ => context.palette.materials[usize::from(materials.body)].color,
    };
    let other = any_color(rng);
    let stripes = Pattern::Stripes { other, period: rng.range32(1.0, 3.0), share: rng.range32(0.1, 0.4) };
    let dirt = Pattern::Noise { other: color.map(|c| c * 0.6), scale: 1.5, amount: 0.6, seed: rng.seed() };
    let pattern = if closed && rng.chance(0.4) { stripes } else { dirt };
    context.palette.add(Material { pattern, specular: 0.2, shininess: 15.0, reflectivity: 0.02, ..matte(color) })
}

/// Large letters, or a sign in one colour.
fn letters(context: &mut BuildContext) -> MaterialId {
    let rng = &mut context.rng;
    let (ground, ink) = (any_color(rng), any_color(rng));
    let size = rng.range32(0.25, 0.7);
    let rows = Pattern::Windows {
        other: ink,
        pitch: [0.7 * size, size],
        fill: [rng.range32(0.5, 0.8), rng.range32(0.5, 0.8)],
        lit: 0.0,
        seed: rng.seed(),
    };
    let pattern = if rng.chance(0.7) { rows } else { Pattern::Plain };
    context.palette.add(Material { pattern, ..matte(ground) })
}
