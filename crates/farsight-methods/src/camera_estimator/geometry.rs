//! What an image says of its camera, as the network answers it.
//!
//! The whole image is shown to the network, as large as it fits into the input, the rest of the input black. The three
//! numbers are of the input: the logarithm of the focal length, how far the horizon lies above the middle, and by how
//! much it is turned. So they mean the same for every size and shape of image.

use std::f64::consts::SQRT_2;

use farsight_core::camera::CameraError;
use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_core::{Affine2, Camera};
use serde::{Deserialize, Serialize};

/// Channels of the input: red, green, blue.
pub const INPUT_CHANNELS: usize = 3;

/// Width and height of the input, pixels.
pub const INPUT_SIZE: [usize; 2] = [320, 192];

/// Numbers that are answered, each followed by the logarithm of how far off it may be.
pub const NUMBERS: usize = 3;

/// Channels of the answer.
pub const ANSWER_CHANNELS: usize = 2 * NUMBERS;

/// What the network answers 1 for: of the logarithm of the focal length over the input's width; of the horizon, heights
/// of the input above the middle; of the roll, radians.
pub const UNITS: [f64; NUMBERS] = [0.3, 0.2, 0.05];

/// What it answers 0 for: a field of view of 65 degrees, a level camera.
const MIDDLE: [f64; NUMBERS] = [-0.241, 0.0, 0.0];

/// It says errors of these sizes (Laplace distribution, in [`UNITS`]) by 0.
pub const ERROR_UNIT: f64 = 0.3;

/// Logarithms of errors beyond this are not believed.
pub const MAX_ERROR_LOG: f64 = 4.0;

/// No field of view is larger than this, degrees.
const WIDEST_DEG: f64 = 150.0;

/// What cameras are like of which nothing is known: 70 degrees along the longer side of the image (telephones have 65
/// to 75, dash cameras 60 to 120), and the standard deviation of the logarithm of the focal length.
const USUAL_DEG: f64 = 70.0;
const USUAL_LOG_SIGMA: f64 = 0.35;

/// What an image says of its camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraEstimate {
    /// Focal length of the image, pixels.
    pub focal_px: f64,
    /// Standard deviation of its logarithm.
    pub focal_log_sigma: f64,
    /// How far the camera looks down, radians, and the standard deviation of that.
    pub pitch_rad: [f64; 2],
    /// How far it is rolled (positive: the horizon falls to the right), radians, and the standard deviation of that.
    pub roll_rad: [f64; 2],
}

impl CameraEstimate {
    /// Horizontal field of view of an image of this width, degrees.
    pub fn hfov_deg(&self, width: usize) -> f64 {
        2.0 * (width as f64 / (2.0 * self.focal_px)).atan().to_degrees()
    }

    /// The horizontal fields of view, degrees, one standard deviation narrower and wider.
    pub fn hfov_interval_deg(&self, width: usize) -> [f64; 2] {
        let spread = self.focal_log_sigma.exp();
        [spread, 1.0 / spread].map(|factor| Self { focal_px: factor * self.focal_px, ..*self }.hfov_deg(width))
    }

    /// What is known of the camera of an image of this size (width, height) from the image and from what cameras are
    /// usually like: the mean of both focal lengths by their error bars.
    #[must_use]
    pub fn among_usual(self, image_size: [usize; 2]) -> Self {
        let longer = image_size[0].max(image_size[1]).max(1) as f64;
        let usual = (longer / (2.0 * (USUAL_DEG.to_radians() / 2.0).tan())).ln();
        let [seen_weight, usual_weight] = [self.focal_log_sigma, USUAL_LOG_SIGMA].map(|sigma| sigma.powi(-2));
        let weight = seen_weight + usual_weight;
        let focal_log = (seen_weight * self.focal_px.ln() + usual_weight * usual) / weight;
        Self { focal_px: focal_log.exp(), focal_log_sigma: weight.powf(-0.5), ..self }
    }

    /// A level pinhole with this focal length, its axis through the middle of an image of this size.
    ///
    /// # Errors
    /// When the focal length is none.
    pub fn camera(&self, [width, height]: [usize; 2]) -> Result<Camera, CameraError> {
        let [cx, cy] = [width, height].map(|side| (side as f64 - 1.0) / 2.0);
        Camera::from_intrinsics(self.focal_px, self.focal_px, cx, cy)
    }
}

