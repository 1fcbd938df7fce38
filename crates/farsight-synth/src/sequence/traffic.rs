//! Who is in the street, and what they do step by step.

use std::f64::consts::TAU;

use farsight_core::{Dimensions, ObjectClass};

use super::Step;
use super::camera::{Body as Chassis, ego_step};
use super::follow::{Leader, acceleration};
use super::frame::Body;
use super::mover::{Braking, Change, Moment, Mover, Role};
use crate::generator::builder::SceneBuilder;
use crate::generator::config::Place;
use crate::generator::ground::Ground;
use crate::generator::path::Path;
use crate::generator::plan::Plan;
use crate::generator::street::{Lane, LaneUse};
use crate::generator::traffic::Traffic as Standing;
use crate::region::Participant;
use crate::rng::SceneRng;
use crate::sizes::SizeStatistics;

/// The camera's car goes at most so many times as fast as is usual.
pub(super) const MAX_SPEED_SHARE: f64 = 1.1;

/// Steps of the simulation are at most so long, seconds.
const STEP_S: f64 = 0.02;

/// The camera's car: its size, and how far its middle is behind the camera, metres.
const EGO_SIZE: Dimensions = Dimensions { height: 1.5, width: 1.8, length: 4.4 };
const EGO_BACK_M: f64 = 0.6;

/// No more than these move.
const MAX_VEHICLES: usize = 36;
const MAX_PEOPLE: usize = 14;

/// A car that turns goes at most so fast, m/s, from so far before its bend on, metres; and the radius of the bend.
const TURN_MPS: f64 = 5.0;
const TURN_SLOWS_M: f64 = 18.0;
const TURN_RADIUS_M: f64 = 7.0;

/// The speed of a place's traffic, m/s.
pub(super) fn usual_speed_mps(place: Place, rng: &mut SceneRng) -> f64 {
    match place {
        Place::City => rng.range(6.0, 13.0),
        Place::Residential => rng.range(4.5, 8.5),
        Place::Suburban => rng.range(8.0, 15.0),
        Place::Rural => rng.range(13.0, 25.0),
        Place::Motorway => rng.range(20.0, 34.0),
        Place::CarPark => rng.range(2.0, 4.0),
    }
}

/// The camera's car and all others.
pub(super) struct Simulation {
    main: Path,
    /// The first is the camera's car.
    movers: Vec<Mover>,
    time_s: f64,
}

/// Where somebody is on the main road: along it, to its right, and their speed along it.
type OnMain = [f64; 3];

impl Simulation {
    /// Draws who is there at the beginning.
    pub(super) fn new(standing: &mut Standing, usual_mps: f64, duration_s: f64, rng: &mut SceneRng) -> Self {
        let plan = standing.plan;
        let main = plan.main.path.clone();
        let who = Participant { class: ObjectClass::Car, size: EGO_SIZE, kind: None };
        let desired = usual_mps * rng.range(0.9, MAX_SPEED_SHARE);
        let mut ego = driver(who, &main, 1.0, 0.0, rng);
        (ego.desired, ego.speed, ego.sway, ego.s) = (desired, 0.95 * desired, [0.0; 3], 0.0);
        let mut simulation = Self { main, movers: vec![ego], time_s: 0.0 };
        simulation.drive(standing, usual_mps, duration_s, rng);
        simulation.turn(standing, usual_mps, rng);
        simulation.walk(plan, standing.people_density, rng);
        simulation
    }

