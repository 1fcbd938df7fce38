//! Who is under way, who is parked, and who walks.

use std::f64::consts::{FRAC_PI_2, PI};

use farsight_core::{Box3d, ObjectClass};

use super::builder::SceneBuilder;
use super::config::Place;
use super::plan::Plan;
use super::street::{Lane, LaneUse, Street};
use crate::objects::ObjectState;
use crate::region::{Participant, Region, Traffic as Group, VehicleKind};
use crate::rng::SceneRng;
use crate::sizes::SizeStatistics;

/// Vehicles keep at least this far from each other, metres.
const ROOM_M: f64 = 0.18;

/// Nothing longer is parked along a kerb, or in a bay, metres; for kinds of vehicles of regions.
const MAX_PARKED_M: f64 = 13.0;
const BAY_M: f64 = 6.3;

/// A scene whose objects have this many triangles gets no more.
const MAX_TRIANGLES: usize = 85_000;

/// Places objects; the densities are factors on the number of vehicles, and of people on foot and on bicycles.
pub(crate) struct Traffic<'a> {
    pub(crate) builder: &'a mut SceneBuilder,
    pub(crate) plan: &'a Plan,
    pub(crate) density: f64,
    pub(crate) people_density: f64,
    /// On the share of trucks, buses and trams.
    pub(crate) heavy_factor: f64,
    pub(crate) farthest_m: f64,
    pub(crate) region: Option<&'static Region>,
    pub(crate) rng: SceneRng,
}

