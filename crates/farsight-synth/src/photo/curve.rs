//! From light to the number in the file.

use crate::scene::Color;
use crate::vector::pow;

/// Steps of the table; it is entered by the square root of the light, which is near to even steps of the result.
const STEPS: usize = 2048;

/// Every how many pixels the exposure is measured.
const METERING_STRIDE: usize = 37;

/// sRGB's curve with more contrast, as a table.
pub(super) struct Curve {
    table: Vec<f32>,
}

impl Curve {
    pub(super) fn new(contrast: f32) -> Self {
        let value = |step: usize| {
            let root = step as f32 / STEPS as f32;
            let plain = srgb_from_light(root * root);
            let steep = plain * plain * (3.0 - 2.0 * plain);
            plain + (steep - plain) * contrast
        };
        Self { table: (0..=STEPS).map(value).collect() }
    }

    /// The finished value, 0 to 1, of an amount of light; all above 1 is white.
    #[inline]
    pub(super) fn at(&self, light: f32) -> f32 {
        let step = light.clamp(0.0, 1.0).sqrt() * STEPS as f32 + 0.5;
        self.table[(step as usize).min(STEPS)]
    }
}

fn srgb_from_light(light: f32) -> f32 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * pow(light, 1.0 / 2.4) - 0.055 }
}

/// The factor on the light that makes the finished picture's mean `target`, between 1/64 and 64.
pub(super) fn exposure(light: &[Color], curve: &Curve, target: f32) -> f32 {
    let mean = |exposure: f32| {
        let values = light.iter().step_by(METERING_STRIDE).flatten().map(|&value| curve.at(value * exposure));
        values.sum::<f32>() / (3 * light.len().div_ceil(METERING_STRIDE)).max(1) as f32
    };
    let (mut least, mut most) = (1.0_f32 / 64.0, 64.0);
    for _ in 0..10 {
        let middle = (least * most).sqrt();
        if mean(middle) < target { least = middle } else { most = middle }
    }
    (least * most).sqrt()
}
