//! What the sides of roads have in some regions: wires, palms, billboards, bridges of signs, road works.

use super::config::Place;
use super::path::Node;
use super::surroundings::Surroundings;
use crate::mesh_builder::MeshBuilder;
use crate::palette::{any_color, grey, matte};
use crate::region::Region;
use crate::rng::SceneRng;
use crate::scene::{Material, MaterialId, Mesh, Pattern, Vec3};

/// Nothing of this is built farther along the road, metres.
const FAR_M: f64 = 130.0;

/// Wires hang through by this share of the distance between their poles.
const SAG: f64 = 0.025;

impl Surroundings<'_> {
    /// Draws all of it that a region has.
    pub(super) fn furnish(&mut self, region: &Region) {
        let sides = region.sides;
        let place = self.plan.place;
        let is_motorway = place == Place::Motorway;
        if !is_motorway && self.rng.chance(sides.wires) {
            let side = self.rng.whole(0, 1);
            self.wires(side);
        }
        for side in 0..2 {
            if self.rng.chance(sides.palms) {
                self.palms(side);
            }
            if self.rng.chance(sides.billboards) {
                self.billboards(side);
            }
        }
        if self.rng.chance(if is_motorway { sides.gantries } else { 0.15 * sides.gantries }) {
            self.gantry();
        }
        if self.rng.chance(region.roads.works) {
            self.works();
        }
    }

    /// A place beside the carriageway, `out` metres from its edge.
    fn beside(&self, s: f64, side: usize, out: f64) -> (Node, [f64; 2]) {
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let node = self.plan.main.path.at(s);
        (node, node.beside(self.plan.main.edges[side] + sign * out))
    }

    /// Whether something of this radius may stand here and be seen.
    fn may_stand(&self, point: [f64; 2], radius: f64, height: f64) -> bool {
        !self.blocked(point, radius)
            && !self.builder.hides(point, radius + 0.3)
            && self.builder.view.sees(point, height)
    }

    /// Poles of wood or concrete, with wires between them and over to the houses.
    fn wires(&mut self, side: usize) {
        let (height, pitch) = (self.rng.range(7.0, 11.0), self.rng.range(24.0, 42.0));
        let pole = if self.rng.chance(0.5) { self.materials.wood } else { self.materials.stone };
        let wire = self.builder.palette.matte(grey(0.012));
        let arms: Vec<[f64; 2]> = (0..self.rng.whole(3, 8))
            .map(|_| [self.rng.symmetric(1.0), height - self.rng.log_range(0.15, 3.0)])
            .collect();
        let out = self.rng.range(0.4, 1.0);
        let mut before: Option<[f64; 2]> = None;
        let mut s = self.rng.range(-10.0, 5.0);
        while s < FAR_M + self.builder.view.travel_m {
            let (node, point) = self.beside(s, side, out);
            if let Some(from) = before {
                for &[across, up] in &arms {
                    self.wire([from, point], across, up, wire);
                }
            }
            if self.may_stand(point, 0.25, height) {
                let mut shape = MeshBuilder::default();
                shape.tube([0.0, 0.2, 0.0], [0.0, -height as f32, 0.0], [0.15, 0.1], 7, pole);
                for up in [height - 0.3, height - 1.2] {
                    let up = -up as f32;
                    shape.cuboid([-0.06, up - 0.06, -1.1], [0.06, up + 0.06, 1.1], pole);
                }
                if self.rng.chance(0.3) {
                    let up = -(height as f32) + 2.0;
                    shape.tube([0.3, up, 0.0], [0.3, up + 0.9, 0.0], [0.28; 2], 8, self.materials.metal);
                }
                let at = self.builder.over(point, 0.0);
                self.builder.solid.place(&shape.mesh, node.yaw(), at);
            }
            if self.rng.chance(0.4) {
                // To a house, or to the other side.
                let (along, out) = (s + self.rng.symmetric(8.0), self.rng.range(1.0, 6.0));
                let (_, across) = self.beside(along, 1 - side, out);
                self.wire([point, across], 0.0, height - 0.8, wire);
            }
            before = Some(point);
            s += pitch;
        }
    }

    /// One wire between two poles, `across` metres beside them, hanging from the height `up`.
    fn wire(&mut self, [from, to]: [[f64; 2]; 2], across: f64, up: f64, material: MaterialId) {
        const PIECES: usize = 6;
        let [dx, dz] = [to[0] - from[0], to[1] - from[1]];
        let span = (dx * dx + dz * dz).sqrt().max(1.0);
        let middle = [f64::midpoint(from[0], to[0]), f64::midpoint(from[1], to[1])];
        if !self.builder.view.sees(middle, span) {
            return;
        }
        let at = |k: usize| -> [f64; 3] {
            let t = k as f64 / PIECES as f64;
            let point = [from[0] + t * dx + across * dz / span, from[1] + t * dz - across * dx / span];
            [point[0], point[1], up - 4.0 * SAG * span * t * (1.0 - t)]
        };
        for k in 0..PIECES {
            let [a, b] = [at(k), at(k + 1)].map(|[x, z, up]| self.builder.over([x, z], up));
            self.builder.solid.tube(a, b, [0.014; 2], 3, material);
        }
    }

    fn palms(&mut self, side: usize) {
        let height = self.rng.log_range(4.5, 16.0);
        let (pitch, out) = (self.rng.range(7.0, 18.0), self.rng.range(0.8, 3.0));
        let mut s = self.rng.range(0.0, pitch);
        while s < FAR_M + self.builder.view.travel_m {
            let (_, point) = self.beside(s, side, out);
            let mut rng = self.rng.fork();
            if point[0] * point[0] + point[1] * point[1] > 16.0 && self.may_stand(point, 0.3, height) {
                let leaves = rng.pick(&self.materials.far_leaves)[0];
                let tall = height * rng.range(0.8, 1.2);
                let mesh = palm(tall as f32, self.materials.bark, leaves, &mut rng);
                let at = self.builder.over(point, 0.0);
                self.builder.solid.place(&mesh, rng.range(0.0, std::f64::consts::TAU), at);
            }
            s += pitch * self.rng.range(0.9, 1.1);
        }
    }

    fn billboards(&mut self, side: usize) {
        for _ in 0..self.rng.whole(1, 4) {
            let mut rng = self.rng.fork();
            let s = rng.range(10.0, 110.0 + self.builder.view.travel_m);
            let sign = if side == 0 { -1.0 } else { 1.0 };
            let node = self.plan.main.path.at(s);
            let point = node.beside(sign * (self.plan.main.outer(side) + rng.range(1.5, 9.0)));
            let (wide, tall) = (rng.range32(2.5, 11.0), rng.range32(1.5, 4.5));
            let foot = rng.range32(2.2, 8.0);
            if !self.may_stand(point, f64::from(wide) / 2.0, f64::from(foot + tall)) {
                continue;
            }
            let face = poster(self, &mut rng);
            let mut shape = MeshBuilder::default();
            let half = wide / 2.0;
            for z in [-0.6 * half, 0.6 * half] {
                shape.tube([0.0, 0.2, z], [0.0, -foot - 0.3, z], [0.14; 2], 7, self.materials.metal);
            }
            let metal = self.materials.metal;
            let faces = [Some(face), Some(face), Some(metal), Some(metal), Some(metal), Some(metal)];
            shape.block_of([-0.15, -foot - tall, -half], [0.15, -foot, half], faces);
            let at = self.builder.over(point, 0.0);
            self.builder.solid.place(&shape.mesh, node.yaw() + rng.symmetric(0.4), at);
        }
    }

    /// Signs on a bridge over the road.
    fn gantry(&mut self) {
        let s = self.rng.range(30.0, 100.0);
        let node = self.plan.main.path.at(s);
        if self.builder.hides(node.point, 8.0) || !self.builder.view.sees(node.point, 20.0) {
            return;
        }
        let [left, right] = self.plan.main.edges;
        let metal = self.materials.metal;
        let mut shape = MeshBuilder::default();
        let deck = 6.6;
        // Local z points to the left of the path.
        let ends = [-right as f32 - 1.2, -left as f32 + 1.2];
        for z in ends {
            shape.tube([0.0, 0.3, z], [0.0, -deck - 0.4, z], [0.2; 2], 8, metal);
        }
        for up in [deck, deck + 1.2] {
            shape.cuboid([-0.1, -up - 0.12, ends[0]], [0.1, -up, ends[1]], metal);
        }
        let mut z = ends[0] + 1.0;
        while z < ends[1] - 3.0 {
            let wide = self.rng.range32(2.5, 6.0).min(ends[1] - z - 0.5);
            if self.rng.chance(0.7) {
                let color = self.rng.pick(&[[0.01, 0.16, 0.08], [0.01, 0.09, 0.34], [0.01, 0.16, 0.08]]);
                let pattern = Pattern::Windows {
                    other: grey(0.7),
                    pitch: [0.3, 0.75],
                    fill: [0.55, 0.4],
                    lit: 0.0,
                    seed: self.rng.seed(),
                };
                let face = self.builder.palette.add(Material { pattern, ..matte(color) });
                let tall = self.rng.range32(1.6, 3.4);
                let faces = [Some(face), Some(metal), Some(metal), Some(metal), Some(metal), Some(metal)];
                shape.block_of([-0.25, -deck + 0.3 - tall, z], [-0.15, -deck + 0.3, z + wide], faces);
            }
            z += wide + self.rng.range32(0.3, 3.0);
        }
        let at = self.builder.over(node.point, 0.0);
        self.builder.solid.place(&shape.mesh, node.yaw(), at);
    }

    /// A lane closed by cones, barrels or barriers, and a sign.
    fn works(&mut self) {
        let side = self.rng.whole(0, 1);
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let from = self.rng.range(8.0, 50.0);
        let (length, pitch) = (self.rng.range(10.0, 50.0), self.rng.range(2.0, 6.0));
        let most_in = self.rng.range(0.2, 2.8);
        let [orange, white, black] = [[0.75, 0.16, 0.02], grey(0.75), grey(0.02)];
        let [orange, white, black] = [orange, white, black].map(|color| self.builder.palette.matte(color));
        let striped = self.builder.palette.add(Material {
            pattern: Pattern::Stripes { other: [0.6, 0.03, 0.02], period: 0.5, share: 0.5 },
            ..matte(grey(0.75))
        });
        let kind = self.rng.weighted(&[(0, 3.0), (1, 2.0), (2, 2.0)]);
        let mut s = from;
        while s < from + length {
            // The row leads into the lane and stays there.
            let inside = most_in * ((s - from) / 12.0).min(1.0);
            let node = self.plan.main.path.at(s);
            let point = node.beside(self.plan.main.edges[side] - sign * inside);
            if self.has_room(point, 0.4) && !self.builder.hides(point, 0.4) && self.builder.view.sees(point, 2.0) {
                let mesh = match kind {
                    0 => cone([orange, white, black]),
                    1 => barrel([orange, white, black]),
                    _ => barrier([striped, black]),
                };
                let at = self.builder.over(point, 0.0);
                self.builder.solid.place(&mesh, node.yaw() + self.rng.normal(0.0, 0.1), at);
            }
            s += pitch;
        }
    }
}

