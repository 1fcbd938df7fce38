//! The sky and what is mirrored of it.

use super::noise::Noise;
use crate::scene::{Color, Scene, Vec3};
use crate::vector::{add, dot, exp, mix, pow, scale, smooth_step};

/// Colour of the sky in unit direction `d`, clouds and sun included; below the horizon it is that of the horizon.
pub(crate) fn color(scene: &Scene, d: Vec3) -> Color {
    let up = (-d[1]).max(0.0);
    let clear = add(gradient(scene, up), sun_glow(scene, d));
    let cover = clouds(scene, d, up);
    let fog = exp(-scene.air.fog_density * FOG_THICKNESS_M / (up + 0.03));
    mix(scene.air.fog_color, mix(clear, cloud(scene, d), cover), fog)
}

/// What a smooth surface mirrors in unit direction `d`: the sky, a line of roofs and trees, the ground.
pub(crate) fn mirrored(scene: &Scene, d: Vec3) -> Color {
    let up = -d[1];
    let cover = 0.85 * scene.sky.clouds;
    let sky = mix(gradient(scene, up.max(0.0)), scene.sky.cloud_color, cover);
    let roofs = Noise { scale: 0.35, octaves: 3, seed: scene.sky.seed };
    let roof = SKYLINE + 0.3 * roofs.at([d[0], d[2]], 0.0);
    let below = scale(scene.sky.ground, 0.6);
    mix(below, sky, smooth_step(roof - 0.03, roof + 0.03, up))
}

/// Sine of the elevation up to which roofs and trees hide the sky, on average.
const SKYLINE: f32 = 0.13;

/// How far one looks through the fog straight up, metres.
const FOG_THICKNESS_M: f32 = 60.0;

fn gradient(scene: &Scene, up: f32) -> Color {
    let rise = 1.0 - up;
    mix(scene.sky.zenith, scene.sky.horizon, rise * rise * rise)
}

fn sun_glow(scene: &Scene, d: Vec3) -> Color {
    let facing = dot(d, scene.sun.direction).max(0.0);
    let disc = smooth_step(0.9997, 0.9999, facing) * 12.0;
    let glow = 0.25 * pow(facing, 40.0) + 0.08 * pow(facing, 6.0);
    // A covered sun casts no shadows and has no disc.
    scale(scene.sun.color, (disc + glow) * scene.sun.shadow)
}

/// Share of cloud in a direction.
fn clouds(scene: &Scene, d: Vec3, up: f32) -> f32 {
    let share = scene.sky.clouds;
    if share <= 0.0 || up <= 0.0 {
        return 0.0;
    }
    // Clouds on a plane of unit height, bent down a little towards the horizon.
    let over = 1.0 / (up + 0.12);
    let noise = Noise { scale: 1.1, octaves: 5, seed: scene.sky.seed };
    let value = noise.at([d[0] * over, d[2] * over * 1.6], 0.004 * over * over);
    let level = Noise::quantile(1.0 - share);
    smooth_step(level - 0.08, level + 0.08, value)
}

fn cloud(scene: &Scene, d: Vec3) -> Color {
    let facing = dot(d, scene.sun.direction).max(0.0);
    let lit = scale(scene.sun.color, 0.12 * pow(facing, 4.0) * scene.sun.shadow);
    add(scene.sky.cloud_color, lit)
}