    /// Vehicles in the lanes of the main road.
    fn drive(&mut self, standing: &mut Standing, usual_mps: f64, duration_s: f64, rng: &mut SceneRng) {
        let plan = standing.plan;
        let [start, end] = self.main.range();
        let gap_m = (plan.gap / standing.density.max(0.05)).clamp(8.0, 80.0);
        let is_own = |lane: &Lane| lane.direction > 0.0 && lane.center.abs() < lane.width / 2.0;
        let mut lanes: Vec<_> = plan.main.lanes.iter().filter(|lane| lane.used_for == LaneUse::Drive).collect();
        // Those before the camera matter most, if there are too many.
        lanes.sort_by_key(|lane| !is_own(lane));
        for lane in lanes {
            let is_own = is_own(lane);
            let lane_mps = if is_own { self.movers[0].speed } else { usual_mps * rng.range(0.8, 1.2) };
            let mut s = start + 2.0 + rng.range(0.0, gap_m);
            let mut is_next = true;
            while s < end - 6.0 && self.movers.len() < MAX_VEHICLES {
                let who = standing.vehicle();
                let length = who.size.length;
                // Around the camera's car its lane is free.
                let room = 5.0 + 0.5 * lane_mps;
                if is_own && s + length > -room && s < room {
                    s = room + rng.range(0.0, 1.2) * lane_mps;
                    continue;
                }
                let mut mover = driver(who, &self.main, lane.direction, lane.center, rng);
                mover.s = s + length / 2.0;
                mover.speed = lane_mps * rng.range(0.93, 1.05);
                mover.desired = mover.speed * rng.range(0.97, 1.3);
                mover.lights_on = rng.chance(standing.builder.light.lights_share);
                let is_lead = is_own && is_next && mover.s > 0.0;
                is_next &= !is_lead;
                if rng.chance(if is_lead { 0.6 } else { 0.1 }) {
                    mover.braking = Some(braking(mover.speed, duration_s, rng));
                }
                let is_beside = lane.direction > 0.0 && !is_own && (-12.0..45.0).contains(&mover.s);
                if is_beside && rng.chance(0.35) {
                    mover.cuts_in_s = Some(rng.range(0.1, 0.6) * duration_s);
                }
                s += length + (0.9 * lane_mps).max(4.0) + rng.range(0.1, 1.6) * gap_m;
                self.movers.push(mover);
            }
        }
    }

    /// Vehicles that leave the main road to their right, and those that wait in the side streets.
    fn turn(&mut self, standing: &mut Standing, usual_mps: f64, rng: &mut SceneRng) {
        let plan = standing.plan;
        for (side, opening) in plan.side.iter().zip(&plan.main.openings) {
            let middle = f64::midpoint(opening[0], opening[1]);
            let way = if rng.chance(0.5) { 1.0 } else { -1.0 };
            let lanes = |lanes: &[Lane], way: f64| -> Option<f64> {
                let found = lanes.iter().filter(|lane| lane.used_for == LaneUse::Drive && lane.direction * way > 0.0);
                found.map(|lane| lane.center).reduce(|a, b| if (a - b) * way > 0.0 { a } else { b })
            };
            if let (true, Some(from), Some(to)) =
                (rng.chance(0.6), lanes(&plan.main.lanes, way), lanes(&side.lanes, way))
            {
                let who = standing.vehicle();
                let (path, bend) = turning(&self.main, &side.path, [middle, way], [from, to]);
                let mut mover = driver(who, &path, 1.0, 0.0, rng);
                let before = rng.range(8.0, 50.0);
                mover.s = (bend[0] - before).max(path.range()[0] + 2.0);
                (mover.speed, mover.desired) = (0.8 * usual_mps, usual_mps);
                mover.role = Role::Turn { bend };
                let at = self.main.nearest(mover.path.at(mover.s).point);
                if who_fits(self, at, mover.who.size.length) {
                    self.movers.push(mover);
                }
            }
            let reach = plan.main.edges.map(f64::abs).into_iter().fold(0.0, f64::max) + 4.0;
            for lane in side.lanes.iter().filter(|lane| lane.used_for == LaneUse::Drive) {
                if rng.chance(0.4) {
                    let who = standing.vehicle();
                    let mut mover = driver(who, &side.path, lane.direction, lane.center, rng);
                    mover.s = -lane.direction * (reach + mover.who.size.length / 2.0);
                    (mover.role, mover.sway) = (Role::Walk { begin_s: 0.0 }, [0.0; 3]);
                    self.movers.push(mover);
                }
            }
        }
    }

