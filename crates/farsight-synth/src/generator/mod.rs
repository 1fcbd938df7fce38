//! Random scenes: structured domain randomisation (Prakash et al. 2019).
//!
//! [`config`] says what may be drawn. First the kind of place, the light and the camera are drawn, then the streets
//! with what lines them, then traffic, and last what surrounds it. `builder` collects the parts and keeps them from
//! overlapping.

mod background;
mod bonnet;
pub(crate) mod builder;
mod clutter;
pub mod config;
mod furniture;
pub(crate) mod ground;
pub(crate) mod light;
mod local;
pub(crate) mod mirror;
pub(crate) mod path;
pub(crate) mod plan;
mod plants;
mod props;
mod roadside;
mod shops;
pub(crate) mod street;
mod surroundings;
pub(crate) mod textures;
pub(crate) mod traffic;
pub(crate) mod view;

pub use config::{CameraRanges, MAX_IMAGE_PX, PlaceWeights, SceneConfig, WeatherWeights};

use crate::palette::{any_color, grey, matte, times, varied};
use crate::rng::{SCENE_STREAM, SceneRng};
use crate::scene::LabelledScene;
use crate::scene::{Material, MaterialId, Pattern};
use builder::SceneBuilder;
use ground::Ground;
use light::Light;
use plan::Plan;
use props::StreetMaterials;
use street::Surfaces;
use surroundings::Surroundings;
use traffic::Traffic;
use view::View;

/// Draws scene `index` of `seed`: the same whenever it is drawn.
///
/// The configuration must have no [`problem`](SceneConfig::problem).
pub fn generate_scene(config: &SceneConfig, seed: u64, index: u64) -> LabelledScene {
    drawn(config, [seed, index], None)
}

/// Draws scene `index` of `seed`; a region's traffic may be told its side.
fn drawn(config: &SceneConfig, [seed, index]: [u64; 2], told_left: Option<bool>) -> LabelledScene {
    let mut rng = SceneRng::new(seed, index, SCENE_STREAM);
    let region = config.regions.sample(&mut rng);
    let view = View::sample(&config.cameras, &mut rng);
    let place = rng.weighted(&config.places.table());
    let weather = rng.weighted(&config.weather.table());
    let unusual = rng.chance(config.unusual_share);
    let light = Light::of(weather, config, unusual, [seed, index], &mut rng);
    let ground = Ground::sample(view.height_m, &mut rng);
    let left_hand = rng.chance(region.map_or(config.left_hand_share, |region| region.left_hand_share));
    let left_hand = told_left.unwrap_or(left_hand);
    let is_mirrored = region.is_some() && left_hand;
    let view = if region.is_some() { view.widened() } else { view };
    let view = if is_mirrored { view.mirrored() } else { view };
    let plan = Plan::sample(place, &view, region, left_hand && !is_mirrored, &mut rng);
    let mut builder = SceneBuilder::new(view, ground, light, unusual, region);
    let density = rng.range(config.density[0], config.density[1]);
    let traffic_rng = rng.fork();
    let traffic = Traffic {
        builder: &mut builder,
        plan: &plan,
        density,
        people_density: density * config.people_factor,
        heavy_factor: config.heavy_factor,
        farthest_m: config.farthest_m,
        region,
        rng: traffic_rng,
    };
    traffic.place_all();
    if builder.view.has_bonnet {
        bonnet::add_bonnet(&mut builder, &mut rng.fork());
    }
    let distracting = rng.chance(config.distractor_share);
    build_surroundings(&mut builder, &plan, distracting, config.clutter, &mut rng);
    let mut generated = builder.finish();
    if rng.chance(config.textured_share) {
        textures::spread(&mut generated.scene.materials, &mut rng);
    }
    if is_mirrored {
        mirror::mirror(&mut generated);
    }
    generated
}

/// Builds the streets and what is beside them around the objects.
pub(crate) fn build_surroundings(
    builder: &mut SceneBuilder,
    plan: &Plan,
    distracting: bool,
    clutter: f64,
    rng: &mut SceneRng,
) {
    let surfaces = surfaces(builder, rng);
    for street in plan.streets() {
        street.build(builder, &surfaces, rng);
    }
    let materials = StreetMaterials::sample(builder, rng);
    let rng = rng.fork();
    let mut surroundings = Surroundings { builder, plan, materials, clutter, rng };
    surroundings.build_all(surfaces.grass);
    if let Some(region) = surroundings.builder.region {
        surroundings.furnish(region);
    }
    if distracting {
        surroundings.add_distractors();
    }
}