/// What the input is made by.
pub fn input_rules() -> InputRules {
    InputRules { size: INPUT_SIZE, channels: ChannelOrder::Rgb, sampling: Sampling::Antialias }
}

/// From pixels of an image of this size (width, height) to pixels of the input: as large as it fits.
pub fn window(image_size: [usize; 2]) -> Affine2 {
    let scale = scale(image_size);
    let middle = image_size.map(|side| (side as f64 - 1.0) / 2.0);
    Affine2::centered(middle, [scale; 2], INPUT_SIZE)
}

/// Pixels of the input for one of the image.
fn scale(image_size: [usize; 2]) -> f64 {
    let fits = |axis: usize| INPUT_SIZE[axis] as f64 / image_size[axis].max(1) as f64;
    fits(0).min(fits(1))
}

/// A camera that sees less of the level directions than this, as a cosine, looks at its feet or at the sky.
const MIN_LEVEL: f64 = 0.3;

/// What the network should answer for an input that this camera sees, of a world whose second axis points down.
///
/// `None` for a camera that looks so far up or down that the horizon is nowhere.
pub fn encode(camera: &Camera) -> Option<[f64; NUMBERS]> {
    let [right, down, ahead] = camera.down();
    let level = right.hypot(down);
    if level < MIN_LEVEL {
        return None;
    }
    // Where the horizon crosses the column of the principal point, unrolled.
    let horizon_px = camera.principal_point()[1] - camera.focal_y() * ahead / level;
    let [width, height] = INPUT_SIZE.map(|side| side as f64);
    let [_, roll] = camera.attitude();
    let numbers = [(camera.focal_x() / width).ln(), (height / 2.0 - horizon_px) / height, roll];
    let answer = std::array::from_fn(|i| (numbers[i] - MIDDLE[i]) / UNITS[i]);
    answer.iter().all(|number: &f64| number.is_finite()).then_some(answer)
}

/// What an answer says of the camera of an image of this size (width, height), with errors `error_scale` times those
/// that the network tells.
pub fn decode(answer: [f64; ANSWER_CHANNELS], image_size: [usize; 2], error_scale: f64) -> CameraEstimate {
    let number = |i: usize| MIDDLE[i] + UNITS[i] * answer[2 * i];
    let sigma = |i: usize| {
        error_scale * SQRT_2 * UNITS[i] * ERROR_UNIT * answer[2 * i + 1].clamp(-MAX_ERROR_LOG, MAX_ERROR_LOG).exp()
    };
    let [width, height] = INPUT_SIZE.map(|side| side as f64);
    let narrowest = image_size[0].max(1) as f64 / (2.0 * (WIDEST_DEG.to_radians() / 2.0).tan());
    let focal_input = number(0).exp() * width;
    let rise = number(1) * height / focal_input;
    let rise_sigma = (sigma(1) * height / focal_input).hypot(rise * sigma(0));
    CameraEstimate {
        focal_px: (focal_input / scale(image_size)).max(narrowest),
        focal_log_sigma: sigma(0),
        pitch_rad: [rise.atan(), rise_sigma / (1.0 + rise * rise)],
        roll_rad: [number(2), sigma(2)],
    }
}

