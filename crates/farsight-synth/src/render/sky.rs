//! The sky and what is mirrored of it.

use super::lanes::{Lanes, Vec3s, add, add_scaled, all, all3, dot, exp, mix, mix_colors, pow, scale, smooth_step};
use super::noise::Noise;
use crate::scene::Scene;

/// How far one looks through the fog straight up, metres.
const FOG_THICKNESS_M: f32 = 60.0;

/// Sine of the elevation up to which roofs and trees hide the sky, on average.
const SKYLINE: f32 = 0.13;

/// Colour of the sky in unit directions `d`, clouds and sun included; below the horizon it is that of the horizon.
pub(crate) fn color(scene: &Scene, d: Vec3s) -> Vec3s {
    let up = (-d[1]).fast_max(Lanes::ZERO);
    let facing = dot(d, all3(scene.sun.direction)).fast_max(Lanes::ZERO);
    let clear = add(gradient(scene, up), scale(all3(scene.sun.color), glow(scene, facing)));
    let cover = clouds(scene, d, up);
    let fog = exp(all(-scene.air.fog_density * FOG_THICKNESS_M) / (up + all(0.03)));
    mix(all3(scene.air.fog_color), mix(clear, cloud(scene, facing), cover), fog)
}

/// What a smooth surface mirrors in unit directions `d`: the sky, a line of roofs and trees, the ground.
pub(crate) fn mirrored(scene: &Scene, d: Vec3s) -> Vec3s {
    let up = -d[1];
    let sky = mix(gradient(scene, up.fast_max(Lanes::ZERO)), all3(scene.sky.cloud_color), all(0.85 * scene.sky.clouds));
    let roofs = Noise { scale: 0.35, octaves: 3, seed: scene.sky.seed };
    let roof = all(SKYLINE) + all(0.3) * roofs.at([d[0], d[2]], Lanes::ZERO);
    let below = scale(all3(scene.sky.ground), all(0.6));
    mix(below, sky, smooth_step(roof - all(0.03), roof + all(0.03), up))
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
