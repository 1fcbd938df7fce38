//! Somebody who moves along a path.

use farsight_core::Box3d;

use super::{heading, yaw_from_heading};
use crate::generator::ground::Ground;
use crate::generator::path::Path;
use crate::region::Participant;

/// Over so long a time velocities are differences of places, seconds.
const INSTANT_S: f64 = 1e-4;

/// Who stands has the heading of who goes so fast, m/s.
const SLOW_MPS: f64 = 1.0;

/// A change from lane to lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Change {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) begin_s: f64,
    pub(super) duration_s: f64,
}

/// A time at which somebody brakes, and down to which speed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Braking {
    pub(super) begin_s: f64,
    pub(super) end_s: f64,
    pub(super) deceleration_mps2: f64,
    pub(super) speed_mps: f64,
}

/// What somebody does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Role {
    /// Drives along the main road, in its lanes.
    Drive,
    /// Drives along a path of its own, whose bend begins and ends at these places of it.
    Turn { bend: [f64; 2] },
    /// Goes or rides at its own speed from this time on.
    Walk { begin_s: f64 },
}

/// Somebody, and where they are now.
pub(super) struct Mover {
    pub(super) who: Participant,
    pub(super) role: Role,
    /// The line on which `s` and `d` are; 1 along it, -1 against it.
    pub(super) path: Path,
    pub(super) way: f64,
    pub(super) s: f64,
    pub(super) speed: f64,
    pub(super) acceleration: f64,
    /// The speed that they would like, m/s.
    pub(super) desired: f64,
    /// The offset of their lane from the path.
    pub(super) lane: f64,
    pub(super) change: Option<Change>,
    pub(super) braking: Option<Braking>,
    /// Moves into the camera's lane from this time on, if there is room.
    pub(super) cuts_in_s: Option<f64>,
    /// Height above the road.
    pub(super) lift: f64,
    /// How they sway in their lane: amplitude, metres, frequency and phase, radians.
    pub(super) sway: [f64; 3],
    pub(super) lights_on: bool,
}

/// Somebody at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    /// In the street's coordinates.
    pub(super) box3d: Box3d,
    /// Over the ground, x and z, m/s.
    pub(super) velocity: [f64; 2],
    pub(super) is_braking: bool,
    /// How far they have gone, metres.
    pub(super) gone_m: f64,
}

impl Mover {
    /// The offset from the path at a time.
    pub(super) fn offset(&self, time_s: f64) -> f64 {
        let lane = self.change.map_or(self.lane, |Change { from, to, begin_s, duration_s }| {
            let share = ((time_s - begin_s) / duration_s).clamp(0.0, 1.0);
            // Its third derivative is small, as drivers steer.
            from + (to - from) * share * share * share * (10.0 - 15.0 * share + 6.0 * share * share)
        });
        let [amplitude, frequency, phase] = self.sway;
        lane + amplitude * libm::sin(frequency * time_s + phase)
    }

    /// Whether they are on their path now.
    pub(super) fn is_there(&self) -> bool {
        let [start, end] = self.path.range();
        self.s > start + 1.0 && self.s < end - 1.0
    }

    fn place(&self, s: f64, time_s: f64) -> [f64; 2] {
        self.path.at(s).beside(self.offset(time_s))
    }

    /// Their velocity over the ground, x and z, m/s.
    fn velocity(&self, time_s: f64) -> [f64; 2] {
        let ahead = self.way * self.speed * INSTANT_S;
        let [before, after] =
            [-1.0, 1.0].map(|sign| self.place(self.s + sign * ahead, time_s + sign * self.sway_time() * INSTANT_S));
        [0, 1].map(|axis| (after[axis] - before[axis]) / (2.0 * INSTANT_S))
    }

    /// Who stands does not sway, and changes no lane.
    fn sway_time(&self) -> f64 {
        (self.speed / SLOW_MPS).min(1.0)
    }

    /// Where they are and how they move.
    pub(super) fn moment(&self, time_s: f64, start_s: f64, ground: &Ground) -> Moment {
        let point = self.place(self.s, time_s);
        let velocity = self.velocity(time_s);
        let direction = self.path.at(self.s).direction.map(|part| part * self.way);
        // The slower, the less the wheels' direction says.
        let forward = (velocity[0] * direction[0] + velocity[1] * direction[1]).max(SLOW_MPS);
        let aside = velocity[0] * direction[1] - velocity[1] * direction[0];
        let yaw = yaw_from_heading(heading(direction) + libm::atan2(aside, forward));
        let y = ground.y(point) - self.lift;
        let box3d = Box3d { dimensions: self.who.size, location: [point[0], y, point[1]], yaw };
        Moment {
            box3d,
            velocity,
            is_braking: self.acceleration < -BRAKE_LAMPS_MPS2 || (self.speed < 0.3 && self.role == Role::Drive),
            gone_m: (self.s - start_s).abs(),
        }
    }
}

/// Brake lamps are lit from this deceleration on, m/s².
const BRAKE_LAMPS_MPS2: f64 = 0.8;
