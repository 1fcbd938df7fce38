//! From two pictures to flows.

use farsight_core::Box2d;

use crate::corners::{Corner, corners};
use crate::flow::{Map, REACH, ROAD_REACH, find};
use crate::grey::{Grey, LEVELS};
use crate::mixture::{Flow, STANDING, is_low};
use crate::motion::{Pinhole, Warp};

/// At most so many patches of the road's region and of the rest are looked for.
const MOST: [usize; 2] = [160, 120];

/// Boxes of what moves are widened by this share of their size to each side, and downwards, where shadows are, by this
/// one; and by so many pixels.
const ASIDE: f64 = 0.05;
const SHADOW: f64 = 0.15;
const MARGIN_PX: f64 = 2.0;

/// What is kept of a picture.
pub(crate) struct Seen {
    pub(crate) pyramid: Vec<Grey>,
    pub(crate) pinhole: Pinhole,
    /// What may move, in small pixels, widened.
    boxes: Vec<Box2d>,
}

impl Seen {
    pub(crate) fn new(pyramid: Vec<Grey>, pinhole: Pinhole, objects: &[Box2d], factor: usize) -> Self {
        let scaled = |v: f64| (v + 0.5) / factor as f64 - 0.5;
        let widened = |one: &Box2d| {
            let (aside, below) = (ASIDE * one.width(), SHADOW * one.height());
            Box2d::new(
                scaled(one.x1 - aside) - MARGIN_PX,
                scaled(one.y1) - MARGIN_PX,
                scaled(one.x2 + aside) + MARGIN_PX,
                scaled(one.y2 + below) + MARGIN_PX,
            )
        };
        Self { pyramid, pinhole, boxes: objects.iter().map(widened).collect() }
    }

    fn may_move(&self, [x, y]: [f32; 2]) -> bool {
        let (x, y) = (f64::from(x), f64::from(y));
        self.boxes.iter().any(|one| x > one.x1 && x < one.x2 && y > one.y1 && y < one.y2)
    }

    /// Places to look for, those in the road's region apart from the rest, the best ones first.
    pub(crate) fn corners(&self, warp: &Warp) -> Vec<(Corner, bool)> {
        let all = corners(&self.pyramid[0], |place| !self.may_move(place));
        let mut groups = [Vec::new(), Vec::new()];
        for corner in all {
            let Some(ray) = self.pinhole.ray(corner.place.map(f64::from)) else { continue };
            let low = is_low(&ray, warp.road(&ray));
            groups[usize::from(!low)].push((corner, low));
        }
        for (group, most) in groups.iter_mut().zip(MOST) {
            group.sort_by(|(a, _), (b, _)| b.score.total_cmp(&a.score));
            group.truncate(most);
        }
        groups.concat()
    }

    /// Where `corners` of this picture are in the next one, by the motion that is expected; `knows` it well or not.
    pub(crate) fn flows(&self, next: &Self, corners: &[(Corner, bool)], warp: &Warp, knows: bool) -> Vec<Flow> {
        let coarsest = if knows { 1 } else { LEVELS - 1 };
        let flow = |&(corner, low): &(Corner, bool)| {
            let ray = self.pinhole.ray(corner.place.map(f64::from))?;
            let expected = self.expected(corner.place, low, warp)?;
            let map = self.map(corner.place, low, warp)?;
            let reach = if low { ROAD_REACH } else { REACH };
            let found = find([&self.pyramid, &next.pyramid], corner.place, expected, &map, [coarsest, reach])?;
            let (to, covariance) = (found.place.map(f64::from), found.covariance.map(f64::from));
            (!next.may_move(found.place)).then_some(Flow { ray, to, covariance, is_low: low })
        };
        corners.iter().filter_map(flow).collect()
    }

    fn expected(&self, place: [f32; 2], low: bool, warp: &Warp) -> Option<[f32; 2]> {
        let ray = self.pinhole.ray(place.map(f64::from))?;
        let rho = if low { warp.road(&ray) } else { STANDING[0] + warp.road(&ray).max(0.0) };
        Some(warp.pixel(&ray, rho)?.0.map(|v| v as f32))
    }

    /// How a patch there is turned and stretched on its way.
    fn map(&self, place: [f32; 2], low: bool, warp: &Warp) -> Option<Map> {
        const STEP_PX: f32 = 2.0;
        if !low {
            return Some([[1.0, 0.0], [0.0, 1.0]]);
        }
        let at = |x: f32, y: f32| self.expected([place[0] + x, place[1] + y], low, warp);
        let (left, right, up, down) = (at(-STEP_PX, 0.0)?, at(STEP_PX, 0.0)?, at(0.0, -STEP_PX)?, at(0.0, STEP_PX)?);
        Some(
            [0, 1]
                .map(|axis| [(right[axis] - left[axis]) / (2.0 * STEP_PX), (down[axis] - up[axis]) / (2.0 * STEP_PX)]),
        )
    }
}
