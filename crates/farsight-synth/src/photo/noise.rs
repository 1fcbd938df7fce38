//! The sensor: vignetting, exposure, white balance, noise, curve, whole numbers.

use super::PhotoSettings;
use super::curve::Curve;
use crate::scene::Color;

/// Share of red, green and blue in what the eye sees as grey (ITU-R BT.709, linear light).
const LUMA: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// The sum of four numbers of five bits has this mean and this standard deviation; it is close to normal.
const SUM_MEAN: f32 = 62.0;
const SUM_DEVIATION: f32 = 18.466;

/// What turns light into numbers.
pub(super) struct Sensor<'a> {
    pub(super) settings: &'a PhotoSettings,
    pub(super) exposure: f32,
    pub(super) curve: &'a Curve,
    pub(super) size: [usize; 2],
}

impl Sensor<'_> {
    /// Fills `bytes` (red, green, blue of each pixel) from `light`.
    pub(super) fn expose(&self, light: &[Color], bytes: &mut [u8]) {
        let [width, height] = self.size.map(|s| s as f32);
        let diagonal = width * width + height * height;
        let pixels = light.iter().zip(bytes.as_chunks_mut().0);
        for (number, (&color, out)) in pixels.enumerate() {
            let x = 2.0 * (number % self.size[0]) as f32 - width;
            let y = 2.0 * (number / self.size[0]) as f32 - height;
            let loss = 1.0 - self.settings.vignetting * (x * x + y * y) / diagonal;
            *out = self.pixel(color, loss, random_bits(self.settings.seed, number as u64));
        }
    }

    #[inline]
    fn pixel(&self, color: Color, loss: f32, random: u64) -> [u8; 3] {
        let settings = self.settings;
        let grey = LUMA[0] * color[0] + LUMA[1] * color[1] + LUMA[2] * color[2];
        let mut out = [0; 3];
        for (channel, byte) in out.iter_mut().enumerate() {
            let saturated = (grey + (color[channel] - grey) * settings.saturation).max(0.0);
            let exposed = saturated * (self.exposure * loss * settings.white_balance[channel]);
            // A higher exposure of the same scene is a higher gain, and the noise grows with it.
            let gain = self.exposure.max(1.0);
            let variance = (settings.shot_noise * exposed + settings.read_noise * settings.read_noise * gain) * gain;
            let noisy = exposed + normal(random >> (20 * channel)) * variance.sqrt();
            *byte = (self.curve.at(noisy) * 255.0 + 0.5) as u8;
        }
        out
    }
}

/// A number from a nearly normal distribution, mean 0 and standard deviation 1, from the lowest 20 bits.
#[inline]
fn normal(bits: u64) -> f32 {
    let sum = (bits & 31) + (bits >> 5 & 31) + (bits >> 10 & 31) + (bits >> 15 & 31);
    (sum as f32 - SUM_MEAN) * (1.0 / SUM_DEVIATION)
}

/// Random bits of a pixel (SplitMix64's finisher).
#[inline]
fn random_bits(seed: u64, number: u64) -> u64 {
    let mut z = seed.wrapping_add(number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
