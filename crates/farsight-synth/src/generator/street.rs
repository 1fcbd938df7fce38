//! A road with its lanes, kerbs, pavements and markings.

use super::builder::{SceneBuilder, layer};
use super::path::Path;
use crate::rng::SceneRng;
use crate::scene::MaterialId;

/// What a lane is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LaneUse {
    Drive,
    /// Cars stand along the kerb.
    ParkAlong,
    /// Cars stand across.
    ParkAcross,
    Cycle,
}

/// A strip of the carriageway.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lane {
    /// Offset of its middle from the path, metres to the right.
    pub(crate) center: f64,
    pub(crate) width: f64,
    /// 1 along the path, -1 against it.
    pub(crate) direction: f64,
    pub(crate) used_for: LaneUse,
}

/// What borders a carriageway on one side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Border {
    /// Strip of grass between road and pavement, metres.
    pub(crate) verge: f64,
    /// 0 where there is none.
    pub(crate) pavement: f64,
    /// Height of the kerb, metres.
    pub(crate) kerb: f64,
}

/// The surfaces of a scene's roads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Surfaces {
    pub(crate) road: MaterialId,
    pub(crate) patch: MaterialId,
    pub(crate) bay: MaterialId,
    pub(crate) pavement: MaterialId,
    pub(crate) kerb: MaterialId,
    pub(crate) grass: MaterialId,
    pub(crate) paint: MaterialId,
    /// The line between the directions.
    pub(crate) middle: MaterialId,
}

/// How lanes are separated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Markings {
    /// Length of a dash and of the gap behind it, metres.
    pub(crate) dash: [f64; 2],
    pub(crate) width: f64,
    /// Between the directions: 0 nothing, 1 dashes, 2 solid, 3 double.
    pub(crate) middle: u8,
    /// Lines along the edges.
    pub(crate) edges: bool,
    /// Lines between lanes of one direction.
    pub(crate) lanes: bool,
    /// Lines along the island between the directions.
    pub(crate) island: bool,
    /// Asphalt beyond the lines at the edges, metres.
    pub(crate) shoulder: f64,
    /// Before a junction: 0 nothing, 1 a line to stop at, 2 stripes to cross on.
    pub(crate) stop: u8,
}

/// A road.
#[derive(Debug, Clone)]
pub(crate) struct Street {
    pub(crate) path: Path,
    pub(crate) lanes: Vec<Lane>,
    /// Left and right edge of the carriageway, offsets from the path.
    pub(crate) edges: [f64; 2],
    /// Left and right.
    pub(crate) borders: [Border; 2],
    pub(crate) markings: Markings,
    /// Ranges of `s` where another road joins: neither kerbs nor markings.
    pub(crate) openings: Vec<[f64; 2]>,
}

impl Street {
    pub(crate) fn is_open(&self, s: f64) -> bool {
        self.openings.iter().any(|[from, to]| (*from..*to).contains(&s))
    }

    /// Where private ground begins on a side (0 left, 1 right): distance from the path.
    pub(crate) fn outer(&self, side: usize) -> f64 {
        let border = self.borders[side];
        self.edges[side].abs() + border.verge + border.pavement
    }

    /// Whether a point lies on the road or its pavements, or nearer to them than `margin`.
    pub(crate) fn covers(&self, point: [f64; 2], margin: f64) -> bool {
        let [s, d] = self.path.nearest(point);
        let [start, end] = self.path.range();
        let side = usize::from(d > 0.0);
        (start..end).contains(&s) && d.abs() < self.outer(side) + margin
    }

    /// Everything on the ground.
    pub(crate) fn build(&self, builder: &mut SceneBuilder, surfaces: &Surfaces, rng: &mut SceneRng) {
        let all = self.path.range();
        self.ribbon(builder, all, [(self.edges[0], 0.0), (self.edges[1], 0.0)], surfaces.road, layer::ROAD);
        for lane in &self.lanes {
            if matches!(lane.used_for, LaneUse::ParkAlong | LaneUse::ParkAcross) {
                self.bays(builder, lane, surfaces);
            }
        }
        for pair in self.lanes.windows(2) {
            let [left, right] = [pair[0].center + pair[0].width / 2.0, pair[1].center - pair[1].width / 2.0];
            if right - left > 0.5 {
                self.ribbon(builder, all, [(left + 0.4, 0.0), (right - 0.4, 0.0)], surfaces.grass, layer::PATCH);
            }
        }
        for side in 0..2 {
            self.border(builder, side, surfaces);
        }
        self.lines(builder, surfaces);
        self.stops(builder, surfaces.paint);
        if self.markings.lanes && self.markings.dash[0] < 3.5 {
            self.arrows(builder, surfaces.paint);
        }
        self.patches(builder, surfaces.patch, rng);
    }

