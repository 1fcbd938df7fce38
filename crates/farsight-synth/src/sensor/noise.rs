//! The sensor: vignetting, exposure, white balance, noise, curve, whole numbers.

use wide::{bytemuck::cast, f32x4, i32x4, u32x4};

use super::curve::ToneCurve;
use super::model::SensorModel;
use crate::palette::LUMA;
use crate::scene::Color;
use crate::vector::float;

/// The sum of four numbers of five bits has this mean and this standard deviation; it is close to normal.
const SUM_MEAN: f32 = 62.0;
const SUM_DEVIATION: f32 = 18.466;

/// What turns light into numbers.
pub(super) struct Readout<'a> {
    pub(super) settings: &'a SensorModel,
    pub(super) exposure: f32,
    pub(super) curve: &'a ToneCurve,
    pub(super) size: [usize; 2],
}

impl Readout<'_> {
    /// Fills `bytes` (red, green, blue of each pixel) from `light`.
    pub(super) fn expose(&self, light: &[Color], bytes: &mut [u8]) {
        let settings = self.settings;
        let [width, height] = self.size.map(|s| s as f32);
        let per_square = settings.vignetting / (width * width + height * height);
        let [red, green, blue] = settings.white_balance;
        let balance = f32x4::from([red, green, blue, 0.0]) * f32x4::splat(self.exposure);
        // A higher exposure of the same scene is a higher gain, and the noise grows with it.
        let gain = self.exposure.max(1.0);
        let shot = f32x4::splat(settings.shot_noise * gain);
        let read = f32x4::splat(settings.read_noise * settings.read_noise * gain * gain);
        let saturation = f32x4::splat(settings.saturation);
        let lines = light.chunks_exact(self.size[0]).zip(bytes.chunks_exact_mut(3 * self.size[0]));
        for (row, (pixels, out)) in lines.enumerate() {
            let y = 2.0 * float(row) - height;
            for (column, (&[r, g, b], out)) in pixels.iter().zip(out.as_chunks_mut().0).enumerate() {
                let x = 2.0 * float(column) - width;
                let kept = 1.0 - per_square * (x * x + y * y);
                let grey = f32x4::splat(LUMA[0] * r + LUMA[1] * g + LUMA[2] * b);
                let color = f32x4::from([r, g, b, 0.0]);
                let saturated = (grey + (color - grey) * saturation).fast_max(f32x4::ZERO);
                let exposed = saturated * balance * f32x4::splat(kept);
                let random = normal(random_bits(settings.seed, (row * self.size[0] + column) as u64));
                *out = self.curve.at(exposed + random * (shot * exposed + read).sqrt());
            }
        }
    }
}

/// Three numbers from a nearly normal distribution, mean 0 and standard deviation 1, from 60 bits.
#[inline]
fn normal(bits: u64) -> f32x4 {
    let fields = u32x4::from([bits as u32, (bits >> 20) as u32, (bits >> 40) as u32, 0]);
    let few = u32x4::splat(31);
    let sum = (fields & few) + ((fields >> 5) & few) + ((fields >> 10) & few) + ((fields >> 15) & few);
    let sum: i32x4 = cast(sum);
    (f32x4::from_i32x4(sum) - f32x4::splat(SUM_MEAN)) * f32x4::splat(1.0 / SUM_DEVIATION)
}

/// Random bits of a pixel (the finisher of `SplitMix64`).
#[inline]
fn random_bits(seed: u64, number: u64) -> u64 {
    let mut z = seed.wrapping_add(number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