    /// People on foot and on bicycles.
    fn walk(&mut self, plan: &Plan, density: f64, rng: &mut SceneRng) {
        let street = &plan.main;
        let person = |class: ObjectClass, rng: &mut SceneRng| Participant {
            size: SizeStatistics::of(&class).sample(rng),
            class,
            kind: None,
        };
        let [_, end] = street.path.range();
        let count = |mean: f64, rng: &mut SceneRng| ((mean * density * rng.range(0.5, 3.0)) as usize).min(MAX_PEOPLE);
        for _ in 0..count(plan.people, rng) {
            let side = rng.whole(0, 1);
            let sign = if side == 0 { -1.0 } else { 1.0 };
            let border = street.borders[side];
            let mut walker;
            if border.pavement < 0.5 || rng.chance(0.3) {
                // Crosses the road.
                let node = street.path.at(rng.range(12.0, 0.6 * end));
                let reach = [street.edges[0] - 1.2, street.edges[1] + 1.2].map(|edge| sign * edge);
                let yaw = node.yaw() + sign * std::f64::consts::FRAC_PI_2;
                let path =
                    Path::new(node.point, yaw, [reach[0].min(reach[1]) - 3.0, reach[0].max(reach[1]) + 3.0], |_| 0.0);
                walker = driver(person(ObjectClass::Pedestrian, rng), &path, 1.0, 0.0, rng);
                walker.s = reach[0].min(reach[1]);
                walker.role = Role::Walk { begin_s: rng.range(0.0, 4.0) };
            } else {
                let lane = street.edges[side] + sign * (border.verge + rng.range(0.4, border.pavement.max(0.5)));
                let way = if rng.chance(0.5) { 1.0 } else { -1.0 };
                walker = driver(person(ObjectClass::Pedestrian, rng), &street.path, way, lane, rng);
                walker.s = rng.range(3.0, 0.8 * end);
                (walker.role, walker.lift) = (Role::Walk { begin_s: 0.0 }, border.kerb);
            }
            walker.desired = rng.range(0.9, 1.8);
            walker.speed = if walker.role == (Role::Walk { begin_s: 0.0 }) { walker.desired } else { 0.0 };
            walker.sway = [0.02, 5.0, rng.range(0.0, TAU)];
            self.movers.push(walker);
        }
        for _ in 0..count(0.5 * plan.cyclists, rng) {
            let lane = street.edges[1] - rng.range(0.5, 1.0);
            let mut rider = driver(person(ObjectClass::Cyclist, rng), &street.path, 1.0, lane, rng);
            rider.s = rng.range(8.0, 0.7 * end);
            (rider.desired, rider.role) = (rng.range(3.0, 7.0), Role::Walk { begin_s: 0.0 });
            rider.speed = rider.desired;
            self.movers.push(rider);
        }
    }

    /// What moves in each frame.
    pub(super) fn run(&mut self, frames: usize, fps: f64, ground: &Ground, rng: &mut SceneRng) -> Vec<Step> {
        let substeps = (1.0 / (fps * STEP_S)).ceil().max(1.0) as usize;
        let dt_s = 1.0 / (fps * substeps as f64);
        let starts: Vec<f64> = self.movers.iter().map(|mover| mover.s).collect();
        let mut chassis = Chassis::new(rng);
        // The car has been driving before.
        for _ in 0..200 {
            chassis.step(STEP_S, self.movers[0].speed, 0.0, rng);
        }
        let mut steps = Vec::with_capacity(frames);
        for frame in 0..frames {
            self.time_s = frame as f64 / fps;
            let ego = &self.movers[0];
            let ego = ego_step(&self.main, ego.s, ego.speed, ego.acceleration, &chassis, ground);
            let others = self.movers.iter().zip(&starts).skip(1);
            let movers =
                others.map(|(mover, start)| mover.is_there().then(|| mover.moment(self.time_s, *start, ground)));
            steps.push(Step { ego, movers: movers.collect() });
            for substep in 0..substeps {
                self.time_s = frame as f64 / fps + substep as f64 * dt_s;
                self.advance(dt_s);
                chassis.step(dt_s, self.movers[0].speed, self.movers[0].acceleration, rng);
            }
        }
        steps
    }