/// Draws what the ground is made of.
fn surfaces(builder: &mut SceneBuilder, rng: &mut SceneRng) -> Surfaces {
    let tone = asphalt_tone(rng);
    let asphalt = if builder.unusual && rng.chance(0.5) { any_color(rng) } else { varied(rng, grey(tone), 0.1) };
    let noise =
        |builder: &mut SceneBuilder, color: [f32; 3], other: [f32; 3], scale: f32, amount: f32, rng: &mut SceneRng| {
            let pattern = Pattern::Noise { other, scale, amount, seed: rng.seed() };
            builder.palette.add(Material { pattern, ..matte(color) })
        };
    let worn = times(asphalt, rng.range32(0.35, 0.85));
    let road = noise(builder, asphalt, worn, rng.log_range(0.3, 6.0) as f32, rng.range32(0.3, 1.0), rng);
    let dark = times(asphalt, rng.range32(0.5, 1.3));
    let patch = noise(builder, dark, dark.map(|c| c * 0.8), 0.5, 0.6, rng);
    let bay = if rng.chance(0.5) { road } else { paved(builder, rng) };
    let pavement = paved(builder, rng);
    let stone = rng.range32(0.2, 0.5);
    let kerb = noise(builder, grey(stone), grey(stone * 0.7), 1.0, 0.7, rng);
    let green = rng.weighted(&[
        ([0.05, 0.1, 0.018], 4.0),
        ([0.12, 0.13, 0.03], 2.0),
        ([0.2, 0.17, 0.07], 1.0),
        ([0.16, 0.12, 0.08], 0.7),
    ]);
    let green = varied(rng, green, 0.3);
    let dry = varied(rng, [0.14, 0.11, 0.05], 0.4);
    let dull = times(green, rng.range32(0.1, 0.4));
    let other = if rng.chance(0.4) { dry } else { dull };
    let green = times(green, rng.range32(1.0, 2.2));
    let grass = noise(builder, green, other, rng.range32(0.2, 2.0), 1.0, rng);
    let wear = Pattern::Worn { scale: rng.range32(0.1, 0.6), wear: rng.range32(0.0, 0.45), seed: rng.seed() };
    let tone = rng.range32(0.45, 0.8);
    let paint = if rng.chance(0.07) { [tone, tone * 0.7, tone * 0.12] } else { grey(tone) };
    let paint = builder.palette.add(Material { pattern: wear, ..matte(paint) });
    let middle = match builder.region {
        Some(region) if rng.chance(region.roads.yellow_middle) => {
            let yellow = varied(rng, [tone, tone * 0.62, tone * 0.08], 0.1);
            builder.palette.add(Material { pattern: wear, ..matte(yellow) })
        }
        _ => paint,
    };
    let road = match builder.region {
        Some(region) if rng.chance(region.roads.concrete) => concrete(builder, rng),
        _ => road,
    };
    let grass = match builder.region {
        Some(region) if rng.chance(region.sides.dry) => {
            let straw = varied(rng, [0.3, 0.23, 0.12], 0.35);
            noise(builder, straw, times(straw, 0.55), rng.range32(0.3, 3.0), 1.0, rng)
        }
        _ => grass,
    };
    Surfaces { road, patch, bay, pavement, kerb, grass, paint, middle }
}

/// Slabs of concrete, as long as a lane is wide.
fn concrete(builder: &mut SceneBuilder, rng: &mut SceneRng) -> MaterialId {
    let tone = rng.range32(0.26, 0.48);
    let color = varied(rng, [tone, tone * 0.97, tone * 0.9], 0.06);
    let pattern = Pattern::Bricks {
        other: color.map(|c| c * 0.6),
        size: [rng.range32(4.0, 6.0), 3.6],
        joint: 0.03,
        variation: 0.1,
        seed: rng.seed(),
    };
    builder.palette.add(Material { pattern, ..matte(color) })
}

/// Brightness of asphalt.
fn asphalt_tone(rng: &mut SceneRng) -> f32 {
    rng.log_range(0.06, 0.28) as f32
}

/// Slabs, setts or asphalt.
fn paved(builder: &mut SceneBuilder, rng: &mut SceneRng) -> MaterialId {
    let tone = rng.range32(0.14, 0.42);
    let color = varied(rng, [tone, tone * 0.95, tone * 0.88], 0.12);
    let seed = rng.seed();
    let pattern = if rng.chance(0.6) {
        let side = rng.log_range(0.1, 0.6) as f32;
        Pattern::Bricks {
            other: color.map(|c| c * 0.5),
            size: [side * rng.range32(1.0, 2.0), side],
            joint: 0.012,
            variation: 0.2,
            seed,
        }
    } else {
        Pattern::Noise { other: color.map(|c| c * 0.7), scale: 1.5, amount: 0.8, seed }
    };
    builder.palette.add(Material { pattern, ..matte(color) })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::region::RegionWeights;

    #[test]
    fn left_hand_traffic_is_a_mirror() {
        // The middle of the picture is its mirror's, too.
        let camera = CameraRanges {
            image_sizes: vec![[1280, 720]],
            center: [0.499_609_375, 0.5],
            center_reach: 0.0,
            lateral_m: 0.0,
            offset_m: 0.0,
            ..CameraRanges::kitti()
        };
        let regions = RegionWeights { kitti: 0.0, europe: 1.0, north_america: 1.0, india: 1.0, ..Default::default() };
        let config = SceneConfig { cameras: vec![camera], regions, textured_share: 0.2, ..SceneConfig::default() };
        for index in 0..12 {
            let [right, left] = [false, true].map(|left| drawn(&config, [8, index], Some(left)));
            assert_eq!(left.scene.camera, right.scene.camera, "scene {index}");
            assert_eq!(left.objects.len(), right.objects.len(), "scene {index}");
            for (a, b) in left.objects.iter().zip(&right.objects) {
                assert_eq!((&a.class, a.box3d), (&b.class, b.box3d.mirrored()), "scene {index}");
            }
            for (a, b) in left.scene.objects.iter().zip(&right.scene.objects) {
                assert_eq!(a.mesh.vertices.len(), b.mesh.vertices.len(), "scene {index}");
                let is_mirror = a.mesh.vertices.iter().zip(&b.mesh.vertices).all(|(a, b)| {
                    a.position.map(f32::to_bits) == [-b.position[0], b.position[1], b.position[2]].map(f32::to_bits)
                });
                assert!(is_mirror, "scene {index}");
            }
        }
    }
}
