//! Shops in the houses at the pavement.

use farsight_core::Box3d;

use super::clutter::{printed, surface};
use super::stage::Stage;
use super::surroundings::Surroundings;
use crate::dice::Dice;
use crate::palette::{any_color, grey, matte, times};
use crate::scene::{Material, MaterialId, Mesh, Pattern};
use crate::shape::Shape;

/// Share of the houses at the pavement that have a shop.
const SHOP_SHARE: f64 = 0.6;

/// Houses farther behind the pavement have none, metres.
const FARTHEST_M: f64 = 2.0;

impl Surroundings<'_> {
    /// The ground floor of a house as a shop, in some of the houses that stand at the pavement.
    pub(super) fn maybe_shop(&mut self, house: &Box3d, front: [f64; 2], setback: f64, dice: &mut Dice) {
        if self.clutter <= 0.0 || setback > FARTHEST_M || !dice.chance(SHOP_SHARE) {
            return;
        }
        let mesh = shop_front(self.stage, house.dimensions.length as f32, dice);
        let at = self.stage.over(front, 0.0);
        self.stage.solid.place(&mesh, house.yaw, at);
    }
}

/// Panes with goods behind them, doors, a band with letters, awnings; the wall lies at z = 0 and the road towards +z.
fn shop_front(stage: &mut Stage, width: f32, dice: &mut Dice) -> Mesh {
    let mut shape = Shape::default();
    let height = dice.range32(2.5, 3.0);
    let trim = surface(stage, dice);
    let bays = (width / dice.range32(1.5, 4.0)).round().max(1.0);
    let bay = width / bays;
    for k in 0..bays as usize {
        let left = -width / 2.0 + bay * k as f32;
        let (low, face) = match dice.weighted(&[(0, 6.0), (1, 2.0), (2, 2.0)]) {
            0 => (dice.range32(0.05, 0.8), pane(stage, dice)),
            // An open door: dark.
            1 => (0.0, stage.palette.matte(grey(dice.range32(0.004, 0.03)))),
            _ => (dice.range32(0.3, 1.2), printed(stage, dice)),
        };
        let (from, to) = (left + 0.08, left + bay - 0.08);
        shape.quad([[to, -low, 0.04], [from, -low, 0.04], [from, -height, 0.04], [to, -height, 0.04]], face, 0);
        shape.block([left - 0.08, -height, 0.0], [left + 0.08, 0.1, 0.08], trim);
        if dice.chance(0.25) {
            let goods = pane(stage, dice);
            // Nearer to the wall than anybody stands.
            let reach = dice.range32(0.15, 0.28);
            shape.block([from, -dice.range32(0.5, 1.4), 0.1], [to, 0.1, reach], goods);
        }
    }
    let band = printed(stage, dice);
    shape.block([-width / 2.0, -height - dice.range32(0.3, 0.7), 0.0], [width / 2.0, -height, 0.15], band);
    if dice.chance(0.4) {
        let cloth = surface(stage, dice);
        let (half, out, drop) = (width * dice.range32(0.2, 0.5), dice.range32(0.7, 1.6), dice.range32(0.2, 0.6));
        let [y, edge] = [-height, -height + drop];
        shape.quad([[-half, edge, out], [half, edge, out], [half, y, 0.1], [-half, y, 0.1]], cloth, 0);
        shape.quad(
            [[-half, edge + 0.2, out], [half, edge + 0.2, out], [half, edge, out], [-half, edge, out]],
            cloth,
            0,
        );
    }
    shape.mesh
}

/// A shop window: goods of many colours in the dark, and what the street outside looks like.
fn pane(stage: &mut Stage, dice: &mut Dice) -> MaterialId {
    let dark = times(any_color(dice), dice.log_range(0.03, 0.5) as f32);
    let other = any_color(dice);
    let seed = dice.seed();
    let pattern = match dice.weighted(&[(0, 3.0), (1, 3.0), (2, 1.0)]) {
        0 => Pattern::Noise { other, scale: dice.log_range(0.1, 1.0) as f32, amount: dice.range32(0.3, 1.0), seed },
        1 => {
            let pitch = [dice.log_range(0.15, 0.9) as f32, dice.log_range(0.15, 0.9) as f32];
            let fill = [dice.range32(0.3, 0.9), dice.range32(0.3, 0.9)];
            Pattern::Windows { other, pitch, fill, lit: 0.0, seed }
        }
        _ => Pattern::Plain,
    };
    let mirror = dice.range32(0.0, 0.4);
    stage.palette.add(Material { pattern, gloss: 0.4, shininess: 80.0, mirror, ..matte(dark) })
}
