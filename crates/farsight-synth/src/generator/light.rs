//! Sun, sky and atmosphere.

use super::config::{SceneConfig, Weather};
use crate::palette::{LUMA, any_color, times};
use crate::rng::SceneRng;
use crate::scene::{Atmosphere, Canopy, Color, Sky, SkyMap, SkyPhotograph, Sun, Vec3};
use crate::vector;

/// The light of a scene.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Light {
    pub(crate) sun: Sun,
    pub(crate) sky: Sky,
    pub(crate) atmosphere: Atmosphere,
    /// Street lamps and headlights are lit.
    pub(crate) lamps_on: bool,
    /// Share of vehicles that drive with their lamps lit.
    pub(crate) lights_share: f64,
}

/// The stream of draws of light that is drawn apart; scenes, layouts and sensors have 0 to 2.
const LIGHT_STREAM: u64 = 3;

/// The stream of draws of photographed skies, so that scenes are as they would be without.
const PHOTOGRAPH_STREAM: u64 = 4;

impl Light {
    /// Draws the light of scene `index` of `seed`.
    ///
    /// Where a severity is said, it comes from a stream of its own, so that `rng` goes on as it would in other weather.
    pub(crate) fn of(
        weather: Weather,
        config: &SceneConfig,
        unusual: bool,
        [seed, index]: [u64; 2],
        rng: &mut SceneRng,
    ) -> Self {
        let mut light = if let Some(severity) = config.severity {
            let mut light = Self::sample(weather, unusual, &mut SceneRng::new(seed, index, LIGHT_STREAM));
            light.strengthen(weather, usize::from(severity.clamp(1, 5)) - 1);
            light
        } else {
            Self::sample(weather, unusual, rng)
        };
        let mut rng = SceneRng::new(seed, index, PHOTOGRAPH_STREAM);
        if rng.chance(config.photographed_sky_share) && !unusual {
            light.sky.photograph = light.photograph(weather, &mut rng);
        }
        light
    }

    /// A photographed sky that suits the weather and is about as bright as the sky that it stands for.
    fn photograph(&self, weather: Weather, rng: &mut SceneRng) -> Option<SkyPhotograph> {
        let maps: &[SkyMap] = match weather {
            Weather::Clear => &[SkyMap::Park, SkyMap::Sky, SkyMap::Sunrise, SkyMap::Forest],
            Weather::Cloudy => &[SkyMap::Sky, SkyMap::Park, SkyMap::Venice],
            Weather::Overcast | Weather::Rain | Weather::Fog => &[SkyMap::City],
            Weather::Dusk => &[SkyMap::Dawn, SkyMap::Sunset, SkyMap::Sunrise, SkyMap::Venice],
            Weather::Night => return None,
        };
        let map = rng.pick(maps);
        let [across, _, ahead] = self.sun.direction;
        let [across, _, ahead] = vector::normalized([across, 0.0, ahead]);
        let Sky { zenith, horizon, clouds, cloud_color, .. } = self.sky;
        let seen = vector::mix(vector::mix(zenith, horizon, 0.5), cloud_color, clouds);
        let gain = vector::dot(seen, LUMA) * rng.log_range(0.7, 1.4) as f32;
        Some(SkyPhotograph { map, towards_sun: [across, ahead], gain })
    }

    /// Weather and darkness in step `step` of five, from 0.
    fn strengthen(&mut self, weather: Weather, step: usize) {
        /// How far one sees in fog, metres: what is farther away has lost 98% of its contrast (Koschmieder 1924).
        const VISIBILITY_M: [f32; 5] = [500.0, 250.0, 120.0, 70.0, 40.0];
        const KOSCHMIEDER: f32 = 3.912;
        let dimmed = |light: &mut Self, by: [f32; 5]| {
            let Self { sun, sky, atmosphere, .. } = light;
            for color in
                [&mut sun.color, &mut sky.zenith, &mut sky.horizon, &mut sky.cloud_color, &mut atmosphere.fog_color]
            {
                *color = times(*color, by[step]);
            }
        };
        let share = step as f32 / 4.0;
        match weather {
            Weather::Clear | Weather::Cloudy | Weather::Overcast => {}
            Weather::Fog => self.atmosphere.fog_density = KOSCHMIEDER / VISIBILITY_M[step],
            Weather::Rain => {
                dimmed(self, [1.0, 0.9, 0.75, 0.6, 0.45]);
                self.atmosphere.wetness = 0.4 + 0.6 * share;
                self.atmosphere.rain = 0.1 + 0.8 * share;
                self.atmosphere.fog_density = KOSCHMIEDER / [2000.0, 1000.0, 600.0, 350.0, 200.0][step];
            }
            Weather::Dusk => {
                dimmed(self, [1.2, 0.8, 0.5, 0.28, 0.14]);
                self.lamps_on = step >= 2;
            }
            Weather::Night => dimmed(self, [1.6, 1.0, 0.6, 0.35, 0.2]),
        }
    }

