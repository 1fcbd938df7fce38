//! From light to the number in the file.

use wide::f32x4;

use crate::scene::Color;
use crate::vector::pow;

/// Steps of the table; it is entered by the square root of the light, which is near to even steps of the result.
const STEPS: usize = 4096;

/// Every how many pixels the exposure is measured.
const METERING_STRIDE: usize = 97;

/// sRGB's curve with more contrast, as a table.
pub(super) struct ToneCurve {
    table: Vec<u8>,
}

impl ToneCurve {
    pub(super) fn new(contrast: f32) -> Self {
        let value = |step: usize| {
            let root = step as f32 / STEPS as f32;
            let plain = srgb_from_light(root * root);
            let steep = plain * plain * (3.0 - 2.0 * plain);
            ((plain + (steep - plain) * contrast) * 255.0 + 0.5) as u8
        };
        Self { table: (0..=STEPS).map(value).collect() }
    }

    /// The finished red, green and blue; all light above 1 is white.
    #[inline]
    pub(super) fn at(&self, light: f32x4) -> [u8; 3] {
        let limited = light.fast_max(f32x4::ZERO).fast_min(f32x4::ONE);
        let steps = limited.sqrt() * f32x4::splat(STEPS as f32) + f32x4::splat(0.5);
        let [r, g, b, _] = steps.fast_trunc_int().to_array();
        [self.table[r as usize], self.table[g as usize], self.table[b as usize]]
    }
}

fn srgb_from_light(light: f32) -> f32 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * pow(light, 1.0 / 2.4) - 0.055 }
}

/// The factor on the light that makes the finished picture's mean `target` (0 to 1), between 1/64 and 64.
pub(super) fn exposure(light: &[Color], curve: &ToneCurve, target: f32) -> f32 {
    let measured: Vec<f32x4> = light.iter().step_by(METERING_STRIDE).map(|&[r, g, b]| [r, g, b, 0.0].into()).collect();
    let wanted = target * 255.0 * 3.0 * measured.len() as f32;
    let sum = |exposure: f32| {
        let pixels = measured.iter().map(|&pixel| curve.at(pixel * f32x4::splat(exposure)));
        pixels.map(|[r, g, b]| u32::from(r) + u32::from(g) + u32::from(b)).sum::<u32>()
    };
    let (mut least, mut most) = (1.0_f32 / 64.0, 64.0);
    for _ in 0..10 {
        let middle = (least * most).sqrt();
        if (sum(middle) as f32) < wanted { least = middle } else { most = middle }
    }
    (least * most).sqrt()
}
