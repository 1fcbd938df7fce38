//! The light that surfaces send to the camera, at four places of one material at once.

use super::lamps::LitColumns;
use super::lanes::{
    Lanes, Vec3s, add, add_scaled, all, all3, choose, clamp, dot, exp, mix, mix_colors, multiply, normalized, pow,
    scale, smooth_step, sub,
};
use super::noise::Noise;
use super::pattern::{self, Footprint, Look};
use super::shadow::Shadows;
use super::sky;
use crate::scene::{Canopy, Color, Lamp, Material, Scene, Sun, Vec3};
use crate::vector;

/// Half the width of the edge of a patch of sun, in units of the noise that draws it.
const PENUMBRA: f32 = 0.03;

/// Pieces of surface as seen through four pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fragments {
    /// Where.
    pub(crate) position: Vec3s,
    /// Normals, of any length and on either side.
    pub(crate) normal: Vec3s,
    /// Coordinates of the pattern.
    pub(crate) uv: [Lanes; 2],
    /// How much of the pattern the pixels cover.
    pub(crate) footprint: Footprint,
    /// First and last column of the pixels.
    pub(crate) columns: [u32; 2],
}

/// What lights the pixels of a row.
#[derive(Clone, Copy)]
pub(crate) struct Light<'a> {
    /// The sun, the sky and the atmosphere.
    pub(crate) scene: &'a Scene,
    /// What hides sun and sky.
    pub(crate) shadows: &'a Shadows,
    /// Lamps that may reach the row.
    pub(crate) lamps: &'a [LitColumns<'a>],
    /// Light from above and from below.
    pub(crate) ambient: [Color; 2],
    /// Where the camera is.
    pub(crate) eye: Vec3,
}

/// Surfaces on their way to a colour.
struct Surface {
    position: Vec3s,
    /// Unit normal on the viewer's side.
    normal: Vec3s,
    /// Unit direction from the eye.
    ray: Vec3s,
    specular: Lanes,
    shininess: f32,
}

/// Light collected on surfaces.
struct Lit {
    /// Scattered in all directions, before the surface's colour.
    scattered: Vec3s,
    /// Highlights.
    highlight: Vec3s,
}

/// Colours that the eye sees of fragments of one material, through the atmosphere.
pub(crate) fn color(light: &Light, material: &Material, fragments: &Fragments) -> Vec3s {
    let scene = light.scene;
    let ray = sub(fragments.position, all3(light.eye));
    let distance_m = dot(ray, ray).sqrt();
    let ray = scale(ray, all(1.0) / distance_m);
    let normal = normalized(fragments.normal);
    let away = dot(normal, ray);
    let normal = scale(normal, choose(away.simd_gt(Lanes::ZERO), all(-1.0), all(1.0)));

    let look = pattern::look(material, fragments.uv, fragments.footprint);
    let wet = scene.atmosphere.wetness > 0.0;
    let water = if wet { water(scene, fragments.position, normal) } else { Lanes::ZERO };
    let specular = (all(material.specular) * look.shine).fast_max(all(0.5) * water);
    let shininess = if wet { material.shininess.max(40.0) } else { material.shininess };
    let surface = Surface { position: fragments.position, normal, ray, specular, shininess };

    let skylight = light.shadows.skylight(surface.position, normal);
    let lit = lit(light, &surface, skylight, fragments.columns);
    let mut seen = multiply(scale(look.color, all(1.0) - all(0.45) * water), lit.scattered);
    seen = add(seen, lit.highlight);
    if material.reflectivity > 0.0 || wet {
        seen = mirroring(scene, material, &surface, &look, water, skylight, seen);
    }
    let left = exp(distance_m * all(-scene.atmosphere.fog_density));
    mix(all3(scene.atmosphere.fog_color), add(seen, look.emission), left)
}

/// How wet the places are, 0 to 1: flat surfaces, with puddles and drier patches.
fn water(scene: &Scene, position: Vec3s, normal: Vec3s) -> Lanes {
    let level = smooth_step(all(0.7), all(0.95), -normal[1]);
    if level.simd_gt(Lanes::ZERO).to_bitmask() == 0 {
        return level;
    }
    let patches = Noise { scale: 3.0, octaves: 3, seed: 0x7a7e_0001 }.at([position[0], position[2]], Lanes::ZERO);
    level * clamp(all(scene.atmosphere.wetness) * (all(1.0) + all(1.4) * patches), 0.0, 1.0)
}

