//! One camera at one moment.

use rand::{Rng, RngExt};

use crate::scene::Atmosphere;

/// One drawn camera and moment.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorModel {
    /// Mean of the finished picture that the automatic exposure aims at, 0 to 1.
    pub target_mean: f32,
    /// The most that the exposure can raise the light; what is darker stays dark.
    pub most_exposure: f32,
    /// Factors on red, green and blue.
    pub white_balance: [f32; 3],
    /// 0 is the plain curve of sRGB; 1 makes dark darker and bright brighter, 2 lets what is dark drown and what is
    /// bright burn out.
    pub contrast: f32,
    /// 0 is grey, 1 leaves colours as they are.
    pub saturation: f32,
    /// Share of light lost in the corners.
    pub vignetting: f32,
    /// Blur of the lens, standard deviation, pixels.
    pub blur_sigma_px: f32,
    /// Path of the picture during the exposure, across and down, pixels.
    pub motion_px: [f32; 2],
    /// Share of the light above white that is spread around bright lights.
    pub glare: f32,
    /// Standard deviation of the noise in the dark, share of white.
    pub read_noise: f32,
    /// Variance of the noise per unit of light.
    pub shot_noise: f32,
    /// How much of what a small blur would take away is added again; 0 none.
    pub sharpening: f32,
    /// Rain streaks, 0 to 1.
    pub rain: f32,
    /// Quality of a JPEG compression, 1 to 100; none without.
    pub jpeg_quality: Option<u8>,
    /// Which noise and which streaks.
    pub seed: u64,
}

impl SensorModel {
    /// Exposure, curve and nothing else: no noise, no blur.
    pub const IDEAL: Self = Self {
        target_mean: 0.4,
        most_exposure: 8.0,
        white_balance: [1.0; 3],
        contrast: 0.0,
        saturation: 1.0,
        vignetting: 0.0,
        blur_sigma_px: 0.0,
        motion_px: [0.0; 2],
        glare: 0.0,
        read_noise: 0.0,
        shot_noise: 0.0,
        sharpening: 0.0,
        rain: 0.0,
        jpeg_quality: None,
        seed: 0,
    };

    /// A plausible dash camera under this atmosphere.
    ///
    /// The ranges are chosen so that brightness and contrast spread like those of real street photographs (means of 85
    /// to 130 of 255, a tenth of the pixels white).
    pub fn sample(atmosphere: &Atmosphere, rng: &mut impl Rng) -> Self {
        let mut between = |least: f32, most: f32| least + (most - least) * rng.random::<f32>();
        let warmth = between(-0.08, 0.08);
        let tint = between(-0.03, 0.03);
        let target_mean = between(0.3, 0.46);
        let (contrast, saturation) = (between(0.3, 2.2), between(0.75, 1.3));
        // Squares make small values common and large ones rare.
        let mut rarely = |most: f32| most * between(0.0, 1.0) * between(0.0, 1.0);
        let noise = rarely(1.0);
        let settings = Self {
            target_mean,
            most_exposure: 2.0 + rarely(10.0),
            white_balance: [1.0 + warmth, 1.0 + tint, 1.0 - warmth],
            contrast,
            saturation,
            vignetting: rarely(0.5),
            blur_sigma_px: rarely(1.2),
            motion_px: [rarely(3.0), rarely(1.5)],
            glare: rarely(0.3),
            read_noise: 0.001 + 0.006 * noise,
            shot_noise: 5e-5 + 6e-4 * noise,
            sharpening: 0.0,
            rain: atmosphere.rain,
            jpeg_quality: None,
            seed: rng.random(),
        };
        // Two pictures in three went through a JPEG file.
        let compressed = rng.random::<f32>() < 0.67;
        let quality = 40 + (rng.random::<f32>() * 58.0) as u8;
        Self { jpeg_quality: compressed.then_some(quality), ..settings }
    }
}
