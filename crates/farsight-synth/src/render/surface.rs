//! A triangle seen through a pixel: weights of its corners, and from them position, normal and pattern coordinates.

use wide::f32x4;

use super::pattern::{Footprint, Holes};
use super::view::inverted;
use super::visibility::Projected;
use crate::scene::{Object, Scene, Triangle, Vec3, Vertex};

/// Weights of the three corners as functions of the pixel, right in perspective.
///
/// Weight / w is linear in the image, also when a corner lies behind the camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights {
    rows: [[f64; 3]; 3],
    /// Their sum: 1 / w.
    sums: [f64; 3],
}

/// The weights at one pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WeightsAt {
    /// One a corner, sum 1.
    weights: [f32; 3],
    /// Their changes a pixel across and down.
    slopes: [[f32; 3]; 2],
}

impl Weights {
    /// From homogeneous pixels of the corners.
    #[inline]
    pub(crate) fn new([a, b, c]: [[f64; 3]; 3]) -> Self {
        let rows = inverted([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]]);
        let sum = |axis: usize| rows[0][axis] + rows[1][axis] + rows[2][axis];
        Self { rows, sums: [sum(0), sum(1), sum(2)] }
    }

    #[inline]
    pub(crate) fn at(&self, u: f32, v: f32) -> WeightsAt {
        let (u, v) = (f64::from(u), f64::from(v));
        let linear = |row: &[f64; 3]| row[0] * u + row[1] * v + row[2];
        let w = 1.0 / linear(&self.sums);
        let [a, b, c] = &self.rows;
        let weights = [linear(a) * w, linear(b) * w, linear(c) * w];
        let slope = |i: usize, axis: usize| ((self.rows[i][axis] - weights[i] * self.sums[axis]) * w) as f32;
        WeightsAt {
            weights: [weights[0] as f32, weights[1] as f32, weights[2] as f32],
            slopes: [[slope(0, 0), slope(1, 0), slope(2, 0)], [slope(0, 1), slope(1, 1), slope(2, 1)]],
        }
    }
}

impl WeightsAt {
    /// A vector that varies over the triangle.
    #[inline]
    pub(crate) fn vector(&self, [p, q, r]: &[Vec3; 3]) -> Vec3 {
        let [a, b, c] = self.weights;
        let axis = |i: usize| a * p[i] + b * q[i] + c * r[i];
        [axis(0), axis(1), axis(2)]
    }

    /// Pattern coordinates and how much of the pattern the pixel covers.
    #[inline]
    pub(crate) fn uv(&self, [p, q, r]: &[[f32; 2]; 3]) -> ([f32; 2], Footprint) {
        let sum = |weights: &[f32; 3], i: usize| weights[0] * p[i] + weights[1] * q[i] + weights[2] * r[i];
        let extent = |i: usize| sum(&self.slopes[0], i).abs() + sum(&self.slopes[1], i).abs();
        ([sum(&self.weights, 0), sum(&self.weights, 1)], [extent(0), extent(1)])
    }
}

/// A triangle with holes.
#[derive(Debug, Clone)]
pub(crate) struct Cutout {
    weights: Weights,
    uv: [[f32; 2]; 3],
    holes: Holes,
}

impl Cutout {
    /// The holes of a triangle, if its material has any.
    pub(crate) fn of(scene: &Scene, object: &Object, triangle: &Triangle, corners: &[Projected]) -> Option<Self> {
        let holes = Holes::of(&scene.materials[usize::from(triangle.material)].pattern)?;
        let weights = Weights::new(triangle.vertices.map(|v| corners[v as usize].homogeneous));
        Some(Self { weights, uv: vertices(object, triangle).map(|v| v.uv), holes })
    }

    /// The samples of a pixel that are no hole, as a mask.
    pub(crate) fn kept(&self, x: usize, y: usize) -> f32x4 {
        let (uv, footprint) = self.weights.at(x as f32, y as f32).uv(&self.uv);
        let share = self.holes.cover(uv, footprint);
        // A quarter of the samples for each quarter of the share; which ones differs from pixel to pixel, so that no grain shows.
        let turn = (x + 3 * y) & 3;
        let kept = |sample: usize| {
            let threshold = (((sample + turn) & 3) as f32 + 0.5) * 0.25;
            f32::from_bits(if share > threshold { u32::MAX } else { 0 })
        };
        f32x4::from([kept(0), kept(1), kept(2), kept(3)])
    }
}

/// The corners of a triangle.
#[inline]
pub(crate) fn vertices<'a>(object: &'a Object, triangle: &Triangle) -> [&'a Vertex; 3] {
    triangle.vertices.map(|v| &object.mesh.vertices[v as usize])
}
