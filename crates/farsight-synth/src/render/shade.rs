//! The light that a surface sends to the camera.

use super::pattern::{self, Footprint};
use crate::scene::{Color, Material, Scene, Vec3};
use crate::vector::{add, add_scaled, dot, exp, length, mix, multiply, scale, sub};

/// A piece of surface as seen through one pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fragment<'a> {
    /// Where.
    pub(crate) position: Vec3,
    /// Unit normal, on the viewer's side.
    pub(crate) normal: Vec3,
    /// Coordinates of the pattern.
    pub(crate) uv: [f32; 2],
    /// How much of the pattern the pixel covers.
    pub(crate) footprint: Footprint,
    /// What it is made of.
    pub(crate) material: &'a Material,
}

/// Colour that the eye sees of a fragment, through the air.
pub(crate) fn color(scene: &Scene, eye: Vec3, fragment: &Fragment) -> Color {
    let look = pattern::look(fragment.material, fragment.uv, fragment.footprint);
    let facing = dot(fragment.normal, scene.sun.direction).max(0.0);
    let light = add_scaled(ambient(scene, fragment.normal), scene.sun.color, facing);
    let seen = add(multiply(look.color, light), look.emission);
    through_air(scene, seen, length(sub(fragment.position, eye)))
}

/// Light of the sky and from the ground on a surface.
fn ambient(scene: &Scene, normal: Vec3) -> Color {
    let sky = mix(scene.sky.zenith, scene.sky.horizon, 0.5);
    scale(mix(scene.sky.ground, sky, 0.5 - 0.5 * normal[1]), scene.sky.ambient)
}

/// What is left of a colour after `distance_m` of air.
fn through_air(scene: &Scene, color: Color, distance_m: f32) -> Color {
    mix(scene.air.fog_color, color, exp(-scene.air.fog_density * distance_m))
}
