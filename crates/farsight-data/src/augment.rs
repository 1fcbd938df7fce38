//! The random policy: from a configuration to one fixed transform.

use farsight_core::Affine2;
use farsight_core::input::InputRules;
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::{ColorJitter, Degradation, Reflections, Shadow, Sharpness, Transform};

/// How training images are varied.
///
/// The default is the target paper's "flip, scale, colour jitter" with official SMOKE's numbers for the first two (spec
/// section 8, items 2 and 3). The paper gives none for the jitter; those are ours.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AugmentationConfig {
    /// Share of images that are mirrored left to right.
    pub flip_probability: f64,
    /// Share of images of which another window is taken, shifted and scaled.
    #[serde(alias = "window_probability")]
    pub shift_scale_probability: f64,
    /// Shifts of the window's centre, shares of the image's width and height; drawn for each axis.
    pub shift_steps: Vec<f64>,
    /// Widths of the window, shares of the image's width.
    pub scale_steps: Vec<f64>,
    /// Share of images whose colours are changed.
    pub jitter_probability: f64,
    /// Largest change of brightness: the factor lies in `1 - brightness .. 1 + brightness`.
    pub brightness: f64,
    /// Largest change of contrast, likewise.
    pub contrast: f64,
    /// Largest change of saturation, likewise.
    pub saturation: f64,
    /// Largest turn of hue, either way, radians.
    pub hue_rad: f64,
    /// Share of images with reflections of themselves on everything ([`Reflections`]); for rendered images.
    pub reflection_probability: f64,
    /// How strong reflections get at most, 0 to 1.
    pub reflection_strength: f64,
    /// Share of images with shadows on anything ([`Shadow`]); for rendered images.
    #[serde(alias = "shade_probability")]
    pub shadow_probability: f64,
    /// Share of images that are made sharper or softer ([`Sharpness`]); for rendered images, which have less fine
    /// detail than photographs.
    #[serde(alias = "detail_probability")]
    pub sharpness_probability: f64,
    /// Largest factor of [`Sharpness`], at least 1; the smallest is one over it.
    #[serde(alias = "detail_factor")]
    pub sharpness_factor: f64,
    /// Share of images with noise, blur or motion blur ([`Degradation`]).
    pub degradation_probability: f64,
    /// Whether shifted and scaled images teach only the heatmap, as in official SMOKE, whose camera does not follow
    /// its window (spec 7.3). Ours follows, so nothing has to be masked.
    pub mask_scaled_regression: bool,
}

impl Default for AugmentationConfig {
    fn default() -> Self {
        Self {
            flip_probability: 0.5,
            shift_scale_probability: 0.3,
            shift_steps: vec![-0.2, -0.1, 0.0, 0.1, 0.2],
            scale_steps: vec![0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4],
            jitter_probability: 0.5,
            brightness: 0.2,
            contrast: 0.2,
            saturation: 0.2,
            hue_rad: 0.0,
            reflection_probability: 0.0,
            reflection_strength: 0.5,
            shadow_probability: 0.0,
            sharpness_probability: 0.0,
            sharpness_factor: 3.0,
            degradation_probability: 0.0,
            mask_scaled_regression: false,
        }
    }
}

impl AugmentationConfig {
    /// Varies nothing: every draw is [`Transform::identity`].
    pub fn none() -> Self {
        let never = 0.0;
        Self {
            flip_probability: never,
            shift_scale_probability: never,
            jitter_probability: never,
            reflection_probability: never,
            shadow_probability: never,
            sharpness_probability: never,
            degradation_probability: never,
            ..Self::default()
        }
    }

