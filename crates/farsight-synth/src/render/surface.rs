//! A triangle seen through a pixel: weights of its corners, and from them position, normal and pattern coordinates.

use wide::f32x4;

use super::pattern::{self, Footprint};
use super::view::inverted;
use crate::scene::{Object, Pattern, Scene, Triangle, Vec3, Vertex};

/// Weights of the three corners as functions of the pixel, right in perspective.
///
/// Weight / w is linear in the image, also when a corner lies behind the camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights {
    rows: [[f64; 3]; 3],
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
    pub(crate) fn new(corners: [[f64; 3]; 3]) -> Self {
        let columns = [0, 1, 2].map(|row| corners.map(|corner| corner[row]));
        Self { rows: inverted(columns) }
    }

    #[inline]
    pub(crate) fn at(&self, u: f32, v: f32) -> WeightsAt {
        let (u, v) = (f64::from(u), f64::from(v));
        let over_w = self.rows.map(|row| row[0] * u + row[1] * v + row[2]);
        let w = 1.0 / (over_w[0] + over_w[1] + over_w[2]);
        let weights = over_w.map(|value| value * w);
        let slope = |axis: usize| {
            let sum = self.rows[0][axis] + self.rows[1][axis] + self.rows[2][axis];
            [0, 1, 2].map(|i| ((self.rows[i][axis] - weights[i] * sum) * w) as f32)
        };
        WeightsAt { weights: weights.map(|value| value as f32), slopes: [slope(0), slope(1)] }
    }
}

impl WeightsAt {
    /// A vector that varies over the triangle.
    #[inline]
    pub(crate) fn vector(&self, corners: [Vec3; 3]) -> Vec3 {
        [0, 1, 2].map(|axis| self.value(corners.map(|corner| corner[axis])))
    }

    #[inline]
    fn value(&self, corners: [f32; 3]) -> f32 {
        let [a, b, c] = self.weights;
        a * corners[0] + b * corners[1] + c * corners[2]
    }

    /// Pattern coordinates and how much of the pattern the pixel covers.
    #[inline]
    pub(crate) fn uv(&self, corners: [[f32; 2]; 3]) -> ([f32; 2], Footprint) {
        let by_axis = [0, 1].map(|axis| {
            let values = corners.map(|corner| corner[axis]);
            let change = |slope: [f32; 3]| slope[0] * values[0] + slope[1] * values[1] + slope[2] * values[2];
            (self.value(values), change(self.slopes[0]).abs() + change(self.slopes[1]).abs())
        });
        (by_axis.map(|(value, _)| value), by_axis.map(|(_, extent)| extent))
    }
}

/// A triangle with holes.
#[derive(Debug, Clone)]
pub(crate) struct Cutout {
    weights: Weights,
    uv: [[f32; 2]; 3],
    pattern: Pattern,
}

impl Cutout {
    /// The holes of a triangle, if its material has any.
    pub(crate) fn of(scene: &Scene, object: &Object, triangle: &Triangle, corners: &[[f64; 3]]) -> Option<Self> {
        let pattern = scene.materials[usize::from(triangle.material)].pattern;
        if !pattern::has_holes(&pattern) {
            return None;
        }
        let weights = Weights::new(triangle.vertices.map(|v| corners[v as usize]));
        Some(Self { weights, uv: vertices(object, triangle).map(|v| v.uv), pattern })
    }

    /// The samples of a pixel that are no hole, as a mask.
    pub(crate) fn kept(&self, x: usize, y: usize) -> f32x4 {
        let (uv, footprint) = self.weights.at(x as f32, y as f32).uv(self.uv);
        let share = pattern::cover(&self.pattern, uv, footprint);
        // A quarter of the samples for each quarter of the share; which ones differs from pixel to pixel, so that no grain shows.
        let turn = (x + 3 * y) & 3;
        let kept = |sample: usize| {
            let threshold = (((sample + turn) & 3) as f32 + 0.5) * 0.25;
            f32::from_bits(if share > threshold { u32::MAX } else { 0 })
        };
        f32x4::from([kept(0), kept(1), kept(2), kept(3)])
    }
}

/// Share of a triangle that is no hole, in all: what a shadow needs to know.
pub(crate) fn solid_share(pattern: &Pattern, corners: &[&Vertex; 3]) -> f32 {
    if pattern::has_holes(pattern) { pattern::cover(pattern, corners[0].uv, [f32::MAX; 2]) } else { 1.0 }
}

/// The corners of a triangle.
#[inline]
pub(crate) fn vertices<'a>(object: &'a Object, triangle: &Triangle) -> [&'a Vertex; 3] {
    triangle.vertices.map(|v| &object.mesh.vertices[v as usize])
}