    fn advance(&mut self, dt_s: f64) {
        let on_main: Vec<Option<OnMain>> = self.movers.iter().map(|mover| self.on_main(mover)).collect();
        for index in 0..self.movers.len() {
            self.steer(index, &on_main);
            let wanted = self.wanted(index, &on_main);
            let mover = &mut self.movers[index];
            let before = mover.speed;
            mover.speed = (before + wanted * dt_s).max(0.0);
            mover.acceleration = (mover.speed - before) / dt_s;
            mover.s += mover.way * dt_s * f64::midpoint(before, mover.speed);
        }
    }

    fn on_main(&self, mover: &Mover) -> Option<OnMain> {
        match mover.role {
            _ if !mover.is_there() => None,
            Role::Drive => Some([mover.s, mover.offset(self.time_s), mover.way * mover.speed]),
            Role::Turn { .. } | Role::Walk { .. } => {
                let node = mover.path.at(mover.s);
                let [s, d] = self.main.nearest(node.beside(mover.offset(self.time_s)));
                let along = self.main.at(s).direction;
                let cos = along[0] * node.direction[0] + along[1] * node.direction[1];
                Some([s, d, mover.way * mover.speed * cos])
            }
        }
    }

    /// The acceleration that somebody wants, m/s².
    fn wanted(&self, index: usize, on_main: &[Option<OnMain>]) -> f64 {
        let mover = &self.movers[index];
        if let Role::Walk { begin_s } = mover.role {
            let may_go = self.time_s >= begin_s && (mover.speed > 0.0 || self.is_safe(index, on_main));
            let wanted = if may_go { mover.desired } else { 0.0 };
            return (wanted - mover.speed).clamp(-2.0, 2.0) / 0.3;
        }
        let mut desired = mover.desired;
        if let Role::Turn { bend } = mover.role {
            if mover.s > bend[0] - TURN_SLOWS_M && mover.s < bend[1] {
                desired = desired.min(TURN_MPS);
            }
            if mover.s > bend[0] {
                return acceleration(mover.speed, desired, None);
            }
        }
        let Some([s, d, along]) = on_main[index] else { return 0.0 };
        let leader = self.leader(index, [s, d, along.signum()], on_main);
        let wanted = acceleration(mover.speed, desired, leader);
        match mover.braking {
            Some(Braking { begin_s, end_s, deceleration_mps2, speed_mps })
                if (begin_s..end_s).contains(&self.time_s) =>
            {
                wanted.min(if mover.speed > speed_mps { -deceleration_mps2 } else { 0.0 })
            }
            _ => wanted,
        }
    }

    /// Who is next ahead of somebody at this place of the main road who goes this way.
    fn leader(&self, index: usize, [s, d, way]: [f64; 3], on_main: &[Option<OnMain>]) -> Option<Leader> {
        let own = &self.movers[index].who.size;
        let back = |index: usize| if index == 0 { EGO_BACK_M } else { 0.0 };
        let others = self.movers.iter().enumerate().zip(on_main).filter(|((other, _), _)| *other != index);
        let ahead = others.filter_map(|((place, other), at)| {
            let [other_s, other_d, other_along] = (*at)?;
            let is_on_foot = other.who.class == ObjectClass::Pedestrian;
            let room = f64::midpoint(own.width, other.who.size.width) + if is_on_foot { 1.2 } else { 0.25 };
            let way = if way == 0.0 { self.movers[index].way } else { way };
            let extent = f64::midpoint(own.length, if is_on_foot { 0.6 } else { other.who.size.length });
            let far = (other_s - back(place) - s + back(index)) * way;
            let is_ahead = far > 0.0 && (other_d - d).abs() < room;
            is_ahead.then_some(Leader { gap_m: far - extent, speed: (other_along * way).max(0.0) })
        });
        ahead.min_by(|a, b| a.gap_m.total_cmp(&b.gap_m))
    }

