//! Whether a picture shows another scene than the one before.

use image::RgbImage;
use image::imageops::thumbnail;

/// Sides of the small picture that is compared, pixels.
const SIDES: [u32; 2] = [32, 18];

/// A cut changes brightness by so much in the mean, of 255, and by so many times what was usual before it.
const MIN_CHANGE: f64 = 25.0;
const UNUSUAL: f64 = 4.0;

/// Weight of the latest change in what is usual.
const LATEST_WEIGHT: f64 = 0.2;

/// Compares each picture with the one before.
#[derive(Debug, Default)]
pub(super) struct SceneCut {
    before: Option<RgbImage>,
    usual: Option<f64>,
}

impl SceneCut {
    /// Whether this one looks like another scene.
    pub(super) fn looks_cut(&mut self, image: &RgbImage) -> bool {
        let small = thumbnail(image, SIDES[0], SIDES[1]);
        let Some(before) = self.before.replace(small.clone()) else { return false };
        let pairs = before.as_raw().iter().zip(small.as_raw());
        let change = pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / small.as_raw().len() as f64;
        let usual = self.usual.get_or_insert(change);
        let is_cut = change > MIN_CHANGE && change > UNUSUAL * *usual;
        if !is_cut {
            *usual += LATEST_WEIGHT * (change - *usual);
        }
        is_cut
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::SceneCut;

    /// Bars that move, brighter by `light`.
    fn picture(shift: u32, light: u8, width: u32) -> RgbImage {
        RgbImage::from_fn(320, 180, |x, _| {
            Rgb([if ((x + shift) / width).is_multiple_of(2) { 40 + light } else { 200 }; 3])
        })
    }

    #[test]
    fn a_cut_is_told_from_motion_and_from_light() {
        let mut cut = SceneCut::default();
        for step in 0..10 {
            assert!(!cut.looks_cut(&picture(2 * step, 2 * step as u8, 80)), "{step}");
        }
        assert!(cut.looks_cut(&picture(60, 0, 35)));
        assert!(!cut.looks_cut(&picture(62, 0, 35)));
    }
}