impl Traffic<'_> {
    pub(crate) fn place_all(mut self) {
        let plan = self.plan;
        for (index, street) in plan.streets().enumerate() {
            for lane in &street.lanes {
                match lane.used_for {
                    LaneUse::Drive => self.drive(street, lane, index == 0),
                    LaneUse::ParkAlong => self.park_along(street, lane),
                    LaneUse::ParkAcross => self.park_across(street, lane),
                    LaneUse::Cycle => {}
                }
            }
        }
        if plan.place == Place::CarPark {
            self.fill_car_park();
        }
        if self.rng.chance(0.25) && matches!(plan.place, Place::Residential | Place::Suburban | Place::City) {
            self.park_on_drives();
        }
        self.cyclists();
        self.people();
    }

    /// Places what stands only: for scenes whose moving traffic is made elsewhere.
    pub(crate) fn place_standing(mut self) {
        let plan = self.plan;
        for street in plan.streets() {
            for lane in &street.lanes {
                match lane.used_for {
                    LaneUse::ParkAlong => self.park_along(street, lane),
                    LaneUse::ParkAcross => self.park_across(street, lane),
                    LaneUse::Drive | LaneUse::Cycle => {}
                }
            }
        }
        if plan.place == Place::CarPark {
            self.fill_car_park();
        }
    }

    /// Vehicles that move along a lane, or wait in it.
    fn drive(&mut self, street: &Street, lane: &Lane, is_main: bool) {
        let plan = self.plan;
        let is_queue = plan.queue && lane.direction > 0.0 && self.rng.chance(0.7);
        let gap = plan.gap / self.density.max(0.05);
        let [start, end] = street.path.range();
        let mut s = start.max(-12.0) + self.rng.range(0.0, gap.min(30.0));
        while s < end {
            let who = self.vehicle();
            let size = who.size;
            let s_middle = s + size.length / 2.0;
            let across = self.rng.normal(0.0, 0.22).clamp(-0.5, 0.5);
            let node = street.path.at(s_middle);
            let turned = if lane.direction > 0.0 { 0.0 } else { PI };
            let yaw = node.yaw() + turned + self.rng.normal(0.0, 0.02);
            let braking = is_queue || self.rng.chance(0.15);
            let lights_on = self.rng.chance(self.builder.light.lights_share);
            let state = ObjectState { lights_on, braking, moving: true, stride: None };
            if !street.is_open(s_middle) || !is_main || self.rng.chance(0.5) {
                self.try_place(who, node.beside(lane.center + across), yaw, 0.0, state);
            }
            let pause = if is_queue { self.rng.range(1.2, 5.0) } else { 3.0 + self.rng.range(0.3, 1.7) * gap };
            s += size.length + pause;
        }
    }

    /// Somebody who drives: from the region's table, or as KITTI's labels have them.
    pub(crate) fn vehicle(&mut self) -> Participant {
        let (place, heavy) = (self.plan.place, self.heavy_factor);
        let known = self
            .region
            .and_then(|region| region.vehicle(|kind| driving(kind, place) * factor(kind, heavy), &mut self.rng));
        known.unwrap_or_else(|| {
            let class = self.vehicle_class();
            Participant { size: SizeStatistics::of(&class).sample(&mut self.rng), class, kind: None }
        })
    }

    /// Something parked; of a region, none whose kind is usually longer than `most_m`.
    fn parked(&mut self, most_m: f64) -> Participant {
        let heavy = self.heavy_factor;
        let known = self.region.and_then(|region| {
            let fits = |kind: &VehicleKind| if kind.length_m[1] > most_m { 0.0 } else { 1.0 };
            region.vehicle(|kind| parking(kind) * fits(kind) * factor(kind, heavy), &mut self.rng)
        });
        known.unwrap_or_else(|| {
            let class = self.parked_class();
            Participant { size: SizeStatistics::of(&class).sample(&mut self.rng), class, kind: None }
        })
    }

    fn vehicle_class(&mut self) -> ObjectClass {
        let heavy = match self.plan.place {
            Place::Motorway => 0.14,
            Place::Residential | Place::CarPark => 0.01,
            _ => 0.05,
        };
        let tram = if self.plan.place == Place::City { 0.02 } else { 0.0 };
        let factor = self.heavy_factor;
        match self.rng.weighted(&[(0, 1.0), (1, 0.11), (2, heavy * factor), (3, tram * factor)]) {
            0 => ObjectClass::Car,
            1 => ObjectClass::Van,
            2 => ObjectClass::Truck,
            _ => ObjectClass::Tram,
        }
    }

    fn parked_class(&mut self) -> ObjectClass {
        match self.rng.weighted(&[(0, 1.0), (1, 0.11), (2, 0.008 * self.heavy_factor), (3, 0.012)]) {
            0 => ObjectClass::Car,
            1 => ObjectClass::Van,
            2 => ObjectClass::Truck,
            _ => ObjectClass::Misc,
        }
    }

    fn park_along(&mut self, street: &Street, lane: &Lane) {
        let taken = (self.plan.parked * self.density.sqrt()).min(0.97);
        let [start, end] = street.path.range();
        let mut s = start;
        while s < end {
            let who = self.parked(MAX_PARKED_M);
            let size = who.size;
            let s_middle = s + size.length / 2.0;
            if self.rng.chance(taken) && !street.is_open(s_middle) {
                let node = street.path.at(s_middle);
                let facing = if self.rng.chance(0.9) { lane.direction } else { -lane.direction };
                let turned = if facing > 0.0 { 0.0 } else { PI };
                let yaw = node.yaw() + turned + self.rng.normal(0.0, 0.03);
                let across = self.rng.normal(0.0, 0.1);
                let state = ObjectState { lights_on: self.rng.chance(0.02), ..ObjectState::default() };
                self.try_place(who, node.beside(lane.center + across), yaw, 0.0, state);
            }
            s += size.length + self.rng.range(0.5, 1.6);
        }
    }

    fn park_across(&mut self, street: &Street, lane: &Lane) {
        let angle = if self.rng.chance(0.7) { FRAC_PI_2 } else { self.rng.range(0.8, 1.4) };
        let [start, end] = street.path.range();
        let pitch = 2.6 / libm::sin(angle);
        let mut s = start;
        while s < end {
            if self.rng.chance(self.plan.parked) && !street.is_open(s) {
                let node = street.path.at(s);
                let way = if self.rng.chance(0.5) { PI } else { 0.0 };
                self.park_at(node.beside(lane.center), node.yaw() + angle * lane.direction + way);
            }
            s += pitch;
        }
    }

    fn park_at(&mut self, point: [f64; 2], yaw: f64) {
        let mut who = self.parked(BAY_M);
        who.size.length = who.size.length.min(7.0);
        let point = [point[0] + self.rng.symmetric(0.15), point[1] + self.rng.symmetric(0.3)];
        let yaw = yaw + self.rng.normal(0.0, 0.03);
        self.try_place(who, point, yaw, 0.0, ObjectState::default());
    }

    /// More rows of bays beside the aisle.
    fn fill_car_park(&mut self) {
        let main = &self.plan.main;
        for side in [-1.0, 1.0] {
            let edge = if side < 0.0 { main.edges[0] } else { main.edges[1] };
            for row in 0..self.rng.whole(0, 3) {
                let offset = edge
                    + side * (2.6 + 11.0 * f64::from((row as u32).div_ceil(2)) + 5.2 * f64::from((row % 2) as u32));
                let mut s = -10.0;
                while s < 80.0 {
                    let node = main.path.at(s);
                    if self.rng.chance(0.8 * self.plan.parked) {
                        let way = if self.rng.chance(0.5) { PI } else { 0.0 };
                        self.park_at(node.beside(offset), node.yaw() + FRAC_PI_2 + way);
                    }
                    s += 2.7;
                }
            }
        }
    }

    /// Cars in front of houses, at any angle to the street.
    fn park_on_drives(&mut self) {
        for _ in 0..self.rng.whole(1, 8) {
            let side = self.rng.whole(0, 1);
            let s = self.rng.range(5.0, 75.0);
            let offset = self.plan.main.outer(side) + self.rng.range(1.0, 7.0);
            let node = self.plan.main.path.at(s);
            let d = if side == 0 { -offset } else { offset };
            let turn = self.rng.pick(&[0.0, FRAC_PI_2, -FRAC_PI_2, PI]) + self.rng.normal(0.0, 0.1);
            let point = node.beside(d);
            if !self.plan.on_street(point, 0.5) {
                self.park_at(point, node.yaw() + turn);
            }
        }
    }

    fn cyclists(&mut self) {
        let count = whole_of(self.plan.cyclists * self.people_density, &mut self.rng);
        for _ in 0..count {
            let street = &self.plan.main;
            let s = self.rng.log_range(4.0, 60.0);
            let side = self.rng.whole(0, 1);
            let inset = self.rng.range(-1.5, 1.2);
            let sign = if side == 0 { -1.0 } else { 1.0 };
            let node = street.path.at(s);
            let turned = if self.rng.chance(0.8) == (side == 1) { 0.0 } else { PI };
            let yaw = node.yaw() + turned + self.rng.normal(0.0, 0.1);
            let d = street.edges[side] - sign * inset;
            let lift = if inset < 0.0 { street.borders[side].kerb } else { 0.0 };
            self.person(ObjectClass::Cyclist, node.beside(d), yaw, lift);
        }
    }

    fn people(&mut self) {
        let count = whole_of(self.plan.people * self.people_density, &mut self.rng);
        let street = &self.plan.main;
        for _ in 0..count {
            let s = self.rng.log_range(4.0, 50.0);
            let node = street.path.at(s);
            let side = self.rng.whole(0, 1);
            let sign = if side == 0 { -1.0 } else { 1.0 };
            let border = street.borders[side];
            if self.rng.chance(0.12) || border.pavement == 0.0 {
                // Someone crosses the road.
                let d = self.rng.range(street.edges[0], street.edges[1]);
                let way = if self.rng.chance(0.5) { FRAC_PI_2 } else { -FRAC_PI_2 };
                let yaw = node.yaw() + way + self.rng.normal(0.0, 0.3);
                self.person(ObjectClass::Pedestrian, node.beside(d), yaw, 0.0);
                continue;
            }
            let across = border.verge + self.rng.range(0.3, border.pavement.max(0.4));
            let way = if self.rng.chance(0.5) { 0.0 } else { PI };
            let yaw = node.yaw() + way + self.rng.normal(0.0, 0.35);
            for member in 0..self.rng.weighted(&[(1, 5.0), (2, 2.0), (3, 0.5)]) {
                let d = street.edges[side] + sign * (across + 0.75 * f64::from(member));
                let beside = street.path.at(s + self.rng.symmetric(0.3)).beside(d);
                let yaw = yaw + self.rng.normal(0.0, 0.1);
                let class = if self.rng.chance(0.04) { ObjectClass::PersonSitting } else { ObjectClass::Pedestrian };
                self.person(class, beside, yaw, border.kerb);
            }
        }
    }

    fn person(&mut self, class: ObjectClass, point: [f64; 2], yaw: f64, lift: f64) {
        let size = SizeStatistics::of(&class).sample(&mut self.rng);
        let state = ObjectState { moving: true, ..ObjectState::default() };
        self.try_place(Participant { class, size, kind: None }, point, yaw, lift, state);
    }

    /// Places a labelled object where it can be seen and touches nobody.
    fn try_place(&mut self, who: Participant, point: [f64; 2], yaw: f64, lift: f64, state: ObjectState) {
        let Participant { class, size, kind } = who;
        // Drawn always, so that what cannot be placed changes nothing for those after it.
        let rng = self.rng.fork();
        let y = self.builder.ground.y(point) - lift;
        let box3d =
            Box3d { dimensions: size, location: [point[0], y, point[1]], yaw: farsight_core::wrapped_angle(yaw) };
        let far = box3d.ground_distance_m() > self.farthest_m || self.builder.labelled_triangles() > MAX_TRIANGLES;
        let room = if class == ObjectClass::Pedestrian { 0.02 } else { ROOM_M };
        if far || !self.builder.view.sees(point, size.length / 2.0 + 1.0) || !self.builder.is_free(&box3d, room) {
            return;
        }
        self.builder.add_labelled(class, kind, box3d, state, rng);
    }
}