    /// Why this configuration cannot be used, if it cannot.
    pub fn problem(&self) -> Option<String> {
        let share = |name: &str, value: f64| {
            let message = || format!("{name} is {value}; expected a number from 0 to 1");
            (!(0.0..=1.0).contains(&value)).then(message)
        };
        let steps = |name: &str, values: &[f64], fits: fn(f64) -> bool, expected: &str| match values {
            [] => Some(format!("{name} is empty; expected at least one {expected}")),
            _ => values.iter().find(|v| !fits(**v)).map(|v| format!("{name} has {v}; expected {expected}")),
        };
        share("flip_probability", self.flip_probability)
            .or_else(|| share("shift_scale_probability", self.shift_scale_probability))
            .or_else(|| share("jitter_probability", self.jitter_probability))
            .or_else(|| share("brightness", self.brightness))
            .or_else(|| share("contrast", self.contrast))
            .or_else(|| share("saturation", self.saturation))
            .or_else(|| share("reflection_probability", self.reflection_probability))
            .or_else(|| share("reflection_strength", self.reflection_strength))
            .or_else(|| share("shadow_probability", self.shadow_probability))
            .or_else(|| share("sharpness_probability", self.sharpness_probability))
            .or_else(|| share("degradation_probability", self.degradation_probability))
            .or_else(|| {
                let factor = self.sharpness_factor;
                let in_range = (1.0..=100.0).contains(&factor);
                (!in_range).then(|| format!("sharpness_factor is {factor}; expected a number from 1 to 100"))
            })
            .or_else(|| steps("shift_steps", &self.shift_steps, |v| v.abs() <= 1.0, "number from -1 to 1"))
            .or_else(|| steps("scale_steps", &self.scale_steps, |v| v.is_finite() && v > 0.0, "positive number"))
            .or_else(|| {
                let hue = self.hue_rad;
                let in_range = (0.0..=std::f64::consts::PI).contains(&hue);
                (!in_range).then(|| format!("hue_rad is {hue}; expected radians from 0 to pi"))
            })
    }

    /// Draws the transform of one image of `image_size` (width, height).
    ///
    /// A configuration with a [`problem`](Self::problem) draws what it can: empty steps change nothing.
    pub fn draw(&self, rng: &mut impl Rng, image_size: [usize; 2], rules: &InputRules) -> Transform {
        let mirror = happens(rng, self.flip_probability);
        let scaled = happens(rng, self.shift_scale_probability);
        let [width, height] = image_size.map(|side| side as f64);
        let mut center = [width / 2.0, height / 2.0];
        let mut window_width = width;
        if mirror {
            // Official SMOKE mirrors the centre with the pixels (spec section 8, item 2).
            center[0] = width - 1.0 - center[0];
        }
        if scaled {
            center[0] += width * step(rng, &self.shift_steps, 0.0);
            center[1] += height * step(rng, &self.shift_steps, 0.0);
            window_width *= step(rng, &self.scale_steps, 1.0);
        }
        Transform {
            mirror,
            window: Affine2::window(center, window_width, rules.size),
            jitter: self.draw_jitter(rng),
            reflections: self.draw_reflections(rng, rules.size),
            shadow: self.draw_shadow(rng),
            sharpness: self.draw_sharpness(rng),
            degradation: happens(rng, self.degradation_probability).then(|| Degradation::draw(rng)),
            scaled,
            regress: !(scaled && self.mask_scaled_regression),
        }
    }

    fn draw_jitter(&self, rng: &mut impl Rng) -> Option<ColorJitter> {
        happens(rng, self.jitter_probability).then(|| ColorJitter {
            brightness: 1.0 + symmetric(rng, self.brightness),
            contrast: 1.0 + symmetric(rng, self.contrast),
            saturation: 1.0 + symmetric(rng, self.saturation),
            hue_rad: symmetric(rng, self.hue_rad),
        })
    }

    fn draw_reflections(&self, rng: &mut impl Rng, size: [usize; 2]) -> Option<Reflections> {
        happens(rng, self.reflection_probability).then(|| Reflections::draw(rng, size, self.reflection_strength))
    }

    fn draw_shadow(&self, rng: &mut impl Rng) -> Option<Shadow> {
        happens(rng, self.shadow_probability).then(|| Shadow::draw(rng))
    }

    fn draw_sharpness(&self, rng: &mut impl Rng) -> Option<Sharpness> {
        happens(rng, self.sharpness_probability).then(|| Sharpness::draw(rng, self.sharpness_factor))
    }
}

fn happens(rng: &mut impl Rng, probability: f64) -> bool {
    rng.random::<f64>() < probability
}

fn step(rng: &mut impl Rng, steps: &[f64], otherwise: f64) -> f64 {
    steps.choose(rng).copied().unwrap_or(otherwise)
}

fn symmetric(rng: &mut impl Rng, reach: f64) -> f64 {
    (2.0 * rng.random::<f64>() - 1.0) * reach
}
