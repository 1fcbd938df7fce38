//! Which samples a triangle covers: edge functions on four samples at a time.
//!
//! Two triangles that share an edge compute the same number with opposite signs for it, and a sample on the edge belongs to both: no cracks.

use wide::f32x4;

use crate::vector::{float, floor};

/// Added on both sides of a row's span against rounding, pixels.
const SPAN_MARGIN_PX: f32 = 0.002;

/// Triangles with at most so many columns are not worth finding each row's span.
const NARROW: usize = 3;

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
    /// Takes the samples of the pixel in column `x` of row `y` for which `inside` is set, with their nearness.
    fn put(&mut self, x: usize, y: usize, inside: f32x4, nearness: f32x4);
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

/// A plane, prepared for going through rows.
#[derive(Clone, Copy)]
struct Slope {
    plane: Plane,
    across: f32x4,
    offsets: f32x4,
}

/// A plane in one row, on four samples.
#[derive(Clone, Copy)]
struct Row {
    across: f32x4,
    at_zero: f32x4,
}

impl Slope {
    #[inline]
    fn new(plane: Plane, grid: &Grid) -> Self {
        Self { plane, across: f32x4::splat(plane.a as f32), offsets: plane.offsets(grid) }
    }

    #[inline]
    fn row(&self, y: f64) -> Row {
        let at_zero = (self.plane.b * y + self.plane.c) as f32;
        Row { across: self.across, at_zero: f32x4::splat(at_zero) + self.offsets }
    }
}

impl Row {
    #[inline]
    fn at(self, x: f32x4) -> f32x4 {
        self.at_zero + self.across * x
    }
}

/// Where an edge crosses rows.
#[derive(Clone, Copy)]
struct Crossing {
    slope: f32,
    /// -1 / slope, or 0 for a level edge.
    turned: f32,
    /// The most that any sample lies inside of the pixel's centre.
    reach: f32,
}

impl Crossing {
    #[inline]
    fn new(edge: &Slope) -> Self {
        let slope = edge.plane.a as f32;
        let [a, b, c, d] = edge.offsets.to_array();
        let turned = if slope.abs() > 0.0 { -1.0 / slope } else { 0.0 };
        Self { slope, turned, reach: a.max(b).max(c.max(d)) }
    }

    /// Cuts `span` to where the edge can be positive in row `y`.
    #[inline]
    fn cut(&self, edge: &Slope, y: f64, span: &mut [f32; 2]) {
        let reach = (edge.plane.b * y + edge.plane.c) as f32 + self.reach;
        let crossing = reach * self.turned;
        if self.slope > 0.0 {
            span[0] = span[0].max(crossing - SPAN_MARGIN_PX);
        } else if self.slope < 0.0 {
            span[1] = span[1].min(crossing + SPAN_MARGIN_PX);
        } else if reach < 0.0 {
            *span = [1.0, 0.0];
        }
    }
}

/// Gives `target` the samples inside the triangle. `nearer` is a factor on the nearness, for paint on a surface.
#[inline]
pub(crate) fn fill(grid: &Grid, corners: &[Corner; 3], nearer: f32, target: &mut impl Target) {
    if let Some(bounds) = bounds(grid, corners) {
        fill_within(grid, corners, bounds, nearer, target);
    }
}

fn fill_within(
    grid: &Grid,
    [p, q, r]: &[Corner; 3],
    [columns, rows]: [[usize; 2]; 2],
    nearer: f32,
    target: &mut impl Target,
) {
    let area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    // Each edge is opposite to a corner: divided by the area it is that corner's weight.
    let planes = [Plane::edge(q, r), Plane::edge(r, p), Plane::edge(p, q)];
    let inwards = if area < 0.0 { -1.0 } else { 1.0 };
    let edge = |i: usize| Slope::new(planes[i].times(inwards), grid);
    let edges = [edge(0), edge(1), edge(2)];
    // Counted from the triangle's own first column: far away from it the plane's values are large and lose digits.
    let origin = f32x4::splat(float(columns[0]));
    let nearness = nearness_plane(&planes, [p[2], q[2], r[2]], area).counted_from(f64::from(float(columns[0])));
    let nearness = Slope::new(nearness, grid);
    let least = f32x4::splat(p[2].min(q[2]).min(r[2]) as f32);
    let most = f32x4::splat(p[2].max(q[2]).max(r[2]) as f32);
    let nearer = f32x4::splat(nearer);
    let narrow = columns[1] - columns[0] < NARROW;
    let crossings = [Crossing::new(&edges[0]), Crossing::new(&edges[1]), Crossing::new(&edges[2])];
    // Ranges that name their last number cost twice as much in loops as short as these.
    let end_row = rows[1] + 1;
    for y in rows[0]..end_row {
        let row = f64::from(float(y));
        let mut from_to = columns;
        if !narrow {
            let mut span = [float(columns[0]), float(columns[1])];
            for (crossing, edge) in crossings.iter().zip(&edges) {
                crossing.cut(edge, row, &mut span);
            }
            if span[1] < span[0] {
                continue;
            }
            // Both lie within the picture: they were cut from its columns.
            from_to = [(-floor(-span[0])) as usize, span[1] as usize];
        }
        let [e0, e1, e2] = [edges[0].row(row), edges[1].row(row), edges[2].row(row)];
        let depth = nearness.row(row);
        let end = from_to[1] + 1;
        for x in from_to[0]..end {
            let column = f32x4::splat(float(x));
            // The sign of the least of the three is clear only where all are inside.
            let inside = e0.at(column).fast_min(e1.at(column)).fast_min(e2.at(column)).simd_ge(f32x4::ZERO);
            if inside.to_bitmask() != 0 {
                target.put(x, y, inside, depth.at(column - origin).fast_max(least).fast_min(most) * nearer);
            }
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