    /// Whether whoever drives on the main road can stop before somebody who begins to cross it.
    fn is_safe(&self, index: usize, on_main: &[Option<OnMain>]) -> bool {
        let Some([s, ..]) = on_main[index] else { return false };
        let direction = self.movers[index].path.at(self.movers[index].s).direction;
        let along = self.main.at(s).direction;
        let crosses = (along[0] * direction[0] + along[1] * direction[1]).abs() < 0.5;
        let is_far = |(mover, at): (&Mover, &Option<OnMain>)| {
            let Some([other_s, ..]) = *at else { return true };
            let far = (s - other_s) * mover.way;
            mover.role != Role::Drive || far < -3.0 || far > 7.0 + mover.speed * mover.speed / 8.0
        };
        !crosses || self.movers[index].desired == 0.0 || self.movers.iter().zip(on_main).all(is_far)
    }

    /// Begins and ends changes of lanes.
    fn steer(&mut self, index: usize, on_main: &[Option<OnMain>]) {
        let mover = &self.movers[index];
        if let Some(change) = mover.change {
            if self.time_s > change.begin_s + change.duration_s {
                self.movers[index].lane = change.to;
                self.movers[index].change = None;
            }
            return;
        }
        if index == 0 || mover.role != Role::Drive || mover.way < 0.0 || mover.speed < 3.0 {
            return;
        }
        let Some([s, d, _]) = on_main[index] else { return };
        let cuts_in = mover.cuts_in_s.is_some_and(|from| self.time_s >= from);
        let target = if cuts_in {
            Some(0.0)
        } else {
            let slower = self.leader(index, [s, d, 1.0], on_main);
            let is_held = slower.is_some_and(|other| other.gap_m < 30.0 && other.speed < mover.desired - 2.0);
            is_held.then(|| self.free_lane(index, s, on_main)).flatten()
        };
        let (begin_s, from) = (self.time_s, mover.lane);
        if let Some(to) = target.filter(|to| (to - from).abs() < 4.5 && self.has_room(index, *to, s, on_main)) {
            let duration_s = if cuts_in { 2.5 } else { 3.5 };
            let mover = &mut self.movers[index];
            mover.change = Some(Change { from, to, begin_s, duration_s });
            mover.cuts_in_s = None;
        }
    }

    /// The nearest lane of somebody's own way that is not theirs, the left one first.
    fn free_lane(&self, index: usize, s: f64, on_main: &[Option<OnMain>]) -> Option<f64> {
        let mover = &self.movers[index];
        let others = self.movers.iter().filter(|other| other.role == Role::Drive && other.way > 0.0);
        let mut lanes: Vec<f64> = others.map(|other| other.lane).collect();
        lanes.retain(|lane| (2.0..4.5).contains(&(lane - mover.lane).abs()));
        lanes.sort_by(f64::total_cmp);
        lanes.into_iter().find(|lane| self.has_room(index, *lane, s, on_main))
    }

    /// Whether a lane is free beside, before and behind somebody.
    fn has_room(&self, index: usize, lane: f64, s: f64, on_main: &[Option<OnMain>]) -> bool {
        let mover = &self.movers[index];
        self.movers.iter().enumerate().zip(on_main).all(|((other, them), at)| {
            let Some([other_s, other_d, along]) = *at else { return true };
            let target = them.change.map_or(other_d, |change| change.to);
            let is_in_lane = (other_d - lane).abs() < 1.9 || (target - lane).abs() < 1.9;
            let lengths = f64::midpoint(mover.who.size.length, them.who.size.length);
            let closing = if other_s > s { mover.speed - along } else { along - mover.speed };
            other == index || !is_in_lane || (other_s - s).abs() > lengths + 4.0 + 1.5 * closing.max(0.0)
        })
    }