    fn sample(weather: Weather, unusual: bool, rng: &mut SceneRng) -> Self {
        let mut light = match weather {
            Weather::Clear => clear(rng, 0.25),
            Weather::Cloudy => clear(rng, 0.65),
            Weather::Overcast => overcast(rng),
            Weather::Dusk => dusk(rng),
            Weather::Night => night(rng),
            Weather::Rain => rain(rng),
            Weather::Fog => fog(rng),
        };
        if unusual {
            light.make_unusual(rng);
        }
        light
    }

    fn make_unusual(&mut self, rng: &mut SceneRng) {
        let tint = |color: Color, rng: &mut SceneRng| {
            let other = any_color(rng);
            [0, 1, 2].map(|i| color[i] * (0.5 + other[i]))
        };
        self.sun.color = tint(self.sun.color, rng);
        self.sky.zenith = tint(self.sky.zenith, rng);
        self.sky.horizon = tint(self.sky.horizon, rng);
        self.atmosphere.fog_color = tint(self.atmosphere.fog_color, rng);
    }
}

/// A direction on the sky, by its height above the horizon.
fn toward(elevation_rad: f64, rng: &mut SceneRng) -> Vec3 {
    let around = rng.range(0.0, std::f64::consts::TAU);
    let flat = libm::cos(elevation_rad);
    [flat * libm::sin(around), -libm::sin(elevation_rad), flat * libm::cos(around)].map(|v| v as f32)
}

/// From an open field to a street under trees.
fn skyline(rng: &mut SceneRng) -> f32 {
    rng.range32(0.05, 0.7)
}

/// Trees above the road, which may not be in the picture.
fn canopy(rng: &mut SceneRng) -> Canopy {
    Canopy { open: rng.range32(0.25, 0.85), scale_m: rng.log_range(1.0, 12.0) as f32, seed: rng.seed() }
}

fn clear(rng: &mut SceneRng, most_clouds: f32) -> Light {
    let elevation = rng.range(0.17, 1.15);
    let low = 1.0 - ((elevation - 0.17) / 0.5).clamp(0.0, 1.0) as f32;
    let strength = rng.range32(1.0, 2.6);
    let haze = rng.range32(0.0, 1.0);
    let deep = rng.log_range(0.6, 2.5) as f32;
    let zenith = times([0.12 + 0.1 * haze, 0.28 + 0.12 * haze, 0.70], deep);
    let pale = rng.log_range(0.7, 4.5) as f32;
    // A sky that is white in the picture does not light the shade as much as it would seem.
    let ambient = rng.range32(0.12, 0.6) / deep.max(pale * 0.5).max(1.0);
    let horizon = times([0.62 + 0.2 * haze, 0.76 + 0.12 * haze, 0.95], pale);
    Light {
        sun: Sun {
            direction: toward(elevation, rng),
            color: times([1.0, 0.95 - 0.12 * low, 0.86 - 0.3 * low], strength),
            shadow: rng.range32(0.85, 1.0),
            canopy: rng.chance(0.4).then(|| canopy(rng)),
        },
        sky: Sky {
            zenith,
            horizon,
            ground: times([0.22, 0.2, 0.17], rng.range32(0.5, 1.5)),
            ambient,
            clouds: rng.range32(0.0, most_clouds),
            cloud_color: times([1.0, 1.0, 1.0], rng.range32(0.8, 1.5)),
            skyline: skyline(rng),
            seed: rng.seed(),
            photograph: None,
        },
        atmosphere: Atmosphere {
            fog_color: times(horizon, 0.8),
            fog_density: rng.log_range(0.0001, 0.003) as f32,
            wetness: 0.0,
            rain: 0.0,
        },
        lamps_on: false,
        lights_share: 0.12,
    }
}

