//! Which samples a triangle covers: edge functions on four samples at a time.
//!
//! Two triangles that share an edge compute the same number with opposite signs for it, and a sample on the edge
//! belongs to both: no cracks.

use wide::f32x4;

use super::noise::mask;
use crate::vector::{float, floor};

/// Added on both sides of a row's span against rounding, pixels.
const SPAN_MARGIN_PX: f32 = 0.002;

/// A picture as the rasteriser sees it: where the four samples of each pixel lie.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grid {
    size: [usize; 2],
    /// Offsets of the samples from the pixel's centre, across and down, pixels.
    samples: [f32x4; 2],
    /// The least and the greatest of them.
    reach: [[f32; 2]; 2],
}

impl Grid {
    /// A picture of `size` pixels with samples at these offsets, pixels.
    pub(crate) fn new(size: [usize; 2], samples: [[f32; 2]; 4]) -> Self {
        let reach = |axis: usize| {
            samples.iter().fold([f32::MAX, f32::MIN], |[least, most], s| [least.min(s[axis]), most.max(s[axis])])
        };
        let offsets = |axis: usize| f32x4::from(samples.map(|s| s[axis]));
        Self { size, samples: [offsets(0), offsets(1)], reach: [reach(0), reach(1)] }
    }

    /// First and last pixel along an axis with samples between two places; none when there are none.
    #[inline]
    fn pixels(&self, axis: usize, least: f32, most: f32) -> Option<[usize; 2]> {
        let [before, after] = self.reach[axis];
        // Cut to the picture before rounding: numbers that are too large for an integer, or none, end up at its edges.
        let limit = float(self.size[axis]);
        let first = -floor(-(least - after - SPAN_MARGIN_PX).clamp(0.0, limit));
        let last = floor((most - before + SPAN_MARGIN_PX).clamp(-1.0, limit - 1.0));
        (first <= last).then_some([first as usize, last.max(0) as usize])
    }
}

/// A corner in the image: column, row, and the quantity that is compared, larger is nearer; linear across the image.
pub(crate) type Corner = [f64; 3];

/// Where the covered samples go.
pub(crate) trait Target {
    /// Takes the samples of a pixel for which `inside` is set, with their nearness. Pixels count row by row.
    fn put(&mut self, pixel: usize, inside: f32x4, nearness: f32x4);

    /// Whether nothing up to `nearness` would change anything between two columns and two rows.
    #[inline]
    fn hides(&self, _columns: [usize; 2], _rows: [usize; 2], _nearness: f32) -> bool {
        false
    }
}

/// A linear function of the image: `a * u + b * v + c`.
#[derive(Debug, Clone, Copy)]
struct Plane {
    a: f64,
    b: f64,
    c: f64,
}

impl Plane {
    /// Positive on one side of the line from `p` to `q`; exchanging them changes the sign and nothing else.
    #[inline]
    fn edge(p: &Corner, q: &Corner) -> Self {
        let swapped = q[1] < p[1] || (q[1] <= p[1] && q[0] < p[0]);
        let (first, second) = if swapped { (q, p) } else { (p, q) };
        let (a, b) = (first[1] - second[1], second[0] - first[0]);
        let plane = Self { a, b, c: -(a * first[0] + b * first[1]) };
        if swapped { plane.times(-1.0) } else { plane }
    }

    #[inline]
    fn times(self, factor: f64) -> Self {
        Self { a: self.a * factor, b: self.b * factor, c: self.c * factor }
    }

    /// The same, with columns counted from `first`.
    #[inline]
    fn counted_from(self, first: f64) -> Self {
        Self { c: self.c + self.a * first, ..self }
    }

    /// How the samples of a pixel differ from its centre.
    #[inline]
    fn offsets(&self, grid: &Grid) -> f32x4 {
        f32x4::splat(self.a as f32) * grid.samples[0] + f32x4::splat(self.b as f32) * grid.samples[1]
    }
}

/// The three edges of a triangle and its nearness, prepared for going through rows.
struct Rows {
    /// Changes a row, and values in row 0 and column 0, of the edges and of the nearness; that counts columns from its
    /// own origin.
    down: [f64; 4],
    at_zero: [f64; 4],
    /// Changes a column.
    across: [f32x4; 4],
    /// How the samples of a pixel differ from its centre.
    offsets: [f32x4; 4],
    /// The most that any sample lies inside of the pixel's centre, by edge.
    reach: f32x4,
    /// -1 / change a column, by edge; 0 for a level one.
    turned: f32x4,
    /// Masks of the edges that begin and that end a row, and of those that are level.
    begins: f32x4,
    ends: f32x4,
    level: f32x4,
}

/// A row of a triangle: edges and nearness as functions of the column.
#[derive(Clone, Copy)]
struct Row {
    at_zero: [f32x4; 4],
}

impl Rows {
    #[inline]
    fn new(planes: &[Plane; 4], grid: &Grid) -> Self {
        let across = planes.each_ref().map(|plane| f32x4::splat(plane.a as f32));
        let offsets = [0, 1, 2, 3].map(|i| planes[i].offsets(grid));
        let slopes = f32x4::from([planes[0].a as f32, planes[1].a as f32, planes[2].a as f32, 0.0]);
        let level = slopes.simd_eq(f32x4::ZERO);
        let [a, b, c, d] = f32x4::transpose(offsets);
        Self {
            down: [planes[0].b, planes[1].b, planes[2].b, planes[3].b],
            at_zero: [planes[0].c, planes[1].c, planes[2].c, planes[3].c],
            across,
            offsets,
            reach: a.fast_max(b).fast_max(c.fast_max(d)),
            turned: level.bitselect(f32x4::ZERO, f32x4::splat(-1.0) / slopes),
            begins: slopes.simd_gt(f32x4::ZERO),
            ends: slopes.simd_lt(f32x4::ZERO),
            // The fourth is no edge.
            level: level & mask(0b0111),
        }
    }