    /// Meshes of all but the camera's car.
    pub(super) fn bodies(&self, builder: &mut SceneBuilder, steps: &[Step], rng: &mut SceneRng) -> Vec<Body> {
        let mut bodies = Vec::new();
        for (place, mover) in self.movers.iter().skip(1).enumerate() {
            let distance = |step: &Step| {
                let Moment { box3d, .. } = step.movers[place]?;
                let [x, _, z] = box3d.location;
                Some((x - step.ego.point[0]).hypot(z - step.ego.point[1]))
            };
            let nearest_m = steps.iter().filter_map(distance).fold(f64::INFINITY, f64::min);
            bodies.push(Body::build(&mover.who, mover.lights_on, nearest_m, builder, rng.fork()));
        }
        bodies
    }
}

/// Somebody at the beginning of a path.
fn driver(who: Participant, path: &Path, way: f64, lane: f64, rng: &mut SceneRng) -> Mover {
    Mover {
        who,
        role: Role::Drive,
        path: path.clone(),
        way,
        s: 0.0,
        speed: 0.0,
        acceleration: 0.0,
        desired: 0.0,
        lane: lane + rng.normal(0.0, 0.15).clamp(-0.35, 0.35),
        change: None,
        braking: None,
        cuts_in_s: None,
        lift: 0.0,
        sway: [rng.range(0.0, 0.1), rng.range(0.4, 1.2), rng.range(0.0, TAU)],
        lights_on: false,
    }
}

/// Whether nobody is at this place of the main road.
fn who_fits(simulation: &Simulation, [s, d]: [f64; 2], length: f64) -> bool {
    simulation.movers.iter().all(|mover| {
        let is_near = (mover.s - s).abs() < f64::midpoint(length, mover.who.size.length) + 6.0;
        mover.role != Role::Drive || !is_near || (mover.lane - d).abs() > 2.0
    })
}

/// How somebody of this speed will brake.
fn braking(speed: f64, duration_s: f64, rng: &mut SceneRng) -> Braking {
    let deceleration_mps2 = rng.log_range(1.2, 6.0);
    let speed_mps = speed * rng.range(0.0, 0.7);
    let begin_s = duration_s * rng.range(0.1, 0.55);
    let end_s = begin_s + (speed - speed_mps) / deceleration_mps2 + rng.range(0.2, 2.5);
    Braking { begin_s, end_s, deceleration_mps2, speed_mps }
}

/// From a lane of the main road (offset `from`, this way) through a bend into one of a street that meets it at `middle`
/// (offset `to`): the path, and where the bend begins and ends on it.
fn turning(main: &Path, side: &Path, [middle, way]: [f64; 2], [from, to]: [f64; 2]) -> (Path, [f64; 2]) {
    let [start, end] = main.range();
    let reach = from.abs() + TURN_RADIUS_M;
    let corner = middle - way * (to.abs() + TURN_RADIUS_M);
    let begin = if way > 0.0 { start + 1.0 } else { end - 1.0 };
    let count = ((corner - begin).abs() / 2.0).ceil().max(2.0) as usize;
    let lerp = |a: f64, b: f64, k: usize, of: usize| a + (b - a) * k as f64 / of as f64;
    let mut points: Vec<[f64; 2]> = (0..=count).map(|k| main.at(lerp(begin, corner, k, count)).beside(from)).collect();
    let first = points.len();
    let (p0, p2) = (main.at(corner).beside(from), side.at(way * reach).beside(to));
    // The control point is where both lanes meet, about.
    let p1 = side.at(from).beside(to);
    for k in 1..10 {
        let t = f64::from(k) / 10.0;
        points.push(
            [0, 1].map(|axis| (1.0 - t) * (1.0 - t) * p0[axis] + 2.0 * t * (1.0 - t) * p1[axis] + t * t * p2[axis]),
        );
    }
    let last = points.len();
    let side_end = side.range()[usize::from(way > 0.0)];
    let count = ((side_end - way * reach).abs() / 2.0).ceil().max(2.0) as usize;
    points.extend((0..=count).map(|k| side.at(lerp(way * reach, side_end, k, count)).beside(to)));
    let lengths: Vec<f64> = std::iter::once(0.0)
        .chain(points.windows(2).scan(0.0, |sum, pair| {
            *sum += (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
            Some(*sum)
        }))
        .collect();
    (Path::through(&points), [lengths[first - 1], lengths[last]])
}
