//! From a place to the layout of its streets.

use super::config::Place;
use super::local;
use super::path::Path;
use super::roadside::Roadside;
use super::street::{Border, Lane, LaneUse, Markings, Street};
use super::view::View;
use crate::region::Region;
use crate::rng::SceneRng;

/// A road at right angles to the view begins so much farther to its side, metres.
const ACROSS_M: f64 = 85.0;

/// What a place looks like, besides its streets.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    pub(crate) place: Place,
    pub(crate) main: Street,
    /// Roads that meet the main one.
    pub(crate) side: Vec<Street>,
    /// Share of a parking lane that is taken.
    pub(crate) parked: f64,
    /// Mean gap between moving vehicles of a lane, metres.
    pub(crate) gap: f64,
    /// Vehicles wait in a queue.
    pub(crate) queue: bool,
    /// Mean number of people on foot, and on bicycles.
    pub(crate) people: f64,
    pub(crate) cyclists: f64,
    /// What lines the street on each side.
    pub(crate) roadside: [Roadside; 2],
}

/// What is known of the road of a real frame.
#[derive(Debug, Clone)]
pub(crate) struct RoadEstimate {
    /// Its direction, radians to the right of straight ahead.
    pub(crate) turn: f64,
    /// Its left and right edge, metres to the right of the camera.
    pub(crate) edges: [f64; 2],
    /// People on foot, and vehicles along the road.
    pub(crate) people: usize,
    pub(crate) vehicles: usize,
    /// How it bends, 1/m to the right, in each metre that the camera drives along it; straight beyond.
    pub(crate) bends: Vec<f64>,
}

/// How the carriageway of a place is divided.
pub(super) struct Lanes {
    /// Lanes of the camera's direction and of the other one.
    pub(super) own: usize,
    pub(super) oncoming: usize,
    pub(super) width: f64,
    /// Parking left and right.
    parking: [Option<LaneUse>; 2],
    cycle: bool,
    /// Grass between the directions, metres.
    pub(super) island: f64,
    /// People drive on the left.
    left_hand: bool,
}

impl Lanes {
    fn sample(place: Place, rng: &mut SceneRng) -> Self {
        let along = |share: f64, rng: &mut SceneRng| rng.chance(share).then_some(LaneUse::ParkAlong);
        match place {
            Place::City => Self {
                own: rng.weighted(&[(1, 3.0), (2, 2.0), (3, 0.6)]),
                oncoming: rng.weighted(&[(0, 0.7), (1, 3.0), (2, 1.5)]),
                width: rng.range(2.9, 3.5),
                parking: [along(0.6, rng), along(0.6, rng)],
                cycle: rng.chance(0.2),
                island: 0.0,
                left_hand: false,
            },
            Place::Residential => {
                let across = rng.chance(0.15).then_some(LaneUse::ParkAcross);
                Self {
                    own: 1,
                    oncoming: rng.weighted(&[(0, 1.2), (1, 2.0)]),
                    width: rng.range(2.6, 3.3),
                    parking: [across.or_else(|| along(0.8, rng)), along(0.8, rng)],
                    cycle: false,
                    island: 0.0,
                    left_hand: false,
                }
            }
            Place::Suburban => Self {
                own: rng.weighted(&[(1, 3.0), (2, 1.0)]),
                oncoming: rng.weighted(&[(1, 3.0), (2, 1.0)]),
                width: rng.range(3.0, 3.7),
                parking: [along(0.25, rng), along(0.3, rng)],
                cycle: rng.chance(0.25),
                island: 0.0,
                left_hand: false,
            },
            Place::Rural => Self {
                own: 1,
                oncoming: 1,
                width: rng.range(2.7, 3.7),
                parking: [None; 2],
                cycle: false,
                island: 0.0,
                left_hand: false,
            },
            Place::Motorway => Self {
                own: rng.whole(2, 4),
                oncoming: rng.whole(2, 3),
                width: rng.range(3.4, 3.75),
                parking: [None; 2],
                cycle: false,
                island: rng.range(2.0, 8.0),
                left_hand: false,
            },
            Place::CarPark => Self {
                own: 1,
                oncoming: 1,
                width: rng.range(2.7, 3.3),
                parking: [Some(LaneUse::ParkAcross), Some(LaneUse::ParkAcross)],
                cycle: false,
                island: 0.0,
                left_hand: false,
            },
        }
    }

