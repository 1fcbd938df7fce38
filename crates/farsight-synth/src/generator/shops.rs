//! Shops in the houses at the pavement.

use farsight_core::Box3d;

use super::builder::SceneBuilder;
use super::clutter::{printed, surface};
use super::surroundings::Surroundings;
use crate::mesh_builder::MeshBuilder;
use crate::palette::{any_color, grey, matte, times};
use crate::rng::SceneRng;
use crate::scene::{Material, MaterialId, Mesh, Pattern};

/// Share of the houses at the pavement that have a shop.
const SHOP_SHARE: f64 = 0.6;

/// Houses farther behind the pavement have none, metres.
const FARTHEST_M: f64 = 2.0;

impl Surroundings<'_> {
    /// The ground floor of a house as a shop, in some of the houses that stand at the pavement.
    pub(super) fn maybe_shop(&mut self, house: &Box3d, front: [f64; 2], setback: f64, rng: &mut SceneRng) {
        if self.clutter <= 0.0 || setback > FARTHEST_M || !rng.chance(SHOP_SHARE) {
            return;
        }
        let mesh = shop_front(self.builder, house.dimensions.length as f32, rng);
        let at = self.builder.over(front, 0.0);
        self.builder.solid.place(&mesh, house.yaw, at);
    }
}

/// Panes with goods behind them, doors, a band with letters, awnings; the wall lies at z = 0 and the road towards +z.
fn shop_front(builder: &mut SceneBuilder, width: f32, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let height = rng.range32(2.5, 3.0);
    let trim = surface(builder, rng);
    let bays = (width / rng.range32(1.5, 4.0)).round().max(1.0);
    let bay = width / bays;
    for k in 0..bays as usize {
        let left = -width / 2.0 + bay * k as f32;
        let (low, face) = match rng.weighted(&[(0, 6.0), (1, 2.0), (2, 2.0)]) {
            0 => (rng.range32(0.05, 0.8), pane(builder, rng)),
            // An open door: dark.
            1 => (0.0, builder.palette.matte(grey(rng.range32(0.004, 0.03)))),
            _ => (rng.range32(0.3, 1.2), printed(builder, rng)),
        };
        let (from, to) = (left + 0.08, left + bay - 0.08);
        shape.quad([[to, -low, 0.04], [from, -low, 0.04], [from, -height, 0.04], [to, -height, 0.04]], face, 0);
        shape.cuboid([left - 0.08, -height, 0.0], [left + 0.08, 0.1, 0.08], trim);
        if rng.chance(0.25) {
            let goods = pane(builder, rng);
            // Nearer to the wall than anybody stands.
            let reach = rng.range32(0.15, 0.28);
            shape.cuboid([from, -rng.range32(0.5, 1.4), 0.1], [to, 0.1, reach], goods);
        }
    }
    let band = printed(builder, rng);
    shape.cuboid([-width / 2.0, -height - rng.range32(0.3, 0.7), 0.0], [width / 2.0, -height, 0.15], band);
    if rng.chance(0.4) {
        let cloth = surface(builder, rng);
        let (half, out, drop) = (width * rng.range32(0.2, 0.5), rng.range32(0.7, 1.6), rng.range32(0.2, 0.6));
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
fn pane(builder: &mut SceneBuilder, rng: &mut SceneRng) -> MaterialId {
    let dark = times(any_color(rng), rng.log_range(0.03, 0.5) as f32);
    let other = any_color(rng);
    let seed = rng.seed();
    let pattern = match rng.weighted(&[(0, 3.0), (1, 3.0), (2, 1.0)]) {
        0 => Pattern::Noise { other, scale: rng.log_range(0.1, 1.0) as f32, amount: rng.range32(0.3, 1.0), seed },
        1 => {
            let pitch = [rng.log_range(0.15, 0.9) as f32, rng.log_range(0.15, 0.9) as f32];
            let fill = [rng.range32(0.3, 0.9), rng.range32(0.3, 0.9)];
            Pattern::Windows { other, pitch, fill, lit: 0.0, seed }
        }
        _ => Pattern::Plain,
    };
    let reflectivity = rng.range32(0.0, 0.4);
    builder.palette.add(Material { pattern, specular: 0.4, shininess: 80.0, reflectivity, ..matte(dark) })
}
