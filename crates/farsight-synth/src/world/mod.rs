//! Random worlds: structured domain randomisation (Prakash et al. 2019).
//!
//! First the place, the light and the camera are drawn; then the streets with what lines them; then the things and the traffic along them.

mod background;
mod clutter;
pub mod config;
pub(crate) mod ground;
pub(crate) mod light;
mod lining;
mod path;
pub(crate) mod plan;
mod plants;
mod props;
mod shops;
pub(crate) mod stage;
mod street;
mod surroundings;
mod textures;
mod traffic;
pub(crate) mod view;

pub use config::{CameraRanges, PlaceWeights, WeatherWeights, WorldConfig};

use crate::dice::Dice;
use crate::palette::{any_color, grey, matte, times, varied};
use crate::scene::Drawn;
use crate::scene::{Material, MaterialId, Pattern};
use ground::Ground;
use light::Light;
use plan::Plan;
use props::Stock;
use stage::Stage;
use street::Surfaces;
use surroundings::Surroundings;
use traffic::Traffic;
use view::View;

/// Draws scene `index` of `seed`: the same whenever it is drawn.
///
/// The configuration must have no [`problem`](WorldConfig::problem).
pub fn draw_scene(config: &WorldConfig, seed: u64, index: u64) -> Drawn {
    let mut dice = Dice::new(seed, index, 0);
    let view = View::draw(&config.cameras, &mut dice);
    let place = dice.weighted(&config.places.table());
    let weather = dice.weighted(&config.weather.table());
    let unusual = dice.chance(config.unusual_share);
    let light = Light::draw(weather, unusual, &mut dice);
    let ground = Ground::draw(view.height_m, &mut dice);
    let left_hand = dice.chance(config.left_hand_share);
    let plan = Plan::draw(place, view.lateral_m, left_hand, &mut dice);
    let mut stage = Stage::new(view, ground, light, unusual);
    let density = dice.range(config.density[0], config.density[1]);
    let traffic_dice = dice.fork();
    let traffic = Traffic {
        stage: &mut stage,
        plan: &plan,
        density,
        people_density: density * config.people_factor,
        heavy_factor: config.heavy_factor,
        farthest_m: config.farthest_m,
        dice: traffic_dice,
    };
    traffic.place_all();
    let distracting = dice.chance(config.distractor_share);
    furnish(&mut stage, &plan, distracting, config.clutter, &mut dice);
    let mut drawn = stage.into_drawn();
    if dice.chance(config.textured_share) {
        textures::spread(&mut drawn.scene.materials, &mut dice);
    }
    drawn
}

/// Builds the streets and what is beside them around the actors.
pub(crate) fn furnish(stage: &mut Stage, plan: &Plan, distracting: bool, clutter: f64, dice: &mut Dice) {
    let surfaces = surfaces(stage, dice);
    for street in plan.streets() {
        street.build(stage, &surfaces, dice);
    }
    let stock = Stock::draw(stage, dice);
    let dice = dice.fork();
    let mut surroundings = Surroundings { stage, plan, stock, clutter, dice };
    surroundings.build_all(surfaces.grass);
    if distracting {
        surroundings.distract();
    }
}

/// Draws what the ground is made of.
fn surfaces(stage: &mut Stage, dice: &mut Dice) -> Surfaces {
    let tone = asphalt_tone(dice);
    let asphalt = if stage.unusual && dice.chance(0.5) { any_color(dice) } else { varied(dice, grey(tone), 0.1) };
    let noise = |stage: &mut Stage, color: [f32; 3], other: [f32; 3], scale: f32, amount: f32, dice: &mut Dice| {
        let pattern = Pattern::Noise { other, scale, amount, seed: dice.seed() };
        stage.palette.add(Material { pattern, ..matte(color) })
    };
    let worn = times(asphalt, dice.range32(0.35, 0.85));
    let road = noise(stage, asphalt, worn, dice.log_range(0.3, 6.0) as f32, dice.range32(0.3, 1.0), dice);
    let dark = times(asphalt, dice.range32(0.5, 1.3));
    let patch = noise(stage, dark, dark.map(|c| c * 0.8), 0.5, 0.6, dice);
    let bay = if dice.chance(0.5) { road } else { paved(stage, dice) };
    let pavement = paved(stage, dice);
    let stone = dice.range32(0.2, 0.5);
    let kerb = noise(stage, grey(stone), grey(stone * 0.7), 1.0, 0.7, dice);
    let green = dice.weighted(&[
        ([0.05, 0.1, 0.018], 4.0),
        ([0.12, 0.13, 0.03], 2.0),
        ([0.2, 0.17, 0.07], 1.0),
        ([0.16, 0.12, 0.08], 0.7),
    ]);
    let green = varied(dice, green, 0.3);
    let dry = varied(dice, [0.14, 0.11, 0.05], 0.4);
    let dull = times(green, dice.range32(0.1, 0.4));
    let other = if dice.chance(0.4) { dry } else { dull };
    let green = times(green, dice.range32(1.0, 2.2));
    let grass = noise(stage, green, other, dice.range32(0.2, 2.0), 1.0, dice);
    let wear = Pattern::Worn { scale: dice.range32(0.1, 0.6), wear: dice.range32(0.0, 0.45), seed: dice.seed() };
    let tone = dice.range32(0.45, 0.8);
    let paint = if dice.chance(0.07) { [tone, tone * 0.7, tone * 0.12] } else { grey(tone) };
    let paint = stage.palette.add(Material { pattern: wear, ..matte(paint) });
    Surfaces { road, patch, bay, pavement, kerb, grass, paint }
}

/// Brightness of asphalt.
fn asphalt_tone(dice: &mut Dice) -> f32 {
    dice.log_range(0.06, 0.28) as f32
}

/// Slabs, setts or asphalt.
fn paved(stage: &mut Stage, dice: &mut Dice) -> MaterialId {
    let tone = dice.range32(0.14, 0.42);
    let color = varied(dice, [tone, tone * 0.95, tone * 0.88], 0.12);
    let seed = dice.seed();
    let pattern = if dice.chance(0.6) {
        let side = dice.log_range(0.1, 0.6) as f32;
        Pattern::Bricks {
            other: color.map(|c| c * 0.5),
            size: [side * dice.range32(1.0, 2.0), side],
            joint: 0.012,
            variation: 0.2,
            seed,
        }
    } else {
        Pattern::Noise { other: color.map(|c| c * 0.7), scale: 1.5, amount: 0.8, seed }
    };
    stage.palette.add(Material { pattern, ..matte(color) })
}