    /// The lanes from left to right, the edges, and the offset of the camera's lane.
    fn lay(&self, own_lane: usize) -> (Vec<Lane>, [f64; 2], f64) {
        let mut strips: Vec<(LaneUse, f64, f64)> = Vec::new();
        let depth = |used_for: LaneUse| if used_for == LaneUse::ParkAlong { 2.2 } else { 5.0 };
        if let Some(used_for) = self.parking[0] {
            strips.push((used_for, depth(used_for), -1.0));
        }
        strips.extend((0..self.oncoming).map(|_| (LaneUse::Drive, self.width, -1.0)));
        let before = strips.len();
        strips.extend((0..self.own).map(|_| (LaneUse::Drive, self.width, 1.0)));
        if self.cycle {
            strips.push((LaneUse::Cycle, 1.6, 1.0));
        }
        if let Some(used_for) = self.parking[1] {
            strips.push((used_for, depth(used_for), 1.0));
        }
        let mut at = 0.0;
        let mut lanes = Vec::new();
        for (index, (used_for, width, direction)) in strips.into_iter().enumerate() {
            if index == before && self.oncoming > 0 {
                at += self.island;
            }
            lanes.push(Lane { center: at + width / 2.0, width, direction, used_for });
            at += width;
        }
        let own = lanes[before + own_lane.min(self.own - 1)].center;
        if !self.left_hand {
            return (lanes, [0.0, at], own);
        }
        lanes.reverse();
        for lane in &mut lanes {
            lane.center = -lane.center;
        }
        (lanes, [-at, 0.0], -own)
    }
}

impl Plan {
    /// Draws the plan of a place; the camera stands at the origin, its `lateral_m` beside the middle of its lane.
    ///
    /// `left_hand` is for KITTI's city: other regions are mirrored as a whole.
    pub(crate) fn sample(
        place: Place,
        view: &View,
        region: Option<&Region>,
        left_hand: bool,
        rng: &mut SceneRng,
    ) -> Self {
        let mut lanes_plan = Lanes { left_hand, ..Lanes::sample(place, rng) };
        if let Some(region) = region {
            lanes_plan = lanes_plan.localized(place, region, rng);
        }
        let own_lane = rng.whole(0, lanes_plan.own - 1);
        let (mut lanes, mut edges, own) = lanes_plan.lay(own_lane);
        let own = local::own_lane(&mut lanes, own, view, rng);
        let shift = own + view.lateral_m;
        for lane in &mut lanes {
            lane.center -= shift;
        }
        edges = edges.map(|edge| edge - shift);
        let askew = rng.normal(0.0, if place == Place::Motorway { 0.008 } else { 0.03 });
        let tightest = match place {
            Place::Motorway => 400.0,
            Place::Rural => 90.0,
            _ => 50.0,
        };
        let turn = view.road_turn();
        let yaw = -std::f64::consts::FRAC_PI_2 + askew + turn;
        // Roads that cross the view begin far to its side.
        let before = ACROSS_M * libm::sin(turn).abs();
        let range = [-16.0 - before - 0.3 * view.travel_m, 170.0 - before + view.travel_m];
        let path = Path::sample([0.0, 0.0], yaw, range, tightest, rng).renumbered(before);
        let borders = [border(place, rng), border(place, rng)];
        let markings = markings(place, rng);
        let main = Street { path, lanes, edges, borders, markings, openings: Vec::new() };
        let roadside = [Roadside::sample(place, rng), Roadside::sample(place, rng)];
        let mut plan = Self {
            place,
            main,
            side: Vec::new(),
            parked: rng.range(0.35, 1.0),
            gap: gap(place, rng),
            queue: matches!(place, Place::City | Place::Suburban) && rng.chance(0.25),
            people: people(place, rng),
            cyclists: if place == Place::Motorway { 0.0 } else { rng.range(0.0, 0.9) },
            roadside,
        };
        let crossings = match place {
            Place::City | Place::Suburban => rng.weighted(&[(0, 1.0), (1, 1.5), (2, 0.5)]),
            Place::Residential => rng.weighted(&[(0, 1.5), (1, 1.0), (2, 0.3)]),
            Place::Rural => rng.weighted(&[(0, 3.0), (1, 1.0)]),
            Place::Motorway | Place::CarPark => 0,
        };
        let mut s = rng.range(8.0, 45.0);
        for _ in 0..crossings {
            plan.add_crossing(s, left_hand, rng);
            s += rng.range(45.0, 80.0);
        }
        if let Some(region) = region {
            plan.localize(region, rng);
        }
        plan
    }