/// A picture with words, or words alone.
fn poster(surroundings: &mut Surroundings, rng: &mut SceneRng) -> MaterialId {
    let (ground, ink) = (any_color(rng), any_color(rng));
    let size = rng.range32(0.4, 1.4);
    let words = Pattern::Windows {
        other: ink,
        pitch: [0.6 * size, size],
        fill: [rng.range32(0.5, 0.8), rng.range32(0.3, 0.7)],
        lit: 0.0,
        seed: rng.seed(),
    };
    let blotches = Pattern::Noise { other: ink, scale: rng.range32(0.5, 3.0), amount: 1.0, seed: rng.seed() };
    let pattern = if rng.chance(0.6) { words } else { blotches };
    surroundings.builder.palette.add(Material { pattern, ..matte(ground) })
}

/// A bare trunk and a tuft of fronds that hang over.
fn palm(height: f32, bark: MaterialId, leaves: MaterialId, rng: &mut SceneRng) -> Mesh {
    let mut shape = MeshBuilder::default();
    let radius = rng.range32(0.13, 0.24);
    let bent = [rng.range32(-0.04, 0.04) * height, -height, rng.range32(-0.04, 0.04) * height];
    shape.tube([0.0, 0.2, 0.0], bent, [radius, 0.7 * radius], 7, bark);
    let count = rng.whole(9, 14);
    let reach = rng.range32(1.6, 2.8);
    for k in 0..count {
        let (sin, cos) =
            crate::mesh_builder::sin_cos(std::f32::consts::TAU * (k as f32 + rng.range32(0.0, 0.6)) / count as f32);
        let lift = rng.range32(-0.2, 0.9);
        // Three pieces, each hanging more than the one before.
        let spine: Vec<Vec3> = [(0.0, 0.0), (0.4, 0.45 * lift + 0.1), (0.8, 0.3 * lift - 0.15), (1.0, -0.75)]
            .map(|(out, up)| [bent[0] + cos * out * reach, bent[1] - up * reach * 0.8, bent[2] + sin * out * reach])
            .into();
        for (piece, pair) in spine.windows(2).enumerate() {
            let half = [0.12, 0.3, 0.24, 0.06].map(|half: f32| half * reach * 0.55);
            let corner = |end: usize, side: f32| {
                let [x, y, z] = pair[end];
                let half = side * half[piece + end];
                [x - sin * half, y + half.abs() * 0.6, z + cos * half]
            };
            for side in [-1.0, 1.0] {
                shape.quad([pair[0], pair[1], corner(1, side), corner(0, side)], leaves, 0);
            }
        }
    }
    shape.mesh
}

