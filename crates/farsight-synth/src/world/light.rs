//! Sun, sky and air.

use super::config::Weather;
use crate::dice::Dice;
use crate::palette::{any_color, times};
use crate::scene::{Air, Canopy, Color, Sky, Sun, Vec3};

/// The light of a scene.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Light {
    pub(crate) sun: Sun,
    pub(crate) sky: Sky,
    pub(crate) air: Air,
    /// Street lamps and headlights are lit.
    pub(crate) lamps_on: bool,
    /// Share of vehicles that drive with their lamps lit.
    pub(crate) lights_share: f64,
}

impl Light {
    pub(crate) fn draw(weather: Weather, unusual: bool, dice: &mut Dice) -> Self {
        let mut light = match weather {
            Weather::Clear => clear(dice, 0.25),
            Weather::Cloudy => clear(dice, 0.65),
            Weather::Overcast => overcast(dice),
            Weather::Dusk => dusk(dice),
            Weather::Night => night(dice),
            Weather::Rain => rain(dice),
            Weather::Fog => fog(dice),
        };
        if unusual {
            light.make_unusual(dice);
        }
        light
    }

    fn make_unusual(&mut self, dice: &mut Dice) {
        let tint = |color: Color, dice: &mut Dice| {
            let other = any_color(dice);
            [0, 1, 2].map(|i| color[i] * (0.5 + other[i]))
        };
        self.sun.color = tint(self.sun.color, dice);
        self.sky.zenith = tint(self.sky.zenith, dice);
        self.sky.horizon = tint(self.sky.horizon, dice);
        self.air.fog_color = tint(self.air.fog_color, dice);
    }
}

/// A direction on the sky, by its height above the horizon.
fn toward(elevation_rad: f64, dice: &mut Dice) -> Vec3 {
    let around = dice.range(0.0, std::f64::consts::TAU);
    let flat = libm::cos(elevation_rad);
    [flat * libm::sin(around), -libm::sin(elevation_rad), flat * libm::cos(around)].map(|v| v as f32)
}

/// From an open field to a street under trees.
fn skyline(dice: &mut Dice) -> f32 {
    dice.range32(0.05, 0.7)
}

/// Trees above the road, which may not be in the picture.
fn canopy(dice: &mut Dice) -> Canopy {
    Canopy { open: dice.range32(0.25, 0.85), scale_m: dice.log_range(1.0, 12.0) as f32, seed: dice.seed() }
}

fn clear(dice: &mut Dice, most_clouds: f32) -> Light {
    let elevation = dice.range(0.17, 1.15);
    let low = 1.0 - ((elevation - 0.17) / 0.5).clamp(0.0, 1.0) as f32;
    let strength = dice.range32(1.0, 2.6);
    let haze = dice.range32(0.0, 1.0);
    let deep = dice.log_range(0.6, 2.5) as f32;
    let zenith = times([0.12 + 0.1 * haze, 0.28 + 0.12 * haze, 0.70], deep);
    let pale = dice.log_range(0.7, 4.5) as f32;
    // A sky that is white in the picture does not light the shade as much as it would seem.
    let ambient = dice.range32(0.12, 0.6) / deep.max(pale * 0.5).max(1.0);
    let horizon = times([0.62 + 0.2 * haze, 0.76 + 0.12 * haze, 0.95], pale);
    Light {
        sun: Sun {
            direction: toward(elevation, dice),
            color: times([1.0, 0.95 - 0.12 * low, 0.86 - 0.3 * low], strength),
            shadow: dice.range32(0.85, 1.0),
            canopy: dice.chance(0.4).then(|| canopy(dice)),
        },
        sky: Sky {
            zenith,
            horizon,
            ground: times([0.22, 0.2, 0.17], dice.range32(0.5, 1.5)),
            ambient,
            clouds: dice.range32(0.0, most_clouds),
            cloud_color: times([1.0, 1.0, 1.0], dice.range32(0.8, 1.5)),
            skyline: skyline(dice),
            seed: dice.seed(),
        },
        air: Air {
            fog_color: times(horizon, 0.8),
            fog_density: dice.log_range(0.0001, 0.003) as f32,
            wetness: 0.0,
            rain: 0.0,
        },
        lamps_on: false,
        lights_share: 0.12,
    }
}

