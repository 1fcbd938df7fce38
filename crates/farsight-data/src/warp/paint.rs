//! From colours of 0 to 255 to the numbers that the network was trained with.

use std::ops::Range;

use farsight_core::input::{CHANNEL_MEAN, CHANNEL_STD, ChannelOrder, InputRules, Sampling};

use crate::ColorJitter;

/// The largest value of a colour.
const WHITE: f32 = 255.0;

/// Rounding, jitter, order of channels and normalisation, ready to be applied.
pub(super) struct Paint {
    /// Which of red, green, blue goes into each plane.
    order: [usize; 3],
    /// Factor of each plane, from 0..255.
    scale: [f32; 3],
    /// Added to each plane: what black becomes.
    black: [f32; 3],
    /// New colours from old, 0 to 255, and a constant.
    jitter: Option<[[f32; 4]; 3]>,
    /// Whether colours are cut to whole numbers first.
    truncate: bool,
}

impl Paint {
    pub(super) fn new(rules: &InputRules, jitter: Option<&ColorJitter>) -> Self {
        let order = match rules.channels {
            ChannelOrder::Rgb => [0, 1, 2],
            ChannelOrder::Bgr => [2, 1, 0],
        };
        let on_bytes = |[r, g, b, constant]: [f64; 4]| [r, g, b, constant * f64::from(WHITE)].map(|v| v as f32);
        Self {
            order,
            scale: CHANNEL_STD.map(|std| 1.0 / (WHITE * std)),
            black: [0, 1, 2].map(|plane| -CHANNEL_MEAN[plane] / CHANNEL_STD[plane]),
            jitter: jitter.map(|jitter| jitter.matrix().map(on_bytes)),
            truncate: rules.sampling == Sampling::HalfPixel,
        }
    }

    /// Makes the values in `range` of each plane black.
    pub(super) fn black(&self, input: &mut [f32], range: Range<usize>) {
        let area = input.len() / 3;
        if !range.is_empty() {
            for (plane, black) in input.chunks_exact_mut(area).zip(self.black) {
                plane[range.clone()].fill(black);
            }
        }
    }

    /// Paints one row: `planes` from red, green and blue.
    pub(super) fn row(&self, planes: [&mut [f32]; 3], rgb: [&[f32]; 3]) {
        if self.truncate {
            self.jittered(planes, rgb, |value| value as i32 as f32);
        } else {
            self.jittered(planes, rgb, |value| value);
        }
    }

    fn jittered(&self, planes: [&mut [f32]; 3], [red, green, blue]: [&[f32]; 3], whole: impl Fn(f32) -> f32 + Copy) {
        for (number, plane) in planes.into_iter().enumerate() {
            let (channel, scale, black) = (self.order[number], self.scale[number], self.black[number]);
            if let Some([mr, mg, mb, constant]) = self.jitter.map(|matrix| matrix[channel]) {
                for ((out, &r), (&g, &b)) in plane.iter_mut().zip(red).zip(green.iter().zip(blue)) {
                    let value = mr * whole(r) + mg * whole(g) + mb * whole(b) + constant;
                    *out = value.clamp(0.0, WHITE) * scale + black;
                }
            } else {
                for (out, &value) in plane.iter_mut().zip([red, green, blue][channel]) {
                    *out = whole(value) * scale + black;
                }
            }
        }
    }
}