    /// Lines and crossings before junctions.
    fn stops(&self, builder: &mut SceneBuilder, paint: MaterialId) {
        for &[open, close] in &self.openings {
            for (s, direction) in [(open, 1.0), (close, -1.0)] {
                let lanes = self.lanes.iter().filter(|lane| lane.used_for == LaneUse::Drive);
                match self.markings.stop {
                    0 => {}
                    1 => {
                        for lane in lanes.filter(|lane| lane.direction * direction > 0.0) {
                            let half = lane.width / 2.0 - 0.1;
                            let sides = [(lane.center - half, 0.0), (lane.center + half, 0.0)];
                            let from = if direction > 0.0 { s - 0.9 } else { s + 0.5 };
                            self.ribbon(builder, [from, from + 0.4], sides, paint, layer::MARKING);
                        }
                    }
                    _ => {
                        let from = if direction > 0.0 { s - 3.5 } else { s + 0.5 };
                        self.zebra(builder, [from, from + 3.0], paint);
                    }
                }
            }
        }
    }

    fn zebra(&self, builder: &mut SceneBuilder, range: [f64; 2], paint: MaterialId) {
        let mut d = self.edges[0] + 0.4;
        while d < self.edges[1] - 0.5 {
            self.ribbon(builder, range, [(d, 0.0), (d + 0.5, 0.0)], paint, layer::MARKING);
            d += 1.0;
        }
    }

    /// Arrows before the first junction.
    fn arrows(&self, builder: &mut SceneBuilder, paint: MaterialId) {
        let Some(&[open, _]) = self.openings.first() else { return };
        for lane in self.lanes.iter().filter(|lane| lane.used_for == LaneUse::Drive && lane.direction > 0.0) {
            let tip = open - 6.0;
            let center = lane.center;
            self.ribbon(
                builder,
                [tip - 4.0, tip - 1.4],
                [(center - 0.08, 0.0), (center + 0.08, 0.0)],
                paint,
                layer::MARKING,
            );
            let lift = f64::from(layer::MARKING) * 0.004;
            let corners = [(tip - 1.4, -0.4), (tip - 1.4, 0.4), (tip, 0.0)];
            let points = corners.map(|(s, d)| builder.over(self.path.at(s).beside(center + d), lift));
            builder.flat.triangle(points, [[0.0, 0.0], [0.8, 0.0], [0.4, 1.4]], paint, layer::MARKING);
        }
    }

    fn border(&self, builder: &mut SceneBuilder, side: usize, surfaces: &Surfaces) {
        let border = self.borders[side];
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let edge = self.edges[side];
        let kerb = border.kerb;
        let stone = 0.14;
        let mut rows = vec![((edge, 0.0), (edge + sign * 0.01, kerb), surfaces.kerb)];
        rows.push(((edge + sign * 0.01, kerb), (edge + sign * stone, kerb), surfaces.kerb));
        let mut from = edge + sign * stone;
        for (width, material) in [(border.verge, surfaces.grass), (border.pavement, surfaces.pavement)] {
            if width > 0.0 {
                rows.push(((from, kerb), (from + sign * width, kerb), material));
                from += sign * width;
            }
        }
        // Down to the field.
        rows.push(((from, kerb), (from + sign * 0.5, -0.05), surfaces.grass));
        for [from, to] in self.closed_ranges() {
            for (a, b, material) in &rows {
                self.ribbon(builder, [from, to], [*a, *b], *material, layer::ROAD);
            }
        }
    }

    /// The ranges of `s` between the openings.
    fn closed_ranges(&self) -> Vec<[f64; 2]> {
        let [start, end] = self.path.range();
        let mut ranges = Vec::new();
        let mut from = start;
        for &[open, close] in &self.openings {
            ranges.push([from, open.max(from)]);
            from = close;
        }
        ranges.push([from, end]);
        ranges.retain(|[a, b]| b > a);
        ranges
    }

    fn bays(&self, builder: &mut SceneBuilder, lane: &Lane, surfaces: &Surfaces) {
        let half = lane.width / 2.0;
        let pitch = if lane.used_for == LaneUse::ParkAlong { 5.8 } else { 2.6 };
        for [from, to] in self.closed_ranges() {
            let sides = [(lane.center - half, 0.0), (lane.center + half, 0.0)];
            self.ribbon(builder, [from, to], sides, surfaces.bay, layer::PATCH);
            if !self.markings.edges {
                continue;
            }
            let count = ((to - from) / pitch) as usize;
            for k in 0..=count {
                let s = from + pitch * k as f64;
                let line = [(lane.center - half, 0.0), (lane.center + half, 0.0)];
                self.ribbon(builder, [s - 0.06, s + 0.06], line, surfaces.paint, layer::MARKING);
            }
        }
    }

