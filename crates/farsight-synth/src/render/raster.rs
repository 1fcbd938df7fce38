//! Which samples a triangle covers: edge functions on four samples at a time.
//!
//! Two triangles that share an edge compute the same number with opposite signs for it, and a sample on the edge belongs to both: no cracks.

use wide::f32x4;

/// Added on both sides of a row's span against rounding, pixels.
const SPAN_MARGIN_PX: f32 = 0.002;

/// A picture element as the rasteriser sees it: where its four samples lie, relative to its centre, in pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grid {
    /// Number of columns and rows.
    pub(crate) size: [usize; 2],
    /// Offsets of the samples across and down.
    pub(crate) samples: [[f32; 2]; 4],
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

/// A linear function in one row, on four samples.
#[derive(Clone, Copy)]
struct RowPlane {
    slope: f32x4,
    at_zero: f32x4,
}

impl Plane {
    /// Positive on one side of the line from `p` to `q`; exchanging them changes the sign and nothing else.
    fn edge(p: Corner, q: Corner) -> Self {
        let swapped = (q[1], q[0]) < (p[1], p[0]);
        let (first, second) = if swapped { (q, p) } else { (p, q) };
        let (a, b) = (first[1] - second[1], second[0] - first[0]);
        let plane = Self { a, b, c: -(a * first[0] + b * first[1]) };
        if swapped { plane.times(-1.0) } else { plane }
    }

    fn times(self, factor: f64) -> Self {
        Self { a: self.a * factor, b: self.b * factor, c: self.c * factor }
    }

    fn offsets(self, grid: &Grid) -> [f32; 4] {
        let (a, b) = (self.a as f32, self.b as f32);
        grid.samples.map(|[dx, dy]| a * dx + b * dy)
    }
}

impl RowPlane {
    #[inline]
    fn at(self, x: f32x4) -> f32x4 {
        self.at_zero + self.slope * x
    }
}

/// One edge, prepared for going through rows.
#[derive(Clone, Copy)]
struct Edge {
    plane: Plane,
    slope: f32,
    /// -1 / slope, or 0 for a horizontal edge.
    crossing: f32,
    offsets: f32x4,
    /// The most that any sample lies inside of the pixel's centre.
    reach: f32,
}

impl Edge {
    fn new(plane: Plane, grid: &Grid) -> Self {
        let slope = plane.a as f32;
        let offsets = plane.offsets(grid);
        let crossing = if slope == 0.0 { 0.0 } else { -1.0 / slope };
        let reach = offsets.iter().fold(f32::NEG_INFINITY, |most, &o| most.max(o));
        Self { plane, slope, crossing, offsets: f32x4::from(offsets), reach }
    }

    /// The edge in row `y`, and `span` cut to where it can be positive.
    #[inline]
    fn row(&self, y: f64, span: &mut [f32; 2]) -> RowPlane {
        let at_zero = (self.plane.b * y + self.plane.c) as f32;
        let reach = at_zero + self.reach;
        let crossing = reach * self.crossing;
        if self.slope > 0.0 {
            span[0] = span[0].max(crossing - SPAN_MARGIN_PX);
        } else if self.slope < 0.0 {
            span[1] = span[1].min(crossing + SPAN_MARGIN_PX);
        } else if reach < 0.0 {
            *span = [1.0, 0.0];
        }
        RowPlane { slope: f32x4::splat(self.slope), at_zero: f32x4::splat(at_zero) + self.offsets }
    }
}

/// Gives `target` the samples inside the triangle. `nearer` is a factor on the nearness, for paint on a surface.
pub(crate) fn fill(grid: &Grid, corners: [Corner; 3], nearer: f32, target: &mut impl Target) {
    let Some([x0, y0, x1, y1]) = bounds(grid, &corners) else { return };
    let [p, q, r] = corners;
    let area = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    // Each edge is opposite to a corner: divided by the area it is that corner's weight.
    let planes = [Plane::edge(q, r), Plane::edge(r, p), Plane::edge(p, q)];
    let edges = planes.map(|plane| Edge::new(plane.times(area.signum()), grid));
    let nearness = nearness_plane(&planes, [p[2], q[2], r[2]], area);
    let nearness_offsets = f32x4::from(nearness.offsets(grid));
    let least = f32x4::splat(p[2].min(q[2]).min(r[2]) as f32);
    let most = f32x4::splat(p[2].max(q[2]).max(r[2]) as f32);
    let nearer = f32x4::splat(nearer);
    let slope = f32x4::splat(nearness.a as f32);
    let zero = f32x4::splat(0.0);
    for y in y0..=y1 {
        let row = y as f64;
        let mut span = [x0 as f32, x1 as f32];
        let [e0, e1, e2] = [0, 1, 2].map(|i| edges[i].row(row, &mut span));
        let depth =
            RowPlane { slope, at_zero: f32x4::splat((nearness.b * row + nearness.c) as f32) + nearness_offsets };
        let (from, to) = (span[0].ceil() as usize, span[1].floor());
        if to < span[0] {
            continue;
        }
        for x in from..=to as usize {
            let column = f32x4::splat(x as f32);
            let inside = e0.at(column).simd_ge(zero) & e1.at(column).simd_ge(zero) & e2.at(column).simd_ge(zero);
            if inside.to_bitmask() != 0 {
                target.put(x, y, inside, depth.at(column).fast_max(least).fast_min(most) * nearer);
            }
        }
    }
}

/// Columns and rows that the triangle may touch: first column, first row, last column, last row.
fn bounds(grid: &Grid, corners: &[Corner; 3]) -> Option<[usize; 4]> {
    let [p, q, r] = corners;
    let range = |axis: usize| {
        let least = p[axis].min(q[axis]).min(r[axis]);
        let most = p[axis].max(q[axis]).max(r[axis]);
        let reach = |sign: f32| f64::from(grid.samples.iter().fold(0.0_f32, |m, s| m.max(s[axis] * sign)));
        let first = (least - reach(1.0)).ceil().max(0.0);
        let last = (most + reach(-1.0)).floor().min(grid.size[axis] as f64 - 1.0);
        // Also false when a value is not a number.
        (first <= last).then_some([first as usize, last as usize])
    };
    let ([x0, x1], [y0, y1]) = (range(0)?, range(1)?);
    Some([x0, y0, x1, y1])
}

/// The plane that takes `values` at the corners.
fn nearness_plane(planes: &[Plane; 3], values: [f64; 3], area: f64) -> Plane {
    let sum = |f: fn(&Plane) -> f64| (0..3).map(|i| f(&planes[i]) * values[i]).sum::<f64>() / area;
    Plane { a: sum(|p| p.a), b: sum(|p| p.b), c: sum(|p| p.c) }
}
