//! Kinds of cameras, by what they do to a picture.

use rand::{Rng, RngExt};

use super::model::SensorModel;
use crate::device::Device;
use crate::scene::Atmosphere;

impl SensorModel {
    /// A plausible camera of a kind under this atmosphere. `Any` draws what [`sample`](Self::sample) draws.
    pub fn sample_of(device: Device, atmosphere: &Atmosphere, rng: &mut impl Rng) -> Self {
        let plain = Self::sample(atmosphere, rng);
        let mut between = |least: f32, most: f32| least + (most - least) * rng.random::<f32>();
        match device {
            Device::Any => plain,
            Device::Phone => Self {
                contrast: between(0.4, 1.5),
                saturation: between(0.95, 1.4),
                sharpening: between(0.2, 1.2),
                vignetting: between(0.0, 0.15),
                blur_sigma_px: between(0.0, 0.7),
                read_noise: 0.4 * plain.read_noise,
                shot_noise: 0.3 * plain.shot_noise,
                jpeg_quality: Some(between(72.0, 97.0) as u8),
                ..plain
            },
            Device::DashCamera => Self {
                contrast: between(0.6, 2.0),
                saturation: between(0.7, 1.25),
                sharpening: between(0.5, 2.5),
                vignetting: between(0.05, 0.5),
                blur_sigma_px: between(0.5, 1.6),
                glare: plain.glare.max(between(0.0, 0.3)),
                jpeg_quality: Some(between(14.0, 55.0) as u8),
                ..plain
            },
        }
    }
}
