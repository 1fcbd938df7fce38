//! A triangle seen through a pixel: weights of its corners, and from them position, normal and pattern coordinates.

use wide::f32x4;

use super::lanes::{Lanes, all};
use super::pattern::Holes;
use super::projected::Projected;
use super::samples::OFFSETS;
use super::shade::Fragments;
use super::view::inverted;
use crate::scene::{Object, Triangle, Vertex};
use crate::vector::float;

/// What varies over a triangle, as functions of the pixel, right in perspective.
///
/// Weight / w of each corner is linear in the image, also when a corner lies behind the camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Varying {
    /// Weight / w of the corners.
    rows: [[f64; 3]; 3],
    /// x, y, z and u of the corners.
    places: [f32x4; 3],
    /// Normal and v of the corners.
    facings: [f32x4; 3],
    /// Changes of u / w across and down and of v / w across and down, and twice those of 1 / w.
    slopes: [f32x4; 2],
}

/// What varies, at one pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Interpolated {
    /// Position and u.
    pub(crate) place: [f32; 4],
    /// Normal (of any length) and v.
    pub(crate) facing: [f32; 4],
    /// Changes of u across and down and of v across and down, a pixel.
    pub(crate) slopes: [f32; 4],
}

impl Varying {
    /// From the corners and their homogeneous pixels.
    #[inline]
    pub(crate) fn new([p, q, r]: [&Vertex; 3], [a, b, c]: [[f64; 3]; 3]) -> Self {
        let rows = inverted([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]]);
        let place = |v: &Vertex| f32x4::from([v.position[0], v.position[1], v.position[2], v.uv[0]]);
        let facing = |v: &Vertex| f32x4::from([v.normal[0], v.normal[1], v.normal[2], v.uv[1]]);
        let corner = |v: &Vertex| f32x4::from([v.uv[0], v.uv[0], v.uv[1], v.uv[1]]);
        let slope = |row: [f64; 3]| f32x4::from([row[0] as f32, row[1] as f32, row[0] as f32, row[1] as f32]);
        let [d, e, f] = [slope(rows[0]), slope(rows[1]), slope(rows[2])];
        Self {
            rows,
            places: [place(p), place(q), place(r)],
            facings: [facing(p), facing(q), facing(r)],
            slopes: [corner(p) * d + corner(q) * e + corner(r) * f, d + e + f],
        }
    }

    #[inline]
    pub(crate) fn at(&self, u: f32, v: f32) -> Interpolated {
        let (u, v) = (f64::from(u), f64::from(v));
        let linear = |row: &[f64; 3]| row[0] * u + row[1] * v + row[2];
        let (a, b, c) = (linear(&self.rows[0]), linear(&self.rows[1]), linear(&self.rows[2]));
        let w = 1.0 / (a + b + c);
        let (a, b, c) = (all((a * w) as f32), all((b * w) as f32), all((c * w) as f32));
        let mean = |corners: &[f32x4; 3]| (corners[0] * a + corners[1] * b + corners[2] * c).to_array();
        let (place, facing) = (mean(&self.places), mean(&self.facings));
        let uv = f32x4::from([place[3], place[3], facing[3], facing[3]]);
        let slopes = (self.slopes[0] - uv * self.slopes[1]) * all(w as f32);
        Interpolated { place, facing, slopes: slopes.to_array() }
    }

    /// The same at four neighbouring pixels of a row, from `first` on.
    #[inline]
    pub(crate) fn at_four(&self, first: u32, v: f32) -> Fragments {
        let (u, v) = (f64::from(first), f64::from(v));
        let linear = |row: &[f64; 3]| row[0] * u + row[1] * v + row[2];
        let (a, b, c) = (linear(&self.rows[0]), linear(&self.rows[1]), linear(&self.rows[2]));
        let w = 1.0 / (a + b + c);
        let steps = Lanes::from([0.0, 1.0, 2.0, 3.0]);
        let stepped = |value: f64, slope: f64| all((value * w) as f32) + steps * all((slope * w) as f32);
        let [a, b, c] = [stepped(a, self.rows[0][0]), stepped(b, self.rows[1][0]), stepped(c, self.rows[2][0])];
        let per_w = Lanes::ONE / (a + b + c);
        let weights = [a * per_w, b * per_w, c * per_w];
        let mean = |corners: &[[f32; 4]; 3], i: usize| {
            weights[0] * all(corners[0][i]) + weights[1] * all(corners[1][i]) + weights[2] * all(corners[2][i])
        };
        let places = [self.places[0].to_array(), self.places[1].to_array(), self.places[2].to_array()];
        let facings = [self.facings[0].to_array(), self.facings[1].to_array(), self.facings[2].to_array()];
        let uv = [mean(&places, 3), mean(&facings, 3)];
        let (uv_slopes, w_slopes) = (self.slopes[0].to_array(), self.slopes[1].to_array());
        let scale = per_w * all(w as f32);
        let change = |i: usize| ((all(uv_slopes[i]) - uv[i / 2] * all(w_slopes[i])) * scale).abs();
        Fragments {
            position: [mean(&places, 0), mean(&places, 1), mean(&places, 2)],
            normal: [mean(&facings, 0), mean(&facings, 1), mean(&facings, 2)],
            uv,
            footprint: [change(0) + change(1), change(2) + change(3)],
            columns: [first, first + 3],
        }
    }
}