fn cone([orange, white, black]: [MaterialId; 3]) -> Mesh {
    let mut shape = MeshBuilder::default();
    shape.cuboid([-0.19, -0.04, -0.19], [0.19, 0.02, 0.19], black);
    for (low, high, material) in [(0.04, 0.3, orange), (0.3, 0.48, white), (0.48, 0.72, orange)] {
        let radius = |up: f32| 0.15 * (1.0 - up / 0.85);
        shape.tube([0.0, -low, 0.0], [0.0, -high, 0.0], [radius(low), radius(high)], 9, material);
    }
    shape.mesh
}

fn barrel([orange, white, black]: [MaterialId; 3]) -> Mesh {
    let mut shape = MeshBuilder::default();
    shape.cuboid([-0.32, -0.06, -0.32], [0.32, 0.02, 0.32], black);
    for k in 0..5 {
        let material = if k % 2 == 0 { orange } else { white };
        let [low, high] = [k, k + 1].map(|k| 0.06 + 0.19 * k as f32);
        shape.tube([0.0, -low, 0.0], [0.0, -high, 0.0], [0.27; 2], 10, material);
    }
    shape.disc([0.0, -1.01, 0.0], [0.0, -1.0, 0.0], [0.0, 0.27], 10, &[orange]);
    shape.mesh
}

fn barrier([striped, black]: [MaterialId; 2]) -> Mesh {
    let mut shape = MeshBuilder::default();
    for z in [-0.8, 0.8] {
        shape.cuboid([-0.25, -0.05, z - 0.04], [0.25, 0.02, z + 0.04], black);
        shape.cuboid([-0.03, -1.0, z - 0.03], [0.03, -0.05, z + 0.03], black);
    }
    for up in [0.6, 0.95] {
        shape.cuboid([-0.05, -up - 0.2, -1.0], [-0.03, -up, 1.0], striped);
    }
    shape.mesh
}
