//! Lines along which roads run.

use crate::rng::SceneRng;

/// Distance between nodes, metres.
const STEP_M: f64 = 2.0;

/// A point of a path: where, and in which direction it goes on (both x and z).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Node {
    pub(crate) point: [f64; 2],
    pub(crate) direction: [f64; 2],
}

impl Node {
    /// The point `offset` metres to the right.
    pub(crate) fn beside(&self, offset: f64) -> [f64; 2] {
        [self.point[0] + self.direction[1] * offset, self.point[1] - self.direction[0] * offset]
    }

    /// The yaw of something that moves along the path.
    pub(crate) fn yaw(&self) -> f64 {
        libm::atan2(-self.direction[1], self.direction[0])
    }
}

/// A smooth line over the ground. Places on it are given by the distance along it, `s`, and to its right, `d`.
#[derive(Debug, Clone)]
pub(crate) struct Path {
    /// `s` of the first node.
    start: f64,
    nodes: Vec<Node>,
}

impl Path {
    /// A path through `point` at `s = 0` in the direction of `yaw`, whose curvature (1/m, positive to the right)
    /// follows `curvature`.
    pub(crate) fn new(point: [f64; 2], yaw: f64, [start, end]: [f64; 2], curvature: impl Fn(f64) -> f64) -> Self {
        let ahead = walk(point, yaw, end, STEP_M, &curvature);
        let mut nodes = walk(point, yaw, -start, -STEP_M, &curvature);
        let start = -STEP_M * (nodes.len() - 1) as f64;
        nodes.reverse();
        nodes.extend(ahead.into_iter().skip(1));
        Self { start, nodes }
    }

    /// A path through points, which must be at least two, in their order.
    pub(crate) fn through(points: &[[f64; 2]]) -> Self {
        let lengths = points.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]));
        let ends: Vec<f64> = lengths
            .scan(0.0, |sum, length| {
                *sum += length;
                Some(*sum)
            })
            .collect();
        let all = ends.last().copied().unwrap_or(0.0);
        let at = |s: f64| {
            let k = ends.partition_point(|end| *end < s).min(ends.len() - 1);
            let from = if k == 0 { 0.0 } else { ends[k - 1] };
            let share = ((s - from) / (ends[k] - from).max(1e-9)).clamp(0.0, 1.0);
            [0, 1].map(|axis| points[k][axis] + share * (points[k + 1][axis] - points[k][axis]))
        };
        let count = ((all / STEP_M) as usize).max(1);
        let nodes = (0..=count).map(|k| {
            let s = STEP_M * k as f64;
            let [before, after] = [at((s - STEP_M / 2.0).max(0.0)), at((s + STEP_M / 2.0).min(all))];
            let [dx, dz] = [after[0] - before[0], after[1] - before[1]];
            let norm = (dx * dx + dz * dz).sqrt().max(1e-9);
            Node { point: at(s), direction: [dx / norm, dz / norm] }
        });
        Self { start: 0.0, nodes: nodes.collect() }
    }

    /// Straight, gently bent, or in a bend that starts somewhere.
    pub(crate) fn sample(point: [f64; 2], yaw: f64, range: [f64; 2], tightest_m: f64, rng: &mut SceneRng) -> Self {
        let sign = if rng.chance(0.5) { 1.0 } else { -1.0 };
        let radius = rng.log_range(tightest_m, 20.0 * tightest_m);
        let (from, length) = (rng.range(-20.0, 60.0), rng.range(20.0, 120.0));
        match rng.weighted(&[(0, 0.5), (1, 0.25), (2, 0.25)]) {
            0 => Self::new(point, yaw, range, |_| 0.0),
            1 => Self::new(point, yaw, range, |_| sign / (4.0 * radius)),
            _ => Self::new(point, yaw, range, |s| if s > from && s < from + length { sign / radius } else { 0.0 }),
        }
    }

    /// The same line, its places counted from `before` metres before where they were.
    pub(crate) fn renumbered(mut self, before: f64) -> Self {
        self.start += before;
        self
    }

    pub(crate) fn range(&self) -> [f64; 2] {
        [self.start, self.start + STEP_M * (self.nodes.len() - 1) as f64]
    }

    /// The nodes with their `s`.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = (f64, &Node)> {
        self.nodes.iter().enumerate().map(|(i, node)| (self.start + STEP_M * i as f64, node))
    }

    /// The path at `s`; it ends where it ends.
    pub(crate) fn at(&self, s: f64) -> Node {
        let steps = ((s - self.start) / STEP_M).clamp(0.0, (self.nodes.len() - 1) as f64);
        let index = (steps as usize).min(self.nodes.len() - 2);
        let (a, b, t) = (self.nodes[index], self.nodes[index + 1], steps - index as f64);
        let mix = |a: [f64; 2], b: [f64; 2]| [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t];
        let direction = mix(a.direction, b.direction);
        let norm = (direction[0] * direction[0] + direction[1] * direction[1]).sqrt();
        Node { point: mix(a.point, b.point), direction: direction.map(|v| v / norm) }
    }

    /// `s` and `d` of the place on the path that is nearest to a point.
    pub(crate) fn nearest(&self, [x, z]: [f64; 2]) -> [f64; 2] {
        let mut best = ([0.0, 0.0], f64::INFINITY);
        for (s, node) in self.nodes() {
            let [dx, dz] = [x - node.point[0], z - node.point[1]];
            let distance = dx * dx + dz * dz;
            if distance < best.1 {
                let [tx, tz] = node.direction;
                best = ([s + dx * tx + dz * tz, dx * tz - dz * tx], distance);
            }
        }
        best.0
    }
}

fn walk(point: [f64; 2], yaw: f64, reach: f64, step: f64, curvature: &impl Fn(f64) -> f64) -> Vec<Node> {
    let mut heading = yaw;
    let mut point = point;
    let mut nodes = Vec::new();
    let count = (reach / step.abs()).ceil().max(1.0) as usize;
    for i in 0..=count {
        let direction = [libm::cos(heading), -libm::sin(heading)];
        nodes.push(Node { point, direction });
        // Half the turn before the step and half after it.
        let turn = curvature(i as f64 * step + step / 2.0) * step;
        let middle = heading + turn / 2.0;
        point = [point[0] + libm::cos(middle) * step, point[1] - libm::sin(middle) * step];
        heading += turn;
    }
    nodes
}