    /// Lines between lanes and along the edges.
    fn lines(&self, builder: &mut SceneBuilder, &Surfaces { paint, middle, .. }: &Surfaces) {
        let marks = &self.markings;
        for pair in self.lanes.windows(2) {
            let at = pair[0].center + pair[0].width / 2.0;
            let both_drive = pair.iter().all(|lane| lane.used_for == LaneUse::Drive);
            let opposed = pair[0].direction * pair[1].direction < 0.0;
            match (both_drive, opposed) {
                (true, true) => match marks.middle {
                    0 => {}
                    _ if marks.island && pair[1].center - pair[1].width / 2.0 - at > 0.5 => {
                        self.line(builder, at - 0.2, middle);
                        self.line(builder, pair[1].center - pair[1].width / 2.0 + 0.2, middle);
                    }
                    1 => self.dashes(builder, at, middle),
                    2 => self.line(builder, at, middle),
                    _ => {
                        self.line(builder, at - marks.width, middle);
                        self.line(builder, at + marks.width, middle);
                    }
                },
                (true, false) if marks.lanes => self.dashes(builder, at, paint),
                (false, _) if marks.edges => self.dashes(builder, at, paint),
                _ => {}
            }
        }
        if marks.edges {
            self.line(builder, self.edges[0] + marks.shoulder + 0.25, paint);
            self.line(builder, self.edges[1] - marks.shoulder - 0.25, paint);
        }
    }

    fn line(&self, builder: &mut SceneBuilder, d: f64, paint: MaterialId) {
        let half = self.markings.width / 2.0;
        for range in self.closed_ranges() {
            self.ribbon(builder, range, [(d - half, 0.0), (d + half, 0.0)], paint, layer::MARKING);
        }
    }

    fn dashes(&self, builder: &mut SceneBuilder, d: f64, paint: MaterialId) {
        let half = self.markings.width / 2.0;
        let [dash, gap] = self.markings.dash;
        for [from, to] in self.closed_ranges() {
            let mut s = from;
            while s < to.min(110.0 + builder.view.travel_m) {
                let sides = [(d - half, 0.0), (d + half, 0.0)];
                self.ribbon(builder, [s, (s + dash).min(to)], sides, paint, layer::MARKING);
                s += dash + gap;
            }
        }
    }

    /// Tar, repairs and manhole covers.
    fn patches(&self, builder: &mut SceneBuilder, material: MaterialId, rng: &mut SceneRng) {
        for _ in 0..rng.whole(0, 10) {
            let s = rng.range(2.0, 60.0 + builder.view.travel_m);
            let d = rng.range(self.edges[0], self.edges[1]);
            let (long, wide) = (rng.log_range(0.3, 12.0), rng.log_range(0.08, 1.2));
            let [left, right] = [(d - wide / 2.0).max(self.edges[0]), (d + wide / 2.0).min(self.edges[1])];
            self.ribbon(builder, [s, s + long], [(left, 0.0), (right, 0.0)], material, layer::PATCH);
        }
    }

    /// A strip along the path between two offsets (with heights over the ground).
    pub(crate) fn ribbon(
        &self,
        builder: &mut SceneBuilder,
        [from, to]: [f64; 2],
        [left, right]: [(f64, f64); 2],
        material: MaterialId,
        layer: u8,
    ) {
        let [start, end] = self.path.range();
        let (from, to) = (from.max(start), to.min(end));
        let mut s = from;
        while s < to - 1e-6 {
            // The same cuts for all strips, so that neighbours meet.
            let step = if s.abs() < 60.0 + builder.view.travel_m { 2.0 } else { 6.0 };
            let next = ((s / step + 1e-6).floor() * step + step).min(to);
            let (a, b) = (self.path.at(s), self.path.at(next));
            let middle = [f64::midpoint(a.point[0], b.point[0]), f64::midpoint(a.point[1], b.point[1])];
            if builder.view.sees(middle, 4.0 + left.0.abs().max(right.0.abs())) {
                let corner = |node: &super::path::Node, (d, lift): (f64, f64)| {
                    let lift = lift + f64::from(layer) * 0.004;
                    builder.over(node.beside(d), lift)
                };
                let points = [corner(&a, left), corner(&b, left), corner(&b, right), corner(&a, right)];
                let uv = |s: f64, (d, lift): (f64, f64)| [s as f32, (d + lift) as f32];
                let uvs = [uv(s, left), uv(next, left), uv(next, right), uv(s, right)];
                builder.flat.quad_uv(points, uvs, material, layer);
            }
            s = next;
        }
    }
}
