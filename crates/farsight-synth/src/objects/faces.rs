//! The front and the rear of cars: lamps, grille, plates, bumpers.

use super::body::Body;
use super::context::{BuildContext, Detail};
use super::paint::VehicleMaterials;
use crate::mesh_builder::MeshBuilder;
use crate::scene::MaterialId;

/// Paints flat parts on one end of a body. Heights are shares of the space between bumper and shoulder, offsets shares
/// of the half width.
struct Panel<'a> {
    shape: &'a mut MeshBuilder,
    x: f32,
    /// Half width and height of the lower edge, the widest place and the shoulder.
    frame: [[f32; 2]; 3],
}

impl Panel<'_> {
    fn half_width(&self, height: f32) -> f32 {
        let [low, middle, high] = self.frame;
        let (a, b) = if height < middle[1] { (low, middle) } else { (middle, high) };
        let share = ((height - a[1]) / (b[1] - a[1]).max(1e-3)).clamp(0.0, 1.0);
        a[0] + (b[0] - a[0]) * share
    }

    /// A piece between two heights (metres) and two offsets at its lower and its upper edge; `rank` lifts it over
    /// pieces below.
    fn piece(&mut self, [low, high]: [f32; 2], lower: [f32; 2], upper: [f32; 2], rank: f32, material: MaterialId) {
        let x = self.x + self.x.signum() * 0.003 * rank;
        let at = |height: f32, share: f32| [x, -height, share * self.half_width(height)];
        let points = [at(low, lower[0]), at(low, lower[1]), at(high, upper[1]), at(high, upper[0])];
        self.shape.quad(points, material, 0);
    }

    /// The same on both sides.
    fn pair(&mut self, heights: [f32; 2], lower: [f32; 2], upper: [f32; 2], rank: f32, material: MaterialId) {
        self.piece(heights, lower, upper, rank, material);
        self.piece(heights, [-lower[1], -lower[0]], [-upper[1], -upper[0]], rank, material);
    }

    /// A number plate around a height: 0.52 m wide, or of a region's format.
    fn plate(&mut self, height: f32, materials: &VehicleMaterials) {
        let [half_width, half_height] = materials.plate_size.map_or([0.26, 0.055], |size| size.map(|side| side / 2.0));
        let half = (half_width / self.half_width(height).max(0.3)).min(0.9);
        let heights = [height - half_height, height + half_height];
        self.piece(heights, [-half, half], [-half, half], 3.0, materials.plate);
        if !materials.plate_band {
            return;
        }
        let end = [-0.85, -1.0].map(|share| share * half * self.x.signum());
        self.piece(heights, end, end, 4.0, materials.plate_end);
    }
}

/// Headlamps, grille, air intake, plate.
pub(super) fn front(
    shape: &mut MeshBuilder,
    body: &Body,
    hwl: [f32; 3],
    materials: &VehicleMaterials,
    context: &mut BuildContext,
) {
    let frame = body.end_frame(0.0);
    let [_, bulge, shoulder] = frame;
    let mut panel = Panel { shape, x: hwl[2] / 2.0, frame };
    let rng = &mut context.rng;
    let top = shoulder[1];
    let bottom = frame[0][1];
    let span = top - bottom;
    // Air intake in the bumper.
    let intake = rng.range32(0.3, 0.75);
    panel.piece(
        [bottom + 0.06 * span, bottom + 0.3 * span],
        [-intake, intake],
        [-intake * 1.05, intake * 1.05],
        1.0,
        materials.trim,
    );
    // Grille between the lamps.
    let (wide, tall) = (rng.range32(0.25, 0.52), rng.range32(0.14, 0.36));
    let taper = rng.range32(0.8, 1.2);
    let heights = [top - 0.06 - tall * span, top - 0.05];
    panel.piece(heights, [-wide * taper, wide * taper], [-wide, wide], 1.0, materials.grille);
    if rng.chance(0.4) {
        let frame = wide * 1.06;
        let around = [heights[0] - 0.02, heights[1] + 0.02];
        panel.piece(around, [-frame * taper, frame * taper], [-frame, frame], 0.5, materials.chrome);
    }
    if context.detail == Detail::Near {
        panel.piece([top - 0.14, top - 0.06], [-0.06, 0.06], [-0.06, 0.06], 3.0, materials.chrome);
    }
    // Lamps at the corners; they go on around the side.
    let (inner, low) = (rng.range32(0.4, 0.64), rng.range32(0.22, 0.42));
    let slant = rng.range32(-0.06, 0.12);
    let heights = [(top - low * span).max(bulge[1] - 0.1), top - 0.01];
    panel.pair(heights, [inner + slant, 0.99], [inner - slant, 0.98], 2.0, materials.head_lamp);
    if rng.chance(0.4) {
        panel.pair([bottom + 0.12 * span, bottom + 0.24 * span], [0.78, 0.93], [0.78, 0.93], 2.0, materials.chrome);
    }
    let level = bottom + span * rng.range32(0.28, 0.42);
    if materials.front_plate {
        panel.plate(level, materials);
    }
}

/// Rear lamps, plate, bumper.
pub(super) fn rear(
    shape: &mut MeshBuilder,
    body: &Body,
    hwl: [f32; 3],
    materials: &VehicleMaterials,
    context: &mut BuildContext,
) {
    let frame = body.end_frame(1.0);
    let mut panel = Panel { shape, x: -hwl[2] / 2.0, frame };
    let rng = &mut context.rng;
    let (bottom, top) = (frame[0][1], frame[2][1]);
    let span = top - bottom;
    if body.profile.upright_lamps {
        let (inner, low) = (rng.range32(0.74, 0.88), rng.range32(0.4, 0.62));
        let split = top - 0.45 * low * span;
        panel.pair([top - low * span, split], [inner, 0.99], [inner, 0.99], 2.0, materials.tail_lamp);
        panel.pair([split, top], [inner, 0.99], [inner, 0.98], 2.0, materials.brake_lamp);
    } else {
        let (inner, low) = (rng.range32(0.5, 0.74), rng.range32(0.2, 0.36));
        let outer = rng.range32(0.8, 0.9);
        let heights = [top - low * span, top - 0.03];
        panel.pair(heights, [inner, outer], [inner, outer], 2.0, materials.brake_lamp);
        panel.pair(heights, [outer, 0.99], [outer, 0.99], 2.0, materials.tail_lamp);
    }
    // The bumper: a seam over it, often black below.
    let seam = bottom + span * rng.range32(0.3, 0.42);
    panel.piece([seam, seam + 0.014], [-0.98, 0.98], [-0.98, 0.98], 1.0, materials.gap);
    if rng.chance(0.5) {
        let apron = bottom + span * rng.range32(0.08, 0.24);
        panel.piece([bottom, apron], [-0.97, 0.97], [-0.97, 0.97], 1.0, materials.trim);
    }
    if rng.chance(0.3) {
        panel.piece([seam - 0.06, seam - 0.01], [-0.95, 0.95], [-0.95, 0.95], 1.0, materials.trim);
    }
    panel.pair([bottom + 0.1 * span, bottom + 0.16 * span], [0.7, 0.85], [0.7, 0.85], 2.0, materials.tail_lamp);
    let on_bumper = rng.chance(0.3);
    let level = if on_bumper { bottom + 0.22 * span } else { seam + rng.range32(0.1, 0.22) };
    panel.plate(level.min(top - 0.1), materials);
    if context.detail == Detail::Near {
        let level = (level + 0.1).min(top - 0.03);
        panel.piece([level, level + 0.025], [-0.3, 0.3], [-0.3, 0.3], 2.0, materials.chrome);
    }
}
