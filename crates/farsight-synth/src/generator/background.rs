//! What lies behind the street: the ground, woods, hills, bridges, and distractors that belong nowhere.

use super::builder::layer;
use super::roadside::Roadside;
use super::surroundings::Surroundings;
use super::{plants, props};
use crate::mesh_builder::MeshBuilder;
use crate::palette::varied;
use crate::scene::MaterialId;

impl Surroundings<'_> {
    /// Trees and woods behind what lines the street.
    pub(super) fn background(&mut self) {
        let (count, tall) = (self.rng.whole(10, 70), self.rng.range(8.0, 20.0));
        for _ in 0..count {
            let mut rng = self.rng.fork();
            let (angle, distance) = (rng.symmetric(0.9), rng.range(60.0, 210.0));
            let point = [distance * libm::sin(angle), distance * libm::cos(angle)];
            let (height, wide) = (tall * rng.range(0.5, 1.1), rng.range32(4.0, 9.0));
            if self.plan.on_street(point, f64::from(wide))
                || self.builder.hides(point, f64::from(wide))
                || !self.has_room(point, 3.0)
            {
                continue;
            }
            let leaves = rng.pick(&self.materials.far_leaves);
            let center = self.builder.over(point, height * 0.45);
            let radii = [wide, height as f32 * 0.55, wide];
            plants::leafy_ball(&mut self.builder.solid, center, radii, [4, 7], leaves, &mut rng);
        }
    }

    /// A bridge over the street.
    pub(super) fn bridge(&mut self) {
        let s = self.rng.range(25.0, 90.0);
        let node = self.plan.main.path.at(s);
        let (low, deck) = (self.rng.range(4.6, 6.5), self.rng.range(0.8, 2.0));
        let half = self.rng.range(2.5, 7.0);
        let outer = [0, 1].map(|side| self.plan.main.outer(side) + 1.0);
        let material = self.materials.stone;
        if self.plan.side.iter().any(|street| street.covers(node.point, half + 3.0))
            || self.builder.hides(node.point, 12.0)
        {
            return;
        }
        let mut shape = MeshBuilder::default();
        let (up, half) = (low as f32, half as f32);
        shape.cuboid([-half, -(up + deck as f32), -60.0], [half, -up, 60.0], material);
        for edge in [-half, half] {
            shape.cuboid(
                [edge - 0.1, -(up + deck as f32 + 1.0), -60.0],
                [edge + 0.1, -(up + deck as f32), 60.0],
                self.materials.metal,
            );
        }
        for (side, out) in [(-1.0, outer[0]), (1.0, outer[1])] {
            // Local z points to the left of the path.
            let wall = -side * out as f32;
            shape.cuboid([-half, -up, wall - 0.6], [half, 0.5, wall + 0.6], material);
        }
        let at = self.builder.over(node.point, 0.0);
        self.builder.solid.place(&shape.mesh, node.yaw(), at);
    }

    /// Shapes that belong nowhere: what is not a vehicle must not be found.
    pub(crate) fn add_distractors(&mut self) {
        for _ in 0..self.rng.whole(2, 14) {
            let mut rng = self.rng.fork();
            let point = [rng.symmetric(18.0), rng.range(5.0, 60.0)];
            let size = rng.log_range(0.2, 2.5);
            if !self.has_room(point, size) || self.builder.hides(point, size) {
                continue;
            }
            let lift = if rng.chance(0.6) { size * 0.5 } else { rng.range(1.0, 8.0) };
            let at = self.builder.over(point, lift);
            let mesh = props::distractor(self.builder, size as f32, &mut rng);
            self.builder.solid.place(&mesh, rng.range(0.0, std::f64::consts::TAU), at);
        }
    }

    /// The ground beyond the streets, in cells that grow with distance.
    pub(super) fn field(&mut self, material: MaterialId) {
        let xs = [-300.0, -140.0, -70.0, -40.0, -20.0, -8.0, 0.0, 8.0, 20.0, 40.0, 70.0, 140.0, 300.0];
        let zs = [-20.0, -8.0, 0.0, 5.0, 10.0, 16.0, 24.0, 34.0, 46.0, 58.0, 70.0, 140.0, 250.0, 500.0];
        for pair in xs.windows(2) {
            for rows in zs.windows(2) {
                let corners = [[pair[0], rows[0]], [pair[1], rows[0]], [pair[1], rows[1]], [pair[0], rows[1]]];
                let middle = [f64::midpoint(pair[0], pair[1]), f64::midpoint(rows[0], rows[1])];
                let reach = (pair[1] - pair[0]) + (rows[1] - rows[0]);
                if self.builder.view.sees(middle, reach) {
                    let points = corners.map(|corner| self.builder.over(corner, -0.06));
                    let uvs = corners.map(|[x, z]| [x as f32, z as f32]);
                    self.builder.flat.quad_uv(points, uvs, material, layer::FIELD);
                }
            }
        }
    }

    /// The edge of a wood: trees and bushes in front of leaves that reach up into the sky.
    pub(super) fn wood(&mut self, side: usize, roadside: &Roadside) {
        if roadside.wood <= 0.0 {
            return;
        }
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let tall = self.rng.range(6.0, 18.0);
        let leaves = self.rng.pick(&self.materials.hedges);
        let d = self.plan.main.outer(side) + roadside.wood;
        let mut s = -14.0;
        let mut height = tall;
        let mut bulge = 0.0;
        while s < 170.0 {
            let next = s + 4.0;
            let next_height = tall * self.rng.range(0.7, 1.2);
            let (a, b) = (self.plan.main.path.at(s), self.plan.main.path.at(next));
            let next_bulge = self.rng.range(0.0, 2.5);
            let (from, to) = (a.beside(sign * (d + 3.0 + bulge)), b.beside(sign * (d + 3.0 + next_bulge)));
            let crosses = self.plan.side.iter().any(|street| street.covers(from, 3.0) || street.covers(to, 3.0));
            let free = !crosses && !self.builder.hides(from, 4.0) && self.has_room(from, 1.0);
            if free && self.builder.view.sees(from, 8.0) {
                let points = [
                    self.builder.over(from, -0.3),
                    self.builder.over(to, -0.3),
                    self.builder.over(to, 0.6 * next_height),
                    self.builder.over(from, 0.6 * height),
                ];
                self.builder.solid.quad(points, leaves, 0);
                self.crowns(from, height);
            }
            if s < 90.0 && self.rng.chance(0.6) {
                let point = a.beside(sign * (d + self.rng.range(-2.0, 2.5)));
                if !self.plan.on_street(point, 0.5) {
                    if self.rng.chance(0.6) {
                        let height = tall * self.rng.range(0.6, 1.1);
                        self.tree(point, height, 0.4);
                    } else {
                        self.bush(point);
                    }
                }
            }
            (height, bulge) = (next_height, next_bulge);
            s = next;
        }
    }

    /// The tops of the trees at the edge of a wood.
    fn crowns(&mut self, point: [f64; 2], height: f64) {
        let mut rng = self.rng.fork();
        let leaves = rng.pick(&self.materials.far_leaves);
        for _ in 0..2 {
            let up = height * rng.range(0.35, 0.75);
            let beside = [point[0] + rng.symmetric(2.0), point[1] + rng.symmetric(2.0)];
            let center = self.builder.over(beside, up);
            let radius = height as f32 * rng.range32(0.16, 0.3);
            plants::leafy_ball(
                &mut self.builder.solid,
                center,
                [radius, radius * 1.1, radius],
                [4, 6],
                leaves,
                &mut rng,
            );
        }
    }

    /// Hills, woods or a town far away.
    pub(super) fn horizon(&mut self) {
        let wooded = self.rng.chance(0.88);
        let color = if wooded {
            varied(&mut self.rng, [0.04, 0.06, 0.025], 0.4)
        } else {
            varied(&mut self.rng, [0.25, 0.25, 0.26], 0.4)
        };
        let material = self.builder.palette.noise(color, color.map(|c| c * 0.5), 14.0, self.rng.seed());
        let (low, high) = if self.rng.chance(0.3) { (20.0, 70.0) } else { (5.0, 22.0) };
        let radius = 420.0;
        let mut height = self.rng.range(low, high);
        for k in 0..48 {
            let angle = |k: f64| (k / 48.0 - 0.5) * 3.6;
            let next = if wooded {
                (height + self.rng.symmetric(0.2) * high).clamp(low, high)
            } else {
                self.rng.range(low, high)
            };
            let end = if wooded { next } else { height };
            let at = |k: f64, up: f64| {
                let point = [radius * libm::sin(angle(k)), radius * libm::cos(angle(k))];
                self.builder.over(point, up)
            };
            let points = [
                at(f64::from(k), -20.0),
                at(f64::from(k) + 1.0, -20.0),
                at(f64::from(k) + 1.0, end),
                at(f64::from(k), height),
            ];
            self.builder.flat.quad(points, material, 0);
            height = next;
        }
    }
}
