//! The sky and what is mirrored of it.

use super::lanes::{Lanes, Vec3s, add, add_scaled, all, all3, dot, exp, mix, mix_colors, pow, scale, smooth_step};
use super::noise::Noise;
use crate::scene::Scene;
use crate::vector;

/// How far one looks through the fog straight up, metres.
const FOG_THICKNESS_M: f32 = 60.0;

/// How far away the houses and trees are that surfaces mirror, metres. The nearer they are, the more their image
/// changes from one end of a car to the other.
const SURROUNDINGS_M: f32 = 6.0;

/// Colour of the sky in unit directions `d`, clouds and sun included; below the horizon it is that of the horizon.
pub(crate) fn color(scene: &Scene, d: Vec3s) -> Vec3s {
    let up = (-d[1]).fast_max(Lanes::ZERO);
    let facing = dot(d, all3(scene.sun.direction)).fast_max(Lanes::ZERO);
    let sun = scale(all3(scene.sun.color), glow(scene, facing));
    let seen = match scene.sky.photograph {
        Some(photograph) => add(photograph.color(d), sun),
        None => mix(add(gradient(scene, up), sun), cloud(scene, facing), clouds(scene, d, up)),
    };
    let fog = exp(all(-scene.atmosphere.fog_density * FOG_THICKNESS_M) / (up + all(0.03)));
    mix(all3(scene.atmosphere.fog_color), seen, fog)
}

/// What a smooth surface at `position` mirrors in unit directions `d`: the sky, houses and trees, the ground.
pub(crate) fn mirrored(scene: &Scene, position: Vec3s, d: Vec3s) -> Vec3s {
    let sky = &scene.sky;
    let up = -d[1];
    let above = match sky.photograph {
        Some(photograph) => photograph.color(d),
        None => mix(gradient(scene, up.fast_max(Lanes::ZERO)), all3(sky.cloud_color), all(0.85 * sky.clouds)),
    };
    let towards = add_scaled(d, position, all(1.0 / SURROUNDINGS_M));
    let roofs = Noise { scale: 0.35, octaves: 4, seed: sky.seed }.at([towards[0], towards[2]], Lanes::ZERO);
    let roof = all(sky.skyline) + all(0.9) * roofs;
    let ground = scale(all3(sky.ground), all(0.6));
    let below = mix(ground, fronts(scene, towards), smooth_step(all(-0.05), all(0.02), up));
    mix(below, above, smooth_step(roof - all(0.03), roof + all(0.03), up))
}

/// Houses and trees beside the road, some of them in the sun and others in the shade.
fn fronts(scene: &Scene, towards: Vec3s) -> Vec3s {
    let [ground, sun] = [scene.sky.ground, scene.sun.color];
    let around = [towards[0] + towards[2], towards[1] * all(2.0)];
    let noise = Noise { scale: 0.25, octaves: 3, seed: !scene.sky.seed }.at(around, Lanes::ZERO);
    let lit = add(scale(all3(ground), all(0.7)), all3(vector::scale(sun, 0.2 * scene.sun.shadow)));
    let dark = all3(vector::scale(ground, 0.2));
    mix(dark, lit, smooth_step(all(-0.05), all(0.2), noise))
}

fn gradient(scene: &Scene, up: Lanes) -> Vec3s {
    let rise = all(1.0) - up;
    mix_colors(scene.sky.zenith, scene.sky.horizon, rise * rise * rise)
}

/// Light around the sun, and its disc. A covered sun casts no shadows and has neither.
fn glow(scene: &Scene, facing: Lanes) -> Lanes {
    if scene.sun.shadow <= 0.0 {
        return Lanes::ZERO;
    }
    let disc = smooth_step(all(0.9997), all(0.9999), facing) * all(12.0);
    let halo = all(0.25) * pow(facing, all(40.0)) + all(0.08) * pow(facing, all(6.0));
    (disc + halo) * all(scene.sun.shadow)
}

/// Share of cloud in a direction.
fn clouds(scene: &Scene, d: Vec3s, up: Lanes) -> Lanes {
    let share = scene.sky.clouds;
    if share <= 0.0 {
        return Lanes::ZERO;
    }
    // Clouds on a plane of unit height, bent down a little towards the horizon.
    let over = all(1.0) / (up + all(0.12));
    let noise = Noise { scale: 1.1, octaves: 5, seed: scene.sky.seed };
    let value = noise.at([d[0] * over, d[2] * over * all(1.6)], all(0.004) * over * over);
    let level = Noise::quantile(1.0 - share);
    smooth_step(all(level - 0.08), all(level + 0.08), value)
}

fn cloud(scene: &Scene, facing: Lanes) -> Vec3s {
    let square = facing * facing;
    let lit = square * square * all(0.12 * scene.sun.shadow);
    add_scaled(all3(scene.sky.cloud_color), all3(scene.sun.color), lit)
}