/// A triangle with holes.
#[derive(Debug, Clone)]
pub(crate) struct Cutout {
    varying: Varying,
    holes: Holes,
}

impl Cutout {
    /// A triangle with these holes.
    #[inline]
    pub(crate) fn new(holes: Holes, object: &Object, triangle: &Triangle, corners: &[Projected]) -> Self {
        let [a, b, c] = triangle.vertices;
        let homogeneous = |v: u32| corners[v as usize].homogeneous;
        let corners = [homogeneous(a), homogeneous(b), homogeneous(c)];
        Self { varying: Varying::new(vertices(object, triangle), corners), holes }
    }

    /// The samples of a pixel that are no hole, as a mask.
    pub(crate) fn kept(&self, x: usize, y: usize) -> Lanes {
        let mask = match &self.holes {
            Holes::Transparent(share) => return all(*share).simd_gt(Lanes::from(TRANSPARENCY_ORDER)),
            Holes::Noise(mask) => mask,
        };
        let at = self.varying.at(float(x), float(y));
        let [u_across, u_down, v_across, v_down] = at.slopes;
        let [dx, dy] = [0, 1].map(|axis| Lanes::from(OFFSETS.map(|offset| offset[axis])));
        let u = all(at.place[3]) + all(u_across) * dx + all(u_down) * dy;
        let v = all(at.facing[3]) + all(v_across) * dx + all(v_down) * dy;
        let extent = (u_across.abs() + u_down.abs()).max(v_across.abs() + v_down.abs());
        // A sample stands for a quarter of the pixel. Which sample asks for how much differs from pixel to pixel, so
        // that no grain shows.
        let share = mask.cover([u, v], all(0.5 * extent));
        share.simd_gt(thresholds((x + 3 * y) & 3))
    }
}

/// How transparent a surface must be for each sample to show it: the same in all pixels, or edges behind it would be
/// combed, and opposite samples first.
const TRANSPARENCY_ORDER: [f32; 4] = [0.125, 0.625, 0.875, 0.375];

/// How much of a sample must be solid for it to count, in four orders.
#[inline]
fn thresholds(turn: usize) -> Lanes {
    const QUARTERS: [f32; 8] = [0.125, 0.375, 0.625, 0.875, 0.125, 0.375, 0.625, 0.875];
    Lanes::from([QUARTERS[turn], QUARTERS[turn + 1], QUARTERS[turn + 2], QUARTERS[turn + 3]])
}

/// The corners of a triangle.
#[inline]
pub(crate) fn vertices<'a>(object: &'a Object, triangle: &Triangle) -> [&'a Vertex; 3] {
    let [a, b, c] = triangle.vertices;
    let vertices = &object.mesh.vertices;
    [&vertices[a as usize], &vertices[b as usize], &vertices[c as usize]]
}
