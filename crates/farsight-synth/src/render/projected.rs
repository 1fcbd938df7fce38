//! Meshes as the camera sees them: corners in pixels, triangles cut at the near plane.

use super::raster::{Corner, Grid, Target, fill};
use super::view::{NEAR_M, View};
use crate::scene::{Object, Triangle};

/// How much nearer each layer of paint counts than the surface below: bridges 3 mm of height seen from 1.5 m above.
const NEARER_PER_LAYER: f32 = 0.002;

/// A corner of a mesh as the camera sees it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Projected {
    /// Homogeneous pixel.
    pub(crate) homogeneous: [f64; 3],
    /// Pixel and nearness, if the corner lies beyond the near plane.
    place: Option<Corner>,
}

impl Projected {
    #[inline]
    fn new(homogeneous: [f64; 3]) -> Self {
        Self { homogeneous, place: (homogeneous[2] >= NEAR_M).then(|| divided(homogeneous)) }
    }
}

#[inline]
fn divided([u, v, w]: [f64; 3]) -> Corner {
    let nearness = 1.0 / w;
    [u * nearness, v * nearness, nearness]
}

/// All the object's corners as the camera sees them.
pub(super) fn project(view: &View, object: &Object, corners: &mut Vec<Projected>) {
    corners.clear();
    corners.extend(object.mesh.vertices.iter().map(|vertex| Projected::new(view.homogeneous(vertex.position))));
}

/// Gives `target` what the camera sees of a triangle, were it alone.
#[inline]
pub(super) fn draw(grid: &Grid, triangle: &Triangle, corners: &[Projected], target: &mut impl Target) {
    let nearer = 1.0 + NEARER_PER_LAYER * f32::from(triangle.layer);
    let [a, b, c] = triangle.vertices;
    let [a, b, c] = [&corners[a as usize], &corners[b as usize], &corners[c as usize]];
    match (a.place, b.place, c.place) {
        (Some(a), Some(b), Some(c)) => fill(grid, &[a, b, c], nearer, target),
        (None, None, None) => {}
        _ => {
            let (kept, count) = clipped([a.homogeneous, b.homogeneous, c.homogeneous]);
            for i in 2..count {
                fill(grid, &[divided(kept[0]), divided(kept[i - 1]), divided(kept[i])], nearer, target);
            }
        }
    }
}

/// The part of a triangle beyond the near plane: up to four corners, and how many.
fn clipped(corners: [[f64; 3]; 3]) -> ([[f64; 3]; 4], usize) {
    let mut kept = [[0.0; 3]; 4];
    let mut count = 0;
    let mut keep = |corner| {
        kept[count] = corner;
        count += 1;
    };
    for i in 0..3 {
        let (here, next) = (corners[i], corners[(i + 1) % 3]);
        let (inside, next_inside) = (here[2] >= NEAR_M, next[2] >= NEAR_M);
        if inside {
            keep(here);
        }
        if inside != next_inside {
            // Always from the inner end, so that neighbours cut their common edge at the same point.
            keep(if inside { crossing(here, next) } else { crossing(next, here) });
        }
    }
    (kept, count)
}

fn crossing(inner: [f64; 3], outer: [f64; 3]) -> [f64; 3] {
    let t = (inner[2] - NEAR_M) / (inner[2] - outer[2]);
    [inner[0] + (outer[0] - inner[0]) * t, inner[1] + (outer[1] - inner[1]) * t, NEAR_M]
}
