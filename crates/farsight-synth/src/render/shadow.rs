//! What stands between a surface and the light: depth maps seen from the sun and from straight above.

use super::depth_map::{DepthMap, Region};
use super::lanes::{self, Lanes, Vec3s, all};
use super::view::View;
use crate::scene::{Scene, Vec3};
use crate::vector::{add_scaled, cross, normalized};

/// The part of the scene, ahead of the camera, that a map covers, metres: nearest and farthest depth.
type Reach = [f32; 2];

/// The two maps of the sun: a fine one for what is near and a coarse one.
const SUN_REACH_M: [Reach; 2] = [[0.5, 24.0], [20.0, 85.0]];

/// Size of their texels, metres.
const SUN_TEXEL_M: [f32; 2] = [0.055, 0.2];

/// Heights between which shadows are looked for, metres below the camera (y): from the eaves of a low house to a dip
/// in the road.
const HEIGHTS_M: [f32; 2] = [-7.0, 3.5];

/// Reach, half width and texel of the map from above, metres.
const ABOVE_REACH_M: Reach = [-4.0, 105.0];
const ABOVE_HALF_WIDTH_M: f32 = 40.0;
const ABOVE_TEXEL_M: f32 = 0.25;

/// What hides the sun and the sky.
pub(crate) struct Shadows {
    sun: Vec<DepthMap>,
    above: DepthMap,
    strength: f32,
}

impl Shadows {
    /// The shadows of a scene.
    pub(crate) fn of(scene: &Scene, view: &View) -> Self {
        let needed = scene.sun.shadow > 0.0 && scene.sun.color.iter().any(|&c| c > 0.0);
        let sun = SUN_REACH_M.iter().zip(SUN_TEXEL_M).filter(|_| needed);
        Self {
            sun: sun.map(|(&reach, texel_m)| sun_map(scene, view, reach, texel_m)).collect(),
            above: map_from_above(scene, view),
            strength: scene.sun.shadow,
        }
    }

    /// Share of the sun's light that reaches surfaces, 0 to 1, in the lanes that are `wanted`.
    #[inline]
    pub(crate) fn sunlight(&self, position: Vec3s, normal: Vec3s, wanted: u32) -> Lanes {
        let near = position[2].simd_lt(all(SUN_REACH_M[0][1] - 1.0)).to_bitmask();
        let mut hidden = Lanes::ZERO;
        for (map, lanes) in self.sun.iter().zip([wanted & near, wanted & !near]) {
            if lanes != 0 {
                // Off the surface by its own texels, so that it does not shade itself.
                let points = lanes::add_scaled(position, normal, all(1.6 * map.texel_m));
                let margin_m = 0.4 * map.texel_m;
                hidden += map.mean(points, lanes, margin_m, |before| before.simd_gt(all(margin_m)) & Lanes::ONE);
            }
        }
        Lanes::ONE - hidden * all(self.strength)
    }

    /// Share of the sky's light that reaches surfaces, 0 to 1: less beneath and beside things.
    #[inline]
    pub(crate) fn skylight(&self, position: Vec3s, normal: Vec3s) -> Lanes {
        let points = lanes::add_scaled(position, normal, all(0.3));
        let hidden = self.above.mean(points, 0b1111, 0.0, |above| {
            // What hangs high leaves light from the sides.
            let low = lanes::clamp(Lanes::ONE - above * all(1.0 / 7.0), 0.3, 1.0);
            lanes::clamp(above * all(4.0), 0.0, 1.0) * low
        });
        Lanes::ONE - all(0.85) * hidden
    }
}

fn sun_map(scene: &Scene, view: &View, reach: Reach, texel_m: f32) -> DepthMap {
    let towards = normalized(scene.sun.direction);
    let ahead = if towards[2].abs() < 0.99 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
    let across = normalized(cross(ahead, towards));
    let axes = [across, cross(towards, across), towards];
    DepthMap::new(scene, &Region::around(axes, &seen_corners(scene, view, reach)), texel_m)
}

fn map_from_above(scene: &Scene, view: &View) -> DepthMap {
    let axes = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]];
    let [x, _, z] = view.eye;
    let corners = ABOVE_REACH_M.map(|ahead| [x, 0.0, z + ahead]);
    let wide = corners.map(|c| [-1.0, 1.0].map(|side| add_scaled(c, axes[0], side * ABOVE_HALF_WIDTH_M)));
    DepthMap::new(scene, &Region::around(axes, wide.as_flattened()), ABOVE_TEXEL_M)
}

/// Corners of what the camera sees between two depths.
fn seen_corners(scene: &Scene, view: &View, reach: Reach) -> Vec<Vec3> {
    let [width, height] = scene.image_size.map(|s| s as f32);
    let sides = [view.direction(0.0, height / 2.0), view.direction(width, height / 2.0)];
    let mut corners = Vec::new();
    for depth in reach {
        for side in sides {
            let [x, _, z] = add_scaled(view.eye, side, depth);
            corners.extend(HEIGHTS_M.map(|y| [x, y, z]));
        }
    }
    corners
}