/// `seen` with the mirror image over it: paint, glass, water.
fn mirroring(
    scene: &Scene,
    material: &Material,
    surface: &Surface,
    look: &Look,
    water: Lanes,
    skylight: Lanes,
    seen: Vec3s,
) -> Vec3s {
    let clear = if material.reflectivity > 0.0 { look.shine } else { Lanes::ZERO };
    let clear = clear.fast_max(all(0.85) * water);
    if clear.simd_gt(Lanes::ZERO).to_bitmask() == 0 {
        return seen;
    }
    let facing = -dot(surface.ray, surface.normal);
    let straight = (all(material.reflectivity) * look.shine).fast_max(all(0.02) * water);
    // Schlick's approximation: everything mirrors at a grazing angle.
    let rest = all(1.0) - clamp(facing, 0.0, 1.0);
    let square = rest * rest;
    let share = clear * (straight + (all(1.0) - straight) * square * square * rest);
    let back = add_scaled(surface.ray, surface.normal, all(2.0) * facing);
    let image = sky::mirrored(scene, surface.position, back);
    // Beside and under things the surroundings are dark too.
    mix(seen, scale(image, all(0.35) + all(0.65) * skylight), share)
}

fn lit(light: &Light, surface: &Surface, skylight: Lanes, columns: [u32; 2]) -> Lit {
    let [above, below] = light.ambient;
    let upward = all(0.5) - all(0.5) * surface.normal[1];
    let mut lit = Lit { scattered: scale(mix_colors(below, above, upward), skylight), highlight: all3([0.0; 3]) };
    let sun = &light.scene.sun;
    let facing = dot(surface.normal, all3(sun.direction));
    let lit_lanes = facing.simd_gt(Lanes::ZERO).to_bitmask();
    if lit_lanes != 0 {
        let reaching = light.shadows.sunlight(surface.position, surface.normal, lit_lanes);
        let reaching = reaching * through_canopy(sun, surface.position);
        lit.take(surface, all3(sun.direction), scale(all3(sun.color), reaching));
    }
    for lamp in light.lamps.iter().filter(|lamp| lamp.may_light(columns)) {
        lit.take_lamp(surface, lamp.lamp);
    }
    lit
}

/// Share of the sun's light that the leaves above let through to these places.
fn through_canopy(sun: &Sun, position: Vec3s) -> Lanes {
    let Some(Canopy { open, scale_m, seed }) = sun.canopy else { return Lanes::ONE };
    let [x, y, z] = sun.direction;
    // Along the sun's rays to the level of the eye; a low sun draws the patches out.
    let steep = y.min(-0.05);
    let place = [position[0] - position[1] * all(x / steep), position[2] - position[1] * all(z / steep)];
    let noise = Noise { scale: scale_m, octaves: 4, seed }.at(place, Lanes::ZERO);
    let level = all(Noise::quantile(open));
    let edge = all(PENUMBRA);
    let dark = smooth_step(level - edge, level + edge, noise);
    Lanes::ONE - dark * all(sun.shadow)
}

impl Lit {
    /// Adds light that arrives from unit directions `towards`.
    fn take(&mut self, surface: &Surface, towards: Vec3s, arriving: Vec3s) {
        let facing = dot(surface.normal, towards).fast_max(Lanes::ZERO);
        self.scattered = add_scaled(self.scattered, arriving, facing);
        if surface.specular.simd_gt(Lanes::ZERO).to_bitmask() != 0 {
            let half = normalized(sub(towards, surface.ray));
            let highlight = surface.specular * pow(dot(half, surface.normal), all(surface.shininess));
            let shown = facing.simd_gt(Lanes::ZERO) & highlight;
            self.highlight = add_scaled(self.highlight, arriving, shown);
        }
    }

    /// Adds the light of a lamp.
    fn take_lamp(&mut self, surface: &Surface, lamp: &Lamp) {
        let towards = sub(all3(lamp.position), surface.position);
        let square = dot(towards, towards);
        let nearness = (all(1.0) - square * all(1.0 / (lamp.reach_m * lamp.reach_m))).fast_max(Lanes::ZERO);
        let towards = scale(towards, all(1.0) / square.fast_max(all(1e-6)).sqrt());
        let mut strength = nearness * nearness / (square + all(0.05));
        if lamp.cone_cos > -1.0 {
            let off_axis = -dot(towards, all3(lamp.direction));
            let inner = lamp.cone_cos + 0.4 * (1.0 - lamp.cone_cos);
            strength *= smooth_step(all(lamp.cone_cos), all(inner), off_axis);
        }
        if strength.simd_gt(Lanes::ZERO).to_bitmask() != 0 {
            self.take(surface, towards, scale(all3(lamp.color), strength));
        }
    }
}

/// Light on a surface that faces the sky, and on one that faces the ground.
pub(crate) fn ambient(scene: &Scene) -> [Color; 2] {
    let sky = &scene.sky;
    let clear = vector::mix(sky.zenith, sky.horizon, 0.5);
    let above = vector::mix(clear, sky.cloud_color, 0.7 * sky.clouds);
    [vector::scale(above, sky.ambient), vector::scale(sky.ground, sky.ambient)]
}
