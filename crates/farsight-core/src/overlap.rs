//! Overlap of boxes: axis-aligned in the image, rotated in the ground plane, and in space.
//!
//! The definitions are those of the KITTI devkit (spec kitti-eval.md, section 2, rules 23 to 25), computed in `f64`
//! without allocation. Every answer is a number from 0 to 1: boxes that are empty, swapped, infinite or not numbers
//! overlap nothing. The devkit's polygon library is wrong for some pairs with collinear edges and crashes on others
//! (rule 26); here one rectangle is clipped by the four sides of the other in the other's own axes, where a shared edge
//! is only a comparison of two numbers.

use crate::{Box2d, Box3d};

/// Intersection over union of two boxes in the image; no pixel is added to widths and heights.
pub fn iou_2d(a: &Box2d, b: &Box2d) -> f64 {
    let shared = intersection_2d(a, b);
    share(shared, a.area() + b.area() - shared)
}

/// Share of `a`'s area that lies inside `b`: the devkit's measure for `DontCare` regions.
pub fn covered_share_2d(a: &Box2d, b: &Box2d) -> f64 {
    share(intersection_2d(a, b), a.area())
}

/// Intersection over union of two boxes seen from above.
///
/// ```
/// use farsight_core::{Box3d, Dimensions, overlap::iou_bev};
/// let dimensions = Dimensions { height: 1.5, width: 2.0, length: 4.0 };
/// let parked = Box3d { dimensions, location: [0.0, 1.6, 20.0], yaw: 0.3 };
/// assert_eq!(iou_bev(&parked, &parked), 1.0);
/// ```
pub fn iou_bev(a: &Box3d, b: &Box3d) -> f64 {
    Block::new(a).overlap(&Block::new(b)).bev
}

/// Intersection over union of two boxes in space.
pub fn iou_3d(a: &Box3d, b: &Box3d) -> f64 {
    Block::new(a).overlap(&Block::new(b)).volume
}

/// How much of two blocks, or of one, is shared.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Overlap {
    /// Seen from above.
    pub bev: f64,
    /// In space.
    pub volume: f64,
}

/// A [`Box3d`] prepared for many overlaps: what depends on one box alone is computed once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// Centre on the ground (x, z), metres.
    center: [f64; 2],
    /// Half the length and half the width, metres; both 0 when the footprint is empty.
    half: [f64; 2],
    yaw: f64,
    sin_cos: (f64, f64),
    /// Of the circle around the footprint, metres.
    radius: f64,
    /// The smaller and the larger y, metres (y points down, so the bottom is the larger).
    top_bottom: [f64; 2],
}

impl Block {
    /// Prepares `box3d`.
    ///
    /// A negative length **and** width is the same footprint turned by half a turn, which the devkit accepts too; when
    /// only one is negative (the devkit crashes), or one is zero or not a number, the footprint is empty.
    pub fn new(box3d: &Box3d) -> Self {
        let [x, y, z] = box3d.location;
        let size = box3d.dimensions;
        let is_solid = size.length * size.width > 0.0;
        let half = if is_solid { [size.length, size.width].map(|d| d.abs() / 2.0) } else { [0.0; 2] };
        Self {
            center: [x, z],
            half,
            yaw: box3d.yaw,
            sin_cos: box3d.yaw.sin_cos(),
            radius: half[0].hypot(half[1]),
            top_bottom: [y - size.height, y],
        }
    }

    /// Area of the footprint, square metres.
    pub fn area(&self) -> f64 {
        4.0 * self.half[0] * self.half[1]
    }

    /// Whether the circles around the footprints meet; when they do not, nothing overlaps.
    pub fn may_touch(&self, other: &Self) -> bool {
        let offset = [0, 1].map(|i| other.center[i] - self.center[i]);
        let reach = self.radius + other.radius;
        offset[0] * offset[0] + offset[1] * offset[1] <= reach * reach
    }

    /// Both overlaps with `other`.
    pub fn overlap(&self, other: &Self) -> Overlap {
        self.shared_over(
            other,
            |area, shared| area + other.area() - shared,
            |volume, shared| volume + other.volume() - shared,
        )
    }

    /// Share of this block that lies inside `other`.
    pub fn covered(&self, other: &Self) -> Overlap {
        self.shared_over(other, |area, _| area, |volume, _| volume)
    }

    /// What is shared over a whole made of this block's own area or volume and the shared one.
    fn shared_over(
        &self,
        other: &Self,
        whole_area: impl Fn(f64, f64) -> f64,
        whole_volume: impl Fn(f64, f64) -> f64,
    ) -> Overlap {
        let shared = self.intersection_area(other);
        if shared == 0.0 {
            return Overlap::default();
        }
        let top = larger(self.top_bottom[0], other.top_bottom[0]);
        let bottom = smaller(self.top_bottom[1], other.top_bottom[1]);
        let shared_volume = shared * (bottom - top).max(0.0);
        Overlap {
            bev: share(shared, whole_area(self.area(), shared)),
            volume: share(shared_volume, whole_volume(self.volume(), shared_volume)),
        }
    }