fn overcast(dice: &mut Dice) -> Light {
    let grey = dice.range32(0.55, 1.2);
    let tint = dice.range32(0.0, 0.08);
    let horizon = [grey * (1.0 - tint), grey * (1.0 - tint / 3.0), grey];
    Light {
        sun: Sun {
            direction: toward(dice.range(0.4, 1.3), dice),
            color: times([1.0, 1.0, 1.0], dice.range32(0.0, 0.35)),
            shadow: dice.range32(0.0, 0.35),
            canopy: None,
        },
        sky: Sky {
            zenith: times(horizon, dice.range32(0.75, 1.1)),
            horizon,
            ground: [0.2, 0.19, 0.18],
            ambient: dice.range32(0.7, 1.1),
            clouds: dice.range32(0.6, 1.0),
            cloud_color: times([1.0, 1.0, 1.02], grey * dice.range32(0.7, 1.2)),
            skyline: skyline(dice),
            seed: dice.seed(),
        },
        air: Air {
            fog_color: times(horizon, 0.9),
            fog_density: dice.log_range(0.0003, 0.005) as f32,
            wetness: if dice.chance(0.2) { dice.range32(0.1, 0.6) } else { 0.0 },
            rain: 0.0,
        },
        lamps_on: false,
        lights_share: 0.25,
    }
}

fn dusk(dice: &mut Dice) -> Light {
    let mut light = clear(dice, 0.7);
    light.sun.direction = toward(dice.range(0.04, 0.2), dice);
    light.sun.color = times([1.0, 0.62, 0.32], dice.range32(0.4, 1.2));
    light.sky.zenith = times([0.2, 0.28, 0.5], dice.range32(0.4, 1.0));
    light.sky.horizon = times([1.0, 0.62, 0.4], dice.range32(0.4, 1.1));
    light.sky.cloud_color = times([1.0, 0.65, 0.5], dice.range32(0.4, 1.0));
    light.air.fog_color = times(light.sky.horizon, 0.7);
    light.lamps_on = dice.chance(0.4);
    light.lights_share = 0.7;
    light
}

fn night(dice: &mut Dice) -> Light {
    let glow = dice.range32(0.005, 0.05);
    let horizon = times([1.0, 0.75, 0.5], glow);
    Light {
        sun: Sun {
            direction: toward(dice.range(0.5, 1.3), dice),
            color: times([0.5, 0.6, 1.0], dice.range32(0.0, 0.05)),
            shadow: 0.5,
            canopy: None,
        },
        sky: Sky {
            zenith: times([0.3, 0.4, 1.0], glow * 0.3),
            horizon,
            ground: [0.02, 0.02, 0.02],
            ambient: dice.range32(1.0, 3.0),
            clouds: dice.range32(0.0, 1.0),
            cloud_color: times(horizon, 0.7),
            skyline: skyline(dice),
            seed: dice.seed(),
        },
        air: Air {
            fog_color: times(horizon, 0.6),
            fog_density: dice.log_range(0.0005, 0.008) as f32,
            wetness: if dice.chance(0.35) { dice.range32(0.3, 1.0) } else { 0.0 },
            rain: 0.0,
        },
        lamps_on: true,
        lights_share: 1.0,
    }
}

fn rain(dice: &mut Dice) -> Light {
    let mut light = overcast(dice);
    let dim = dice.range32(0.4, 0.9);
    for color in [&mut light.sky.zenith, &mut light.sky.horizon, &mut light.sky.cloud_color, &mut light.air.fog_color] {
        *color = times(*color, dim);
    }
    light.sun.shadow = 0.1;
    light.air.wetness = dice.range32(0.4, 1.0);
    light.air.rain = if dice.chance(0.6) { dice.range32(0.1, 0.8) } else { 0.0 };
    light.air.fog_density = dice.log_range(0.001, 0.012) as f32;
    light.lights_share = 0.8;
    light
}

fn fog(dice: &mut Dice) -> Light {
    let mut light = overcast(dice);
    light.air.fog_density = dice.log_range(0.006, 0.035) as f32;
    light.air.fog_color = light.sky.horizon;
    light.lights_share = 0.8;
    light.lamps_on = dice.chance(0.2);
    light
}
