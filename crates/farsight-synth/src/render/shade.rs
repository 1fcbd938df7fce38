//! The light that a surface sends to the camera.

use super::noise::Noise;
use super::pattern::{self, Footprint, Look};
use super::shadow::Shadows;
use super::sky;
use crate::scene::{Color, Lamp, Material, Scene, Vec3};
use crate::vector::{
    add, add_scaled, dot, exp, length, mix, multiply, normalized, pow, reflected, scale, smooth_step, sub,
};

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

/// What lights a pixel.
#[derive(Clone, Copy)]
pub(crate) struct Light<'a> {
    /// The sun, the sky and the air.
    pub(crate) scene: &'a Scene,
    /// What hides sun and sky.
    pub(crate) shadows: &'a Shadows,
    /// Lamps that may reach it.
    pub(crate) lamps: &'a [&'a Lamp],
    /// Light from above and from below.
    pub(crate) ambient: [Color; 2],
    /// Where the camera is.
    pub(crate) eye: Vec3,
}

/// How a surface answers light, besides its colour.
struct Finish {
    gloss: f32,
    shininess: f32,
    /// Share mirrored straight on.
    mirror: f32,
    /// Factor on the mirror image.
    clear: f32,
}

/// Light collected on a surface.
struct Lit {
    /// Scattered in all directions, before the surface's colour.
    scattered: Color,
    /// Highlights.
    highlight: Color,
}

/// Colour that the eye sees of a fragment, through the air.
pub(crate) fn color(light: &Light, fragment: &Fragment) -> Color {
    let ray = sub(fragment.position, light.eye);
    let distance_m = length(ray);
    let ray = scale(ray, 1.0 / distance_m);
    let look = pattern::look(fragment.material, fragment.uv, fragment.footprint);
    let water = water(light.scene, fragment);
    let finish = finish(fragment.material, &look, water);
    let skylight = light.shadows.skylight(fragment.position, fragment.normal);
    let lit = lit(light, fragment, ray, &finish, skylight);
    let surface = scale(look.color, 1.0 - 0.45 * water);
    let mut seen = add(multiply(surface, lit.scattered), lit.highlight);
    if finish.clear > 0.0 {
        let image = sky::mirrored(light.scene, reflected(ray, fragment.normal));
        let share = finish.clear * fresnel(finish.mirror, -dot(ray, fragment.normal));
        // Beside and under things the surroundings are dark too.
        seen = mix(seen, scale(image, 0.35 + 0.65 * skylight), share);
    }
    through_air(light.scene, add(seen, look.emission), distance_m)
}

/// How wet the fragment is, 0 to 1: flat surfaces, with puddles and drier patches.
fn water(scene: &Scene, fragment: &Fragment) -> f32 {
    let wetness = scene.air.wetness;
    if wetness <= 0.0 || fragment.normal[1] > -0.7 {
        return 0.0;
    }
    let [x, _, z] = fragment.position;
    let patches = Noise { scale: 3.0, octaves: 3, seed: 0x7a7e_0001 }.at([x, z], 0.0);
    let level = smooth_step(0.7, 0.95, -fragment.normal[1]);
    level * (wetness * (1.0 + 1.4 * patches)).clamp(0.0, 1.0)
}

fn finish(material: &Material, look: &Look, water: f32) -> Finish {
    let mirror = material.mirror * look.shine;
    let clear = if mirror > 0.0 { look.shine } else { 0.0 };
    Finish {
        gloss: (material.gloss * look.shine).max(0.5 * water),
        shininess: if water > 0.0 { material.shininess.max(40.0) } else { material.shininess },
        mirror: mirror.max(0.02 * water),
        clear: clear.max(0.85 * water),
    }
}

/// Schlick's approximation: everything mirrors at a grazing angle.
fn fresnel(straight: f32, facing: f32) -> f32 {
    let rest = 1.0 - facing.clamp(0.0, 1.0);
    let square = rest * rest;
    straight + (1.0 - straight) * square * square * rest
}

fn lit(light: &Light, fragment: &Fragment, ray: Vec3, finish: &Finish, skylight: f32) -> Lit {
    let Light { scene, shadows, lamps, ambient: [above, below], .. } = *light;
    let scattered = scale(mix(below, above, 0.5 - 0.5 * fragment.normal[1]), skylight);
    let mut lit = Lit { scattered, highlight: [0.0; 3] };
    let sun = scene.sun.direction;
    if dot(fragment.normal, sun) > 0.0 {
        let reaching = shadows.sunlight(fragment.position, fragment.normal);
        if reaching > 0.0 {
            lit.take(fragment, ray, finish, sun, scale(scene.sun.color, reaching));
        }
    }
    for lamp in lamps {
        if let Some((towards, arriving)) = lamp_light(lamp, fragment.position) {
            lit.take(fragment, ray, finish, towards, arriving);
        }
    }
    lit
}

impl Lit {
    /// Adds light that arrives from unit direction `towards`.
    fn take(&mut self, fragment: &Fragment, ray: Vec3, finish: &Finish, towards: Vec3, arriving: Color) {
        let facing = dot(fragment.normal, towards);
        if facing <= 0.0 {
            return;
        }
        self.scattered = add_scaled(self.scattered, arriving, facing);
        if finish.gloss > 0.0 {
            let half = normalized(sub(towards, ray));
            let highlight = finish.gloss * pow(dot(half, fragment.normal), finish.shininess);
            self.highlight = add_scaled(self.highlight, arriving, highlight);
        }
    }
}

/// Light on a surface that faces the sky, and on one that faces the ground.
pub(crate) fn ambient(scene: &Scene) -> [Color; 2] {
    let sky = &scene.sky;
    let clear = mix(sky.zenith, sky.horizon, 0.5);
    let above = mix(clear, sky.cloud_color, 0.7 * sky.clouds);
    [scale(above, sky.ambient), scale(sky.ground, sky.ambient)]
}

/// Unit direction to a lamp and its light on a surface that faces it, if it shines there.
fn lamp_light(lamp: &Lamp, position: Vec3) -> Option<(Vec3, Color)> {
    let towards = sub(lamp.position, position);
    let square = dot(towards, towards);
    let nearness = 1.0 - square / (lamp.reach_m * lamp.reach_m);
    if nearness <= 0.0 {
        return None;
    }
    let towards = scale(towards, 1.0 / square.max(1e-6).sqrt());
    let off_axis = -dot(towards, lamp.direction);
    if off_axis < lamp.cone_cos {
        return None;
    }
    let cone = if lamp.cone_cos <= -1.0 {
        1.0
    } else {
        smooth_step(lamp.cone_cos, lamp.cone_cos + 0.4 * (1.0 - lamp.cone_cos), off_axis)
    };
    Some((towards, scale(lamp.color, cone * nearness * nearness / (square + 0.05))))
}

/// What is left of a colour after `distance_m` of air.
fn through_air(scene: &Scene, color: Color, distance_m: f32) -> Color {
    mix(scene.air.fog_color, color, exp(-scene.air.fog_density * distance_m))
}