    /// A plan that fits what was found in a real frame.
    pub(crate) fn around(road: &RoadEstimate, region: Option<&Region>, rng: &mut SceneRng) -> Self {
        let people = road.people as f64;
        let place = rng.weighted(&[
            (Place::City, 0.25 + 0.3 * people),
            (Place::Residential, 0.3 + 0.05 * road.vehicles as f64),
            (Place::Suburban, 0.3),
            (Place::Rural, if people > 0.0 { 0.05 } else { 0.35 }),
        ]);
        let [left, right] = road.edges;
        let count = ((right - left) / 3.2).round().max(1.0);
        let width = (right - left) / count;
        let lane = |k: usize| {
            let center = left + width * (k as f64 + 0.5);
            let direction = if center < -width / 2.0 { -1.0 } else { 1.0 };
            Lane { center, width, direction, used_for: LaneUse::Drive }
        };
        let yaw = -std::f64::consts::FRAC_PI_2 + road.turn;
        let bend = |s: f64| if s < 0.0 { 0.0 } else { road.bends.get(s as usize).copied().unwrap_or(0.0) };
        let path = Path::new([0.0, 0.0], yaw, [-16.0, 170.0 + road.bends.len() as f64], bend);
        let borders = [border(place, rng), border(place, rng)];
        let markings = markings(place, rng);
        let lanes = (0..count as usize).map(lane).collect();
        let main = Street { path, lanes, edges: road.edges, borders, markings, openings: Vec::new() };
        let roadside = [Roadside::sample(place, rng), Roadside::sample(place, rng)];
        let mut plan = Self {
            place,
            main,
            side: Vec::new(),
            parked: 0.0,
            gap: 0.0,
            queue: false,
            people: 0.0,
            cyclists: 0.0,
            roadside,
        };
        if let Some(region) = region {
            plan.localize(region, rng);
        }
        plan
    }

    /// A road that crosses the main one at `s`.
    fn add_crossing(&mut self, s: f64, left_hand: bool, rng: &mut SceneRng) {
        let node = self.main.path.at(s);
        let turn = std::f64::consts::FRAC_PI_2 + rng.symmetric(0.25);
        let width = rng.range(2.8, 3.6);
        let count = rng.weighted(&[(1, 3.0), (2, 1.0)]);
        let lanes_plan =
            Lanes { own: count, oncoming: count, width, parking: [None; 2], cycle: false, island: 0.0, left_hand };
        let (mut lanes, edges, _) = lanes_plan.lay(0);
        let middle = f64::midpoint(edges[0], edges[1]);
        for lane in &mut lanes {
            lane.center -= middle;
        }
        let edges = edges.map(|edge| edge - middle);
        let range = [-rng.range(60.0, 110.0), rng.range(60.0, 110.0)];
        let path = Path::new(node.point, node.yaw() + turn, range, |_| 0.0);
        let borders = self.main.borders.map(|border| Border { verge: 0.0, ..border });
        let half = edges[1] / libm::cos(turn - std::f64::consts::FRAC_PI_2) + 1.5;
        self.main.openings.push([s - half, s + half]);
        let main_reach = self.main.edges.map(f64::abs).into_iter().fold(0.0, f64::max) + 2.0;
        let openings = vec![[-main_reach, main_reach]];
        self.side.push(Street { path, lanes, edges, borders, markings: self.main.markings, openings });
    }

    /// Every street.
    pub(crate) fn streets(&self) -> impl Iterator<Item = &Street> {
        std::iter::once(&self.main).chain(&self.side)
    }

    /// Whether a point lies on a street or within `margin` of one.
    pub(crate) fn on_street(&self, point: [f64; 2], margin: f64) -> bool {
        self.streets().any(|street| street.covers(point, margin))
    }
}