fn overcast(rng: &mut SceneRng) -> Light {
    let grey = rng.range32(0.55, 1.2);
    let tint = rng.range32(0.0, 0.08);
    let horizon = [grey * (1.0 - tint), grey * (1.0 - tint / 3.0), grey];
    Light {
        sun: Sun {
            direction: toward(rng.range(0.4, 1.3), rng),
            color: times([1.0, 1.0, 1.0], rng.range32(0.0, 0.35)),
            shadow: rng.range32(0.0, 0.35),
            canopy: None,
        },
        sky: Sky {
            zenith: times(horizon, rng.range32(0.75, 1.1)),
            horizon,
            ground: [0.2, 0.19, 0.18],
            ambient: rng.range32(0.7, 1.1),
            clouds: rng.range32(0.6, 1.0),
            cloud_color: times([1.0, 1.0, 1.02], grey * rng.range32(0.7, 1.2)),
            skyline: skyline(rng),
            seed: rng.seed(),
            photograph: None,
        },
        atmosphere: Atmosphere {
            fog_color: times(horizon, 0.9),
            fog_density: rng.log_range(0.0003, 0.005) as f32,
            wetness: if rng.chance(0.2) { rng.range32(0.1, 0.6) } else { 0.0 },
            rain: 0.0,
        },
        lamps_on: false,
        lights_share: 0.25,
    }
}

fn dusk(rng: &mut SceneRng) -> Light {
    let mut light = clear(rng, 0.7);
    light.sun.direction = toward(rng.range(0.04, 0.2), rng);
    light.sun.color = times([1.0, 0.62, 0.32], rng.range32(0.4, 1.2));
    light.sky.zenith = times([0.2, 0.28, 0.5], rng.range32(0.4, 1.0));
    light.sky.horizon = times([1.0, 0.62, 0.4], rng.range32(0.4, 1.1));
    light.sky.cloud_color = times([1.0, 0.65, 0.5], rng.range32(0.4, 1.0));
    light.atmosphere.fog_color = times(light.sky.horizon, 0.7);
    light.lamps_on = rng.chance(0.4);
    light.lights_share = 0.7;
    light
}

fn night(rng: &mut SceneRng) -> Light {
    let glow = rng.range32(0.005, 0.05);
    let horizon = times([1.0, 0.75, 0.5], glow);
    Light {
        sun: Sun {
            direction: toward(rng.range(0.5, 1.3), rng),
            color: times([0.5, 0.6, 1.0], rng.range32(0.0, 0.05)),
            shadow: 0.5,
            canopy: None,
        },
        sky: Sky {
            zenith: times([0.3, 0.4, 1.0], glow * 0.3),
            horizon,
            ground: [0.02, 0.02, 0.02],
            ambient: rng.range32(1.0, 3.0),
            clouds: rng.range32(0.0, 1.0),
            cloud_color: times(horizon, 0.7),
            skyline: skyline(rng),
            seed: rng.seed(),
            photograph: None,
        },
        atmosphere: Atmosphere {
            fog_color: times(horizon, 0.6),
            fog_density: rng.log_range(0.0005, 0.008) as f32,
            wetness: if rng.chance(0.35) { rng.range32(0.3, 1.0) } else { 0.0 },
            rain: 0.0,
        },
        lamps_on: true,
        lights_share: 1.0,
    }
}

fn rain(rng: &mut SceneRng) -> Light {
    let mut light = overcast(rng);
    let dim = rng.range32(0.4, 0.9);
    for color in
        [&mut light.sky.zenith, &mut light.sky.horizon, &mut light.sky.cloud_color, &mut light.atmosphere.fog_color]
    {
        *color = times(*color, dim);
    }
    light.sun.shadow = 0.1;
    light.atmosphere.wetness = rng.range32(0.4, 1.0);
    light.atmosphere.rain = if rng.chance(0.6) { rng.range32(0.1, 0.8) } else { 0.0 };
    light.atmosphere.fog_density = rng.log_range(0.001, 0.012) as f32;
    light.lights_share = 0.8;
    light
}

fn fog(rng: &mut SceneRng) -> Light {
    let mut light = overcast(rng);
    light.atmosphere.fog_density = rng.log_range(0.006, 0.035) as f32;
    light.atmosphere.fog_color = light.sky.horizon;
    light.lights_share = 0.8;
    light.lamps_on = rng.chance(0.2);
    light
}
