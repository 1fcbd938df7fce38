//! What lies beside and behind the streets: fields, houses, trees, posts, hills.

use farsight_core::{Box3d, Dimensions};

use super::builder::SceneBuilder;
use super::plan::Plan;
use super::plants;
use super::props::{self, HouseLook, StreetMaterials};
use super::roadside::Roadside;
use crate::palette::{grey, matte, varied};
use crate::rng::SceneRng;
use crate::scene::{Material, MaterialId, Pattern};

/// Nothing beside the road is built farther along it, metres.
const FAR_M: f64 = 150.0;

/// Builds what is beside the streets.
pub(crate) struct Surroundings<'a> {
    pub(crate) builder: &'a mut SceneBuilder,
    pub(crate) plan: &'a Plan,
    pub(crate) materials: StreetMaterials,
    /// About so many things on pavements for each ten metres of a side.
    pub(crate) clutter: f64,
    pub(crate) rng: SceneRng,
}

impl Surroundings<'_> {
    pub(crate) fn build_all(&mut self, field: MaterialId) {
        self.field(field);
        for side in 0..2 {
            let roadside = self.plan.roadside[side];
            self.houses(side, &roadside);
            self.fences(side, &roadside);
            self.street_trees(side, &roadside);
            self.plants(side, &roadside);
            self.wood(side, &roadside);
            self.posts(side, &roadside);
            if roadside.guard_rail {
                self.guard_rail(side);
            }
        }
        if self.rng.chance(0.05) {
            self.bridge();
        }
        if self.rng.chance(0.8) {
            self.background();
        }
        self.horizon();
        if self.clutter > 0.0 {
            self.clutter();
        }
    }

    fn houses(&mut self, side: usize, roadside: &Roadside) {
        if roadside.house_gap < 0.0 {
            return;
        }
        let lit = if self.builder.light.lamps_on { 0.25 } else { 0.01 };
        let looks: Vec<HouseLook> =
            (0..self.rng.whole(2, 5)).map(|_| HouseLook::sample(self.builder, lit, &mut self.rng)).collect();
        let mut s = -10.0;
        while s < FAR_M + self.builder.view.travel_m {
            let width = self.rng.range(roadside.house_width[0], roadside.house_width[1]);
            let depth = self.rng.range(7.0, 13.0);
            let height = self.rng.range(roadside.house_height[0], roadside.house_height[1]);
            let setback = roadside.setback * self.rng.range(0.7, 1.3) + 0.3;
            self.house(side, s + width / 2.0, [width, depth, height], setback, &looks);
            s += width * (1.0 + roadside.house_gap * self.rng.range(0.3, 1.7));
        }
    }

    fn house(&mut self, side: usize, s: f64, [width, depth, height]: [f64; 3], setback: f64, looks: &[HouseLook]) {
        let mut rng = self.rng.fork();
        let look = rng.pick(looks);
        let node = self.plan.main.path.at(s);
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let front = sign * (self.plan.main.outer(side) + setback);
        let center = node.beside(front + sign * depth / 2.0);
        // The front looks at the road: local +z points to it.
        let yaw = node.yaw() + if side == 1 { 0.0 } else { std::f64::consts::PI };
        let dimensions = Dimensions { height, width: depth, length: width };
        let location = [center[0], self.builder.ground.y(center), center[1]];
        let box3d = Box3d { dimensions, location, yaw };
        let probes = [[-0.5, -0.5], [0.0, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.0, 0.5], [0.5, 0.5], [0.0, 0.0]];
        let blocked = probes.iter().any(|[a, b]| {
            let at = crate::objects::point_of(&box3d, [(a * width) as f32, 0.0, (b * depth) as f32]);
            self.plan.on_street([f64::from(at[0]), f64::from(at[2])], 0.0)
        });
        let reach = f64::midpoint(width, depth) + 15.0;
        let hides = self.builder.hides(center, f64::midpoint(width, depth) * 0.75);
        if blocked || hides || !self.builder.view.sees(center, reach) || !self.builder.is_free(&box3d, 0.3) {
            return;
        }
        let mesh = props::house(width as f32, depth as f32, height as f32, &look, &mut rng);
        let at = self.builder.over(node.beside(front), 0.0);
        self.builder.solid.place(&mesh, yaw, at);
        self.builder.take(&box3d);
        self.maybe_shop(&box3d, node.beside(front), setback, &mut rng);
    }

    /// Garden walls, hedges and fences behind the pavement.
    fn fences(&mut self, side: usize, roadside: &Roadside) {
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let mut s = -6.0;
        while s < 90.0 {
            let length = self.rng.log_range(4.0, 22.0);
            if self.rng.chance(roadside.fenced) {
                let kind = self.rng.weighted(&[(0, 3.0), (1, 2.0), (2, 2.0)]);
                let height = match kind {
                    0 => self.rng.range(0.9, 2.4),
                    1 => self.rng.range(0.5, 2.0),
                    _ => self.rng.range(0.8, 1.8),
                };
                let material = self.fence_material(kind);
                let d = sign * (self.plan.main.outer(side) + self.rng.range(0.1, 0.8));
                let thick = if kind == 0 { self.rng.range(0.5, 1.1) } else { 0.2 };
                self.wall_along([s, s + length], d, sign * thick, height, material);
            }
            s += length + self.rng.range(0.5, 6.0);
        }
    }

    fn fence_material(&mut self, kind: usize) -> MaterialId {
        match kind {
            0 => self.rng.pick(&self.materials.hedges),
            1 => {
                let color = varied(&mut self.rng, [0.4, 0.33, 0.26], 0.5);
                let wall = props::plain_wall(color, &mut self.rng);
                self.builder.palette.add(wall)
            }
            _ => {
                let seed = self.rng.seed();
                let tone = self.rng.range32(0.05, 0.5);
                let holes = Pattern::Leaves { other: grey(tone), scale: 0.08, density: 0.55, seed };
                self.builder.palette.add(Material { pattern: holes, ..matte(grey(tone)) })
            }
        }
    }

    /// A long block beside the path.
    fn wall_along(&mut self, [from, to]: [f64; 2], d: f64, thick: f64, height: f64, material: MaterialId) {
        let mut s = from;
        while s < to {
            let next = (s + 3.0).min(to);
            let (a, b) = (self.plan.main.path.at(s), self.plan.main.path.at(next));
            let middle = a.beside(d + thick / 2.0);
            if !self.blocked(middle, 0.6) && !self.builder.hides(middle, 3.2) && self.builder.view.sees(middle, 6.0) {
                let corner = |node: &super::path::Node, d: f64, up: f64| self.builder.over(node.beside(d), up);
                let (near, far) = (d, d + thick);
                let faces = [
                    [
                        corner(&a, near, -0.1),
                        corner(&b, near, -0.1),
                        corner(&b, near, height),
                        corner(&a, near, height),
                    ],
                    [corner(&a, far, -0.1), corner(&b, far, -0.1), corner(&b, far, height), corner(&a, far, height)],
                    [
                        corner(&a, near, height),
                        corner(&b, near, height),
                        corner(&b, far, height),
                        corner(&a, far, height),
                    ],
                    [corner(&a, near, -0.1), corner(&a, far, -0.1), corner(&a, far, height), corner(&a, near, height)],
                ];
                let along = |s: f64| s as f32;
                for face in faces {
                    let up = height as f32;
                    let uvs = [[along(s), 0.0], [along(next), 0.0], [along(next), up], [along(s), up]];
                    self.builder.solid.quad_uv(face, uvs, material, 0);
                }
            }
            s = next;
        }
    }

    /// Whether something of this radius would stand on a street or on someone's room.
    pub(super) fn blocked(&self, point: [f64; 2], radius: f64) -> bool {
        self.plan.side.iter().any(|street| street.covers(point, 0.3)) || !self.has_room(point, radius)
    }

    pub(super) fn has_room(&self, point: [f64; 2], radius: f64) -> bool {
        let dimensions = Dimensions { height: 1.0, width: 2.0 * radius, length: 2.0 * radius };
        let location = [point[0], self.builder.ground.y(point), point[1]];
        self.builder.is_free(&Box3d { dimensions, location, yaw: 0.0 }, 0.0)
    }

    fn street_trees(&mut self, side: usize, roadside: &Roadside) {
        if roadside.tree_pitch <= 0.0 {
            return;
        }
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let border = self.plan.main.borders[side];
        let inset = if border.verge > 0.8 { border.verge / 2.0 } else { 0.7 };
        let height = self.rng.range(5.0, 14.0);
        let mut s = self.rng.range(-5.0, 5.0);
        while s < 120.0 + self.builder.view.travel_m {
            let point = self.plan.main.path.at(s).beside(self.plan.main.edges[side] + sign * inset);
            if !self.plan.main.is_open(s) {
                let height = height * self.rng.range(0.75, 1.25);
                self.tree(point, height, 0.4);
            }
            s += roadside.tree_pitch * self.rng.range(0.8, 1.2);
        }
    }

    pub(super) fn tree(&mut self, point: [f64; 2], height: f64, room: f64) {
        let mut rng = self.rng.fork();
        let distance = self.builder.passes_m(point);
        let crown = height * 0.33;
        if distance < 4.0
            || self.blocked(point, room)
            || self.builder.hides(point, crown)
            || !self.builder.view.sees(point, height)
        {
            return;
        }
        let mesh = plants::tree(height as f32, &self.materials, distance < 45.0, &mut rng);
        let at = self.builder.over(point, 0.0);
        self.builder.solid.place(&mesh, rng.range(0.0, std::f64::consts::TAU), at);
    }

    /// Trees and bushes in gardens and fields.
    fn plants(&mut self, side: usize, roadside: &Roadside) {
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let count = (roadside.plants * 1.2) as usize;
        for _ in 0..count {
            let s = self.rng.range(0.0, 120.0 + self.builder.view.travel_m);
            let d = self.plan.main.outer(side) + self.rng.log_range(0.8, 30.0);
            let point = self.plan.main.path.at(s).beside(sign * d);
            if self.plan.on_street(point, 0.3) {
                continue;
            }
            if self.rng.chance(0.55) {
                let height = self.rng.log_range(3.0, 14.0);
                self.tree(point, height, 0.3);
            } else {
                self.bush(point);
            }
        }
    }

    pub(super) fn bush(&mut self, point: [f64; 2]) {
        let mut rng = self.rng.fork();
        let height = rng.log_range(0.5, 3.5);
        let wide = height * rng.range(0.8, 2.0);
        let distance = self.builder.passes_m(point);
        if distance < 4.0
            || self.blocked(point, wide / 2.0)
            || self.builder.hides(point, wide * 0.6)
            || !self.builder.view.sees(point, 5.0)
        {
            return;
        }
        let mesh = plants::bush(height as f32, wide as f32, &self.materials, distance < 40.0, &mut rng);
        let at = self.builder.over(point, 0.0);
        self.builder.solid.place(&mesh, 0.0, at);
    }

    fn posts(&mut self, side: usize, roadside: &Roadside) {
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let edge = self.plan.main.edges[side];
        let lamp_height = self.rng.range(4.5, 10.0);
        let lamp_pitch = self.rng.range(18.0, 40.0);
        let has_lamps = self.rng.chance(0.6);
        let mut next_lamp = self.rng.range(0.0, lamp_pitch);
        while has_lamps && next_lamp < 110.0 + self.builder.view.travel_m {
            let node = self.plan.main.path.at(next_lamp);
            let point = node.beside(edge + sign * 0.6);
            if !self.blocked(point, 0.1)
                && !self.builder.hides(point, 0.3)
                && self.builder.view.sees(point, lamp_height)
            {
                // Leans over the road: local +z points to it.
                let yaw = node.yaw() + if side == 1 { 0.0 } else { std::f64::consts::PI };
                let at = self.builder.over(point, 0.0);
                let mut rng = self.rng.fork();
                props::street_lamp(self.builder, at, yaw, lamp_height as f32, &self.materials, &mut rng);
            }
            next_lamp += lamp_pitch;
        }
        let count = (roadside.posts * self.rng.range(0.3, 1.2)) as usize;
        for _ in 0..count {
            let s = self.rng.range(4.0, 80.0 + self.builder.view.travel_m);
            let node = self.plan.main.path.at(s);
            let point = node.beside(edge + sign * self.rng.range(0.4, 1.6));
            let mut rng = self.rng.fork();
            if self.blocked(point, 0.2) || self.builder.hides(point, 0.5) || !self.builder.view.sees(point, 3.0) {
                continue;
            }
            let facing = node.yaw() + if side == 1 { 0.0 } else { std::f64::consts::PI } + rng.normal(0.0, 0.15);
            let mesh = match rng.weighted(&[(0, 3.0), (1, 1.0), (2, 2.0), (3, 1.0), (4, 1.0)]) {
                0 => props::sign(self.builder, &self.materials, &mut rng),
                1 => props::traffic_light(self.builder, &self.materials, &mut rng),
                2 => props::post(&self.materials, &mut rng),
                3 => props::bin(self.builder, &mut rng),
                _ => props::parked_bicycle(self.builder, &mut rng),
            };
            let at = self.builder.over(point, self.plan.main.borders[side].kerb);
            self.builder.solid.place(&mesh, facing, at);
        }
    }

    fn guard_rail(&mut self, side: usize) {
        let sign = if side == 0 { -1.0 } else { 1.0 };
        let d = self.plan.main.edges[side] + sign * 0.8;
        let metal = self.materials.metal;
        let mut s = -10.0;
        while s < 120.0 + self.builder.view.travel_m {
            let (a, b) = (self.plan.main.path.at(s), self.plan.main.path.at(s + 4.0));
            if !self.blocked(a.beside(d), 0.3)
                && !self.builder.hides(a.beside(d), 4.0)
                && self.builder.view.sees(a.beside(d), 5.0)
            {
                let at = |node: &super::path::Node, up: f64| self.builder.over(node.beside(d), up);
                let points = [at(&a, 0.45), at(&b, 0.45), at(&b, 0.78), at(&a, 0.78)];
                let post = [self.builder.over(a.beside(d), -0.1), self.builder.over(a.beside(d), 0.7)];
                self.builder.solid.quad(points, metal, 0);
                self.builder.solid.tube(post[0], post[1], [0.05; 2], 4, metal);
            }
            s += 4.0;
        }
    }
}