/// The mean of the answers for an image and for its mirror image.
pub fn mean_answer(answer: [f64; ANSWER_CHANNELS], mirrored: [f64; ANSWER_CHANNELS]) -> [f64; ANSWER_CHANNELS] {
    let sign = |channel: usize| if channel == 4 { -1.0 } else { 1.0 };
    std::array::from_fn(|channel| f64::midpoint(answer[channel], sign(channel) * mirrored[channel]))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A camera of a level world that looks down and is rolled.
    fn tilted(focal: f64, middle: [f64; 2], pitch: f64, roll: f64) -> Camera {
        let (sp, cp, sr, cr) = (pitch.sin(), pitch.cos(), roll.sin(), roll.cos());
        // Level to camera: first the pitch, then the roll.
        let rotation = [[cr, -sr * cp, sr * sp], [sr, cr * cp, -cr * sp], [0.0, sp, cp]];
        let rows = [
            std::array::from_fn(|j| focal * rotation[0][j] + middle[0] * rotation[2][j]),
            std::array::from_fn(|j| focal * rotation[1][j] + middle[1] * rotation[2][j]),
            rotation[2],
        ];
        Camera { projection: rows.map(|row: [f64; 3]| [row[0], row[1], row[2], 0.0]) }
    }

    fn answer_of(numbers: [f64; NUMBERS]) -> [f64; ANSWER_CHANNELS] {
        [numbers[0], 0.0, numbers[1], 0.0, numbers[2], 0.0]
    }

    proptest! {
        #[test]
        fn what_is_encoded_is_decoded(
            focal in 0.3..2.0_f64, pitch in -0.3..0.5_f64, roll in -0.2..0.2_f64, size in prop::sample::select(vec![
                [1242, 375], [1920, 1080], [640, 480], [480, 640], [100, 1000], [7, 5]]),
        ) {
            let focal_px = focal * size[0] as f64;
            let middle = size.map(|side| (side as f64 - 1.0) / 2.0);
            let input = tilted(focal_px, middle, pitch, roll).transformed(&window(size));
            let found = decode(answer_of(encode(&input).expect("a horizon")), size, 1.0);
            prop_assert!((found.focal_px / focal_px - 1.0).abs() < 1e-9, "{found:?}");
            prop_assert!((found.pitch_rad[0] - pitch).abs() < 1e-9, "{found:?}");
            prop_assert!((found.roll_rad[0] - roll).abs() < 1e-9, "{found:?}");
            let [narrow, wide] = found.hfov_interval_deg(size[0]);
            prop_assert!(narrow < found.hfov_deg(size[0]) && found.hfov_deg(size[0]) < wide);
        }

        #[test]
        fn a_mirror_image_is_rolled_the_other_way(pitch in -0.3..0.3_f64, roll in -0.2..0.2_f64) {
            let size = INPUT_SIZE;
            let camera = tilted(300.0, size.map(|side| (side as f64 - 1.0) / 2.0), pitch, roll);
            let [seen, mirrored] = [camera, camera.mirrored(size[0])].map(|camera| encode(&camera).expect("a horizon"));
            let mean = mean_answer(answer_of(seen), answer_of(mirrored));
            for (mean, seen) in mean.into_iter().zip(answer_of(seen)) {
                prop_assert!((mean - seen).abs() < 1e-9);
            }
        }

        #[test]
        fn any_answer_gives_numbers(answer in prop::array::uniform6(-1e3..1e3_f64), side in 1..5000_usize) {
            let found = decode(answer, [side, 100], 1.0);
            prop_assert!(found.hfov_deg(side) <= WIDEST_DEG + 1e-9 && found.focal_px > 0.0, "{found:?}");
            prop_assert!(found.focal_log_sigma > 0.0 && found.focal_log_sigma.is_finite());
        }
    }

    #[test]
    fn an_image_that_says_nothing_has_a_usual_camera() {
        let estimate = |focal_px: f64, focal_log_sigma: f64| {
            let nothing = [0.0, 1.0];
            CameraEstimate { focal_px, focal_log_sigma, pitch_rad: nothing, roll_rad: nothing }
        };
        // Upright, too: the longer side counts.
        for size in [[1920, 1080], [1080, 1920]] {
            let blind = estimate(500.0, 1e6).among_usual(size);
            let longer = estimate(blind.focal_px, 1.0).hfov_deg(1920);
            assert!((longer - USUAL_DEG).abs() < 1e-6, "{longer}");
            assert!((blind.focal_log_sigma - USUAL_LOG_SIGMA).abs() < 1e-6);
        }
        let sure = estimate(500.0, 1e-6).among_usual([1920, 1080]);
        assert!((sure.focal_px - 500.0).abs() < 1e-3 && sure.focal_log_sigma <= 1e-6);
        let both = estimate(500.0, USUAL_LOG_SIGMA).among_usual([1920, 1080]);
        assert!((both.focal_log_sigma - USUAL_LOG_SIGMA / 2.0_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn the_whole_image_is_seen() {
        for size in [[1242, 375], [1080, 1920], [4, 3], [1, 1], [1, 5000]] {
            let window = window(size);
            for corner in [[0.0, 0.0], size.map(|side| side as f64 - 1.0)] {
                let seen = window.apply(corner);
                for axis in 0..2 {
                    // The middle of the image comes to the middle of the input, to half a pixel.
                    assert!((-0.5..=INPUT_SIZE[axis] as f64).contains(&seen[axis]), "{size:?}: {seen:?}");
                }
            }
        }
    }

    #[test]
    fn a_camera_that_looks_at_its_feet_has_no_horizon() {
        assert_eq!(encode(&tilted(300.0, [160.0, 96.0], 1.5, 0.0)), None);
    }
}