fn border(place: Place, rng: &mut SceneRng) -> Border {
    match place {
        Place::City => Border {
            verge: if rng.chance(0.2) { rng.range(1.0, 2.5) } else { 0.0 },
            pavement: rng.range(2.0, 5.5),
            kerb: rng.range(0.08, 0.15),
        },
        Place::Residential => Border {
            verge: if rng.chance(0.2) { rng.range(0.8, 2.0) } else { 0.0 },
            pavement: rng.range(1.2, 2.5),
            kerb: rng.range(0.03, 0.14),
        },
        Place::Suburban => {
            Border { verge: rng.range(0.0, 4.0), pavement: rng.range(1.5, 3.0), kerb: rng.range(0.06, 0.15) }
        }
        Place::Rural => Border { verge: rng.range(1.0, 5.0), pavement: 0.0, kerb: 0.02 },
        Place::Motorway => Border { verge: rng.range(1.0, 4.0), pavement: 0.0, kerb: 0.02 },
        Place::CarPark => Border { verge: rng.range(0.0, 2.0), pavement: rng.range(0.0, 2.0), kerb: 0.1 },
    }
}

fn markings(place: Place, rng: &mut SceneRng) -> Markings {
    let marked = match place {
        Place::Residential => 0.35,
        Place::CarPark => 0.3,
        _ => 0.9,
    };
    let marked = rng.chance(marked);
    let dash = rng.pick(&[[3.0, 3.0], [4.0, 8.0], [6.0, 12.0], [3.0, 6.0], [2.0, 2.0]]);
    Markings {
        dash,
        width: rng.range(0.1, 0.2),
        middle: if marked { rng.weighted(&[(1, 6.0), (2, 2.0), (3, 1.0)]) } else { 0 },
        edges: match place {
            Place::Motorway | Place::Rural => rng.chance(0.85),
            Place::CarPark => rng.chance(0.8),
            _ => rng.chance(0.25),
        },
        lanes: marked || place == Place::Motorway,
        island: false,
        shoulder: 0.0,
        stop: if marked { rng.weighted(&[(0, 1.0), (1, 2.0), (2, 1.5)]) } else { 0 },
    }
}

fn gap(place: Place, rng: &mut SceneRng) -> f64 {
    match place {
        Place::City => rng.log_range(8.0, 50.0),
        Place::Residential => rng.log_range(20.0, 120.0),
        Place::Suburban => rng.log_range(10.0, 70.0),
        Place::Rural => rng.log_range(25.0, 150.0),
        Place::Motorway => rng.log_range(14.0, 70.0),
        Place::CarPark => rng.log_range(20.0, 100.0),
    }
}

fn people(place: Place, rng: &mut SceneRng) -> f64 {
    match place {
        Place::City => rng.log_range(0.5, 8.0),
        Place::Residential | Place::Suburban | Place::CarPark => rng.range(0.0, 1.5),
        Place::Rural => rng.range(0.0, 0.3),
        Place::Motorway => 0.0,
    }
}

impl Lanes {
    /// These lanes as they are in a region.
    pub(super) fn localized(mut self, place: Place, region: &Region, rng: &mut SceneRng) -> Self {
        let [narrow, wide] = if place == Place::Motorway { region.motorway_lane_m } else { region.lane_m };
        self.width = rng.range(narrow, wide);
        let is_arterial = rng.chance(region.roads.arterial);
        let median = if rng.chance(0.5) { rng.range(1.0, 5.0) } else { 0.0 };
        if is_arterial && matches!(place, Place::City | Place::Suburban) {
            self.own = rng.whole(2, 4);
            self.oncoming = rng.whole(2, 4);
            self.island = median;
        }
        self
    }
}

impl Plan {
    /// Draws the parts of the plan that only regions have.
    pub(super) fn localize(&mut self, region: &Region, rng: &mut SceneRng) {
        self.main.markings = self.main.markings.localized(self.place, region, rng);
        let shoulder = self.main.markings.shoulder;
        self.main.edges = [self.main.edges[0] - shoulder, self.main.edges[1] + shoulder];
        self.roadside = self.roadside.map(|side| side.localized(self.place, region, rng));
    }
}