    /// Area that the two footprints share, square metres; 0 when a value is not a number.
    pub fn intersection_area(&self, other: &Self) -> f64 {
        if !self.may_touch(other) {
            return 0.0;
        }
        // The smaller one is clipped, about its own centre: a pebble on a continent keeps its digits.
        let (small, large) = if self.radius < other.radius { (self, other) } else { (other, self) };
        let center = small.center_seen_from(large);
        let mut polygon = small.turned_into(large);
        for axis in [0, 1] {
            for sign in [1.0, -1.0] {
                polygon = polygon.clipped(axis, sign, large.half[axis] - sign * center[axis]);
            }
        }
        let area = polygon.area();
        // The clip exceeds the smaller rectangle by rounding only; a NaN ends here too.
        if area > 0.0 { area.min(self.area()).min(other.area()) } else { 0.0 }
    }

    fn volume(&self) -> f64 {
        self.area() * (self.top_bottom[1] - self.top_bottom[0]).max(0.0)
    }

    /// The footprint's centre along the length and the width of `frame`, from its centre.
    fn center_seen_from(&self, frame: &Self) -> [f64; 2] {
        let (sin, cos) = frame.sin_cos;
        let [dx, dz] = [0, 1].map(|i| self.center[i] - frame.center[i]);
        [cos * dx - sin * dz, sin * dx + cos * dz]
    }

    /// The footprint about its own centre, along the length and the width of `frame`.
    ///
    /// The turn between the boxes is taken from the difference of their yaws, so that parallel boxes come out exactly
    /// parallel.
    fn turned_into(&self, frame: &Self) -> Polygon {
        let (sin, cos) = (self.yaw - frame.yaw).sin_cos();
        let [a, b] = self.half;
        let along = [cos * a, -sin * a];
        let across = [sin * b, cos * b];
        let corner = |s: f64, t: f64| [0, 1].map(|i| s * along[i] + t * across[i]);
        let mut polygon = Polygon::EMPTY;
        polygon.corners[..4].copy_from_slice(&[
            corner(1.0, 1.0),
            corner(1.0, -1.0),
            corner(-1.0, -1.0),
            corner(-1.0, 1.0),
        ]);
        polygon.count = 4;
        polygon
    }
}

/// A convex polygon: a rectangle cut by four lines has eight corners; the rest is room for slivers that rounding makes
/// wavy.
struct Polygon {
    corners: [[f64; 2]; 12],
    count: usize,
}

impl Polygon {
    const EMPTY: Self = Self { corners: [[0.0; 2]; 12], count: 0 };

    fn corners(&self) -> &[[f64; 2]] {
        &self.corners[..self.count]
    }

    /// The part where `sign * p[axis] <= limit` (Sutherland and Hodgman 1974, one line).
    fn clipped(&self, axis: usize, sign: f64, limit: f64) -> Self {
        let mut out = Self::EMPTY;
        let Some(&last) = self.corners().last() else { return out };
        let excess = |p: [f64; 2]| sign * p[axis] - limit;
        let (mut from, mut from_excess) = (last, excess(last));
        for &to in self.corners() {
            let to_excess = excess(to);
            if (from_excess > 0.0) != (to_excess > 0.0) {
                let t = from_excess / (from_excess - to_excess);
                let mut crossing = [0, 1].map(|i| from[i] + t * (to[i] - from[i]));
                crossing[axis] = sign * limit;
                out.push(crossing);
            }
            if to_excess <= 0.0 {
                out.push(to);
            }
            (from, from_excess) = (to, to_excess);
        }
        out
    }

    fn push(&mut self, corner: [f64; 2]) {
        if let Some(slot) = self.corners.get_mut(self.count) {
            *slot = corner;
            self.count += 1;
        }
    }

    /// Area by the shoelace formula about the first corner.
    fn area(&self) -> f64 {
        let Some((&[x0, y0], rest)) = self.corners().split_first() else { return 0.0 };
        let twice: f64 = rest
            .windows(2)
            .map(|pair| (pair[0][0] - x0) * (pair[1][1] - y0) - (pair[1][0] - x0) * (pair[0][1] - y0))
            .sum();
        (twice / 2.0).abs()
    }
}

fn intersection_2d(a: &Box2d, b: &Box2d) -> f64 {
    let width = smaller(a.x2, b.x2) - larger(a.x1, b.x1);
    let height = smaller(a.y2, b.y2) - larger(a.y1, b.y1);
    // Two negative factors would give a positive product.
    if width > 0.0 && height > 0.0 { width * height } else { 0.0 }
}

/// The smaller number; unlike `f64::min`, NaN when either is.
fn smaller(a: f64, b: f64) -> f64 {
    if a < b || a.is_nan() { a } else { b }
}

/// The larger number; unlike `f64::max`, NaN when either is.
fn larger(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}

/// `part / whole`, or 0 where that is no number from 0 to 1.
fn share(part: f64, whole: f64) -> f64 {
    let ratio = part / whole;
    if ratio > 0.0 { ratio.min(1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests;
