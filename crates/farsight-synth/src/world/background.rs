//! What lies behind the street: the ground, woods, hills, bridges, and oddments that belong nowhere.

use super::lining::Lining;
use super::stage::layer;
use super::surroundings::Surroundings;
use super::{plants, props};
use crate::palette::varied;
use crate::scene::MaterialId;
use crate::shape::Shape;

impl Surroundings<'_> {
    /// Trees and woods behind what lines the street.
    pub(super) fn background(&mut self) {
        let (count, tall) = (self.dice.whole(10, 70), self.dice.range(8.0, 20.0));
        for _ in 0..count {
            let mut dice = self.dice.fork();
            let (angle, distance) = (dice.symmetric(0.9), dice.range(60.0, 210.0));
            let point = [distance * libm::sin(angle), distance * libm::cos(angle)];
            let (height, wide) = (tall * dice.range(0.5, 1.1), dice.range32(4.0, 9.0));
            if self.plan.on_street(point, f64::from(wide))
                || self.stage.hides(point, f64::from(wide))
                || !self.has_room(point, 3.0)
            {
                continue;
            }
            let leaves = dice.pick(&self.stock.far_leaves);
            let center = self.stage.over(point, height * 0.45);
            let radii = [wide, height as f32 * 0.55, wide];
            plants::leafy_ball(&mut self.stage.solid, center, radii, [4, 7], leaves, &mut dice);
        }
    }

    /// A bridge over the street.
    pub(super) fn bridge(&mut self) {
        let s = self.dice.range(25.0, 90.0);
        let node = self.plan.main.path.at(s);
        let (low, deck) = (self.dice.range(4.6, 6.5), self.dice.range(0.8, 2.0));
        let half = self.dice.range(2.5, 7.0);
        let outer = [0, 1].map(|side| self.plan.main.outer(side) + 1.0);
        let material = self.stock.stone;
        if self.plan.side.iter().any(|street| street.covers(node.point, half + 3.0))
            || self.stage.hides(node.point, 12.0)
        {
            return;
        }
        let mut shape = Shape::default();
        let (up, half) = (low as f32, half as f32);
        shape.block([-half, -(up + deck as f32), -60.0], [half, -up, 60.0], material);
        for edge in [-half, half] {
            shape.block(
                [edge - 0.1, -(up + deck as f32 + 1.0), -60.0],
                [edge + 0.1, -(up + deck as f32), 60.0],
                self.stock.metal,
            );
        }
        for (side, out) in [(-1.0, outer[0]), (1.0, outer[1])] {
            // Local z points to the left of the path.
            let wall = -side * out as f32;
            shape.block([-half, -up, wall - 0.6], [half, 0.5, wall + 0.6], material);
        }
        let at = self.stage.over(node.point, 0.0);
        self.stage.solid.place(&shape.mesh, node.yaw(), at);
    }

    /// Shapes that belong nowhere: what is not a vehicle must not be found.
    pub(crate) fn distract(&mut self) {
        for _ in 0..self.dice.whole(2, 14) {
            let mut dice = self.dice.fork();
            let point = [dice.symmetric(18.0), dice.range(5.0, 60.0)];
            let size = dice.log_range(0.2, 2.5);
            if !self.has_room(point, size) || self.stage.hides(point, size) {
                continue;
            }
            let lift = if dice.chance(0.6) { size * 0.5 } else { dice.range(1.0, 8.0) };
            let at = self.stage.over(point, lift);
            let mesh = props::oddment(self.stage, size as f32, &mut dice);
            self.stage.solid.place(&mesh, dice.range(0.0, std::f64::consts::TAU), at);
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
                if self.stage.view.sees(middle, reach) {
                    let points = corners.map(|corner| self.stage.over(corner, -0.06));
                    let uvs = corners.map(|[x, z]| [x as f32, z as f32]);
                    self.stage.flat.quad_uv(points, uvs, material, layer::FIELD);
                }
            }
        }
    }

    /// The edge of a wood: trees and bushes in front of leaves that reach up into the sky.
    pub(super) fn wood(&mut self, side: usize, lining: &Lining) {
        if lining.wood <= 0.0 {
            return;
        }
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let tall = self.dice.range(6.0, 18.0);
        let leaves = self.dice.pick(&self.stock.hedges);
        let d = self.plan.main.outer(side) + lining.wood;
        let mut s = -14.0;
        let mut height = tall;
        let mut bulge = 0.0;
        while s < 170.0 {
            let next = s + 4.0;
            let next_height = tall * self.dice.range(0.7, 1.2);
            let (a, b) = (self.plan.main.path.at(s), self.plan.main.path.at(next));
            let next_bulge = self.dice.range(0.0, 2.5);
            let (from, to) = (a.beside(sign * (d + 3.0 + bulge)), b.beside(sign * (d + 3.0 + next_bulge)));
            let crosses = self.plan.side.iter().any(|street| street.covers(from, 3.0) || street.covers(to, 3.0));
            let free = !crosses && !self.stage.hides(from, 4.0) && self.has_room(from, 1.0);
            if free && self.stage.view.sees(from, 8.0) {
                let points = [
                    self.stage.over(from, -0.3),
                    self.stage.over(to, -0.3),
                    self.stage.over(to, 0.6 * next_height),
                    self.stage.over(from, 0.6 * height),
                ];
                self.stage.solid.quad(points, leaves, 0);
                self.crowns(from, height);
            }
            if s < 90.0 && self.dice.chance(0.6) {
                let point = a.beside(sign * (d + self.dice.range(-2.0, 2.5)));
                if !self.plan.on_street(point, 0.5) {
                    if self.dice.chance(0.6) {
                        let height = tall * self.dice.range(0.6, 1.1);
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
        let mut dice = self.dice.fork();
        let leaves = dice.pick(&self.stock.far_leaves);
        for _ in 0..2 {
            let up = height * dice.range(0.35, 0.75);
            let beside = [point[0] + dice.symmetric(2.0), point[1] + dice.symmetric(2.0)];
            let center = self.stage.over(beside, up);
            let radius = height as f32 * dice.range32(0.16, 0.3);
            plants::leafy_ball(
                &mut self.stage.solid,
                center,
                [radius, radius * 1.1, radius],
                [4, 6],
                leaves,
                &mut dice,
            );
        }
    }

    /// Hills, woods or a town far away.
    pub(super) fn horizon(&mut self) {
        let wooded = self.dice.chance(0.88);
        let color = if wooded {
            varied(&mut self.dice, [0.04, 0.06, 0.025], 0.4)
        } else {
            varied(&mut self.dice, [0.25, 0.25, 0.26], 0.4)
        };
        let material = self.stage.palette.noise(color, color.map(|c| c * 0.5), 14.0, self.dice.seed());
        let (low, high) = if self.dice.chance(0.3) { (20.0, 70.0) } else { (5.0, 22.0) };
        let radius = 420.0;
        let mut height = self.dice.range(low, high);
        for k in 0..48 {
            let angle = |k: f64| (k / 48.0 - 0.5) * 3.6;
            let next = if wooded {
                (height + self.dice.symmetric(0.2) * high).clamp(low, high)
            } else {
                self.dice.range(low, high)
            };
            let end = if wooded { next } else { height };
            let at = |k: f64, up: f64| {
                let point = [radius * libm::sin(angle(k)), radius * libm::cos(angle(k))];
                self.stage.over(point, up)
            };
            let points = [
                at(f64::from(k), -20.0),
                at(f64::from(k) + 1.0, -20.0),
                at(f64::from(k) + 1.0, end),
                at(f64::from(k), height),
            ];
            self.stage.flat.quad(points, material, 0);
            height = next;
        }
    }
}