    /// The row, and the columns between which it may be inside, cut from `columns`; none when it is empty.
    #[inline]
    fn row(&self, y: usize, columns: [usize; 2]) -> Option<(Row, [usize; 2])> {
        let y = f64::from(float(y));
        let at = |i: usize| (self.down[i] * y + self.at_zero[i]) as f32;
        let at = f32x4::from([at(0), at(1), at(2), at(3)]);
        let reach = at + self.reach;
        if (self.level & reach.simd_lt(f32x4::ZERO)).to_bitmask() != 0 {
            return None;
        }
        let crossing = reach * self.turned;
        let margin = f32x4::splat(SPAN_MARGIN_PX);
        let [first, last] = [float(columns[0]), float(columns[1])];
        let begin = greatest(self.begins.bitselect(crossing - margin, f32x4::splat(first)));
        let end = least(self.ends.bitselect(crossing + margin, f32x4::splat(last)));
        let (begin, end) = (larger(begin, first), smaller(end, last));
        if end < begin {
            return None;
        }
        let [a, b, c, d] = at.to_array();
        let splat = |i: usize, value: f32| f32x4::splat(value) + self.offsets[i];
        let row = Row { at_zero: [splat(0, a), splat(1, b), splat(2, c), splat(3, d)] };
        // Both lie within the picture.
        Some((row, [(-floor(-begin)) as usize, end as usize]))
    }
}

#[inline]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline]
fn greatest(values: f32x4) -> f32 {
    let [a, b, c, d] = values.to_array();
    larger(larger(a, b), larger(c, d))
}

#[inline]
fn least(values: f32x4) -> f32 {
    let [a, b, c, d] = values.to_array();
    smaller(smaller(a, b), smaller(c, d))
}

/// Gives `target` the samples inside the triangle. `nearer` is a factor on the nearness, for paint on a surface.
#[inline]
pub(crate) fn fill(grid: &Grid, corners: &[Corner; 3], nearer: f32, target: &mut impl Target) {
    let Some([columns, rows]) = bounds(grid, corners) else { return };
    let nearest = larger(larger(corners[0][2] as f32, corners[1][2] as f32), corners[2][2] as f32);
    if !target.hides(columns, rows, nearest * nearer) {
        fill_within(grid, corners, [columns, rows], f64::from(nearer), target);
    }
}

fn fill_within(
    grid: &Grid,
    [p, q, r]: &[Corner; 3],
    [columns, rows]: [[usize; 2]; 2],
    nearer: f64,
    target: &mut impl Target,
) {
    let area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    // Each edge is opposite to a corner: divided by the area it is that corner's weight.
    let planes = [Plane::edge(q, r), Plane::edge(r, p), Plane::edge(p, q)];
    let inwards = if area < 0.0 { -1.0 } else { 1.0 };
    let values = [p[2] * nearer, q[2] * nearer, r[2] * nearer];
    // Counted from the triangle's own first column: far away from it the plane's values are large and lose digits.
    let origin = float(columns[0]);
    let nearness = nearness_plane(&planes, values, area).counted_from(f64::from(origin));
    let [e, f, g] = [planes[0].times(inwards), planes[1].times(inwards), planes[2].times(inwards)];
    let prepared = Rows::new(&[e, f, g, nearness], grid);
    let values = f32x4::from([values[0] as f32, values[1] as f32, values[2] as f32, values[2] as f32]);
    let limits = [f32x4::splat(least(values)), f32x4::splat(greatest(values))];
    let across = prepared.across;
    // Ranges that name their last number cost twice as much in loops as short as these.
    let end_row = rows[1] + 1;
    for y in rows[0]..end_row {
        let Some((row, [first, last])) = prepared.row(y, columns) else { continue };
        let mut column = f32x4::splat(float(first));
        let mut own_column = column - f32x4::splat(origin);
        let end = y * grid.size[0] + last + 1;
        for pixel in y * grid.size[0] + first..end {
            let edge = |i: usize| row.at_zero[i] + across[i] * column;
            // The least of the three is not negative only where all are inside.
            let inside = edge(0).fast_min(edge(1)).fast_min(edge(2)).simd_ge(f32x4::ZERO);
            if inside.to_bitmask() != 0 {
                let nearness = row.at_zero[3] + across[3] * own_column;
                target.put(pixel, inside, nearness.fast_max(limits[0]).fast_min(limits[1]));
            }
            column += f32x4::ONE;
            own_column += f32x4::ONE;
        }
    }
}

/// Columns and rows that the triangle may touch, first and last of each.
#[inline]
fn bounds(grid: &Grid, [p, q, r]: &[Corner; 3]) -> Option<[[usize; 2]; 2]> {
    let range = |axis: usize| {
        let (a, b, c) = (p[axis] as f32, q[axis] as f32, r[axis] as f32);
        grid.pixels(axis, a.min(b).min(c), a.max(b).max(c))
    };
    Some([range(0)?, range(1)?])
}

/// The plane that takes `values` at the corners.
#[inline]
fn nearness_plane([e, f, g]: &[Plane; 3], [p, q, r]: [f64; 3], area: f64) -> Plane {
    let scale = 1.0 / area;
    let (p, q, r) = (p * scale, q * scale, r * scale);
    Plane { a: e.a * p + f.a * q + g.a * r, b: e.b * p + f.b * q + g.b * r, c: e.c * p + f.c * q + g.c * r }
}