/// The factor on a kind's share of the moving traffic of a place.
fn driving(kind: &VehicleKind, place: Place) -> f64 {
    match (kind.traffic, place) {
        (Group::Heavy, Place::Motorway) => 3.0,
        (Group::Heavy, Place::Residential | Place::CarPark) => 0.12,
        (Group::Town, Place::Motorway) => 0.1,
        (Group::Town, Place::Rural | Place::CarPark) => 0.3,
        (Group::Rider, Place::Motorway) => 0.25,
        (Group::Rail, place) if place != Place::City => 0.0,
        (Group::Parked, _) => 0.0,
        _ => 1.0,
    }
}

/// The factor on a kind's share of what is parked.
fn parking(kind: &VehicleKind) -> f64 {
    match kind.traffic {
        Group::Private | Group::Parked => 1.0,
        Group::Work => 0.7,
        Group::Heavy => 0.08,
        Group::Town => 0.15,
        Group::Rail | Group::Rider => 0.0,
    }
}

/// The world file's factor on a kind.
fn factor(kind: &VehicleKind, heavy: f64) -> f64 {
    if matches!(kind.class(), ObjectClass::Truck | ObjectClass::Tram) { heavy } else { 1.0 }
}

/// A whole number whose mean is `mean`.
fn whole_of(mean: f64, rng: &mut SceneRng) -> usize {
    let drawn = mean * rng.range(0.0, 2.0);
    drawn as usize + usize::from(rng.chance(drawn.fract()))
}
