//! A street in which everything is known, and a camera whose detector errs as it is told to.

use farsight_core::{Box2d, Box3d, Camera, Detection, Dimensions, ObjectClass};
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

pub(crate) const IMAGE_SIZE: [usize; 2] = [1280, 720];

pub(crate) fn camera() -> Camera {
    // Boxes are clipped to 0 and the width, so this is the middle of a mirrored image.
    Camera::from_intrinsics(1000.0, 1000.0, 640.0, 360.0).unwrap()
}

/// A car on the ground.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Car {
    pub(crate) place: [f64; 2],
    pub(crate) velocity: [f64; 2],
    pub(crate) size: Dimensions,
}

impl Car {
    pub(crate) fn new(place: [f64; 2], velocity: [f64; 2]) -> Self {
        Self { place, velocity, size: Dimensions { height: 1.5, width: 1.7, length: 4.2 } }
    }

    /// After so many seconds.
    pub(crate) fn after(&self, dt_s: f64) -> Self {
        let place = [0, 1].map(|axis| self.place[axis] + self.velocity[axis] * dt_s);
        Self { place, ..*self }
    }

    pub(crate) fn box3d(&self) -> Box3d {
        let [x, z] = self.place;
        Box3d { dimensions: self.size, location: [x, 1.6, z], yaw: -std::f64::consts::FRAC_PI_2 }
    }

    /// Depth of its nearest face.
    pub(crate) fn near_m(&self) -> f64 {
        self.place[1] - self.size.length / 2.0
    }

    /// What a detector says that takes it to be `factor` times as far away, give or take `sigma`, and `growth` times as
    /// high in the image.
    pub(crate) fn seen(&self, factor: f64, sigma: f64, growth: f64) -> Detection {
        let told = self.box3d().scaled(factor);
        let seen = self.box3d().projected(&camera()).unwrap();
        let middle = f64::midpoint(seen.y1, seen.y2);
        let half = growth * seen.height() / 2.0;
        let box2d = Box2d { y1: middle - half, y2: middle + half, ..seen };
        let range_sigma_m = Some(sigma * told.depth_m());
        Detection { class: ObjectClass::Car, score: 0.9, box2d, box3d: told, range_sigma_m }
    }
}

/// Random numbers that are the same for the same seed.
pub(crate) struct Chance(Pcg64Mcg);

impl Chance {
    pub(crate) fn new(seed: u64) -> Self {
        Self(Pcg64Mcg::seed_from_u64(seed))
    }

    pub(crate) fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    pub(crate) fn between(&mut self, least: f64, most: f64) -> f64 {
        let share = f64::from(self.0.next_u32()) / f64::from(u32::MAX);
        least + share * (most - least)
    }
}

/// An error that lasts: it has this standard deviation, and is another after `time_s` seconds.
pub(crate) struct Lasting {
    sigma: f64,
    time_s: f64,
    value: f64,
}

impl Lasting {
    pub(crate) fn new(sigma: f64, time_s: f64, chance: &mut Chance) -> Self {
        Self { sigma, time_s, value: sigma * chance.normal() }
    }

    pub(crate) fn after(&mut self, dt_s: f64, chance: &mut Chance) -> f64 {
        let left = (-dt_s / self.time_s).exp();
        self.value = left * self.value + self.sigma * (1.0 - left * left).sqrt() * chance.normal();
        self.value
    }
}
