//! Blurs. At the border the nearest pixel goes on.

use image::RgbImage;

/// A Gaussian is cut off at so many standard deviations.
const CUT_SIGMAS: f64 = 4.0;

/// Blurred by a Gaussian of this standard deviation, pixels.
pub(super) fn gaussian(image: &RgbImage, sigma: f64) -> RgbImage {
    let radius = (CUT_SIGMAS * sigma).round() as i64;
    let kernel = normalised((-radius..=radius).map(|at| bell(at as f64, sigma)).collect());
    let taps = |step: [i64; 2]| -> Vec<([i64; 2], f64)> {
        (-radius..=radius).zip(&kernel).map(|(at, weight)| ([step[0] * at, step[1] * at], *weight)).collect()
    };
    let across = mixed(&values(image), image, &taps([1, 0]));
    bytes(&mixed(&across, image, &taps([0, 1])), image)
}

/// Smeared along a line that starts at each pixel, `angle_deg` from level, with weights that fall as half a Gaussian.
pub(super) fn motion(image: &RgbImage, radius: i64, sigma: f64, angle_deg: f64) -> RgbImage {
    let width = 2 * radius + 1;
    let kernel = normalised((0..width).map(|at| bell(at as f64, sigma)).collect());
    let (down, across) = angle_deg.to_radians().sin_cos();
    let taps: Vec<([i64; 2], f64)> = (0..width)
        .zip(kernel)
        .map(|(at, weight)| {
            // Half a pixel goes down, as the reference rounds.
            let steps = |share: f64| (at as f64 * share - 0.5).ceil() as i64;
            ([steps(across), steps(down)], weight)
        })
        .take_while(|(step, _)| step[0].abs() < i64::from(image.width()) && step[1].abs() < i64::from(image.height()))
        .collect();
    bytes(&mixed(&values(image), image, &taps), image)
}

fn bell(at: f64, sigma: f64) -> f64 {
    (-at * at / (2.0 * sigma * sigma)).exp()
}

fn normalised(kernel: Vec<f64>) -> Vec<f64> {
    let sum: f64 = kernel.iter().sum();
    kernel.into_iter().map(|weight| weight / sum).collect()
}

fn values(image: &RgbImage) -> Vec<f32> {
    image.as_raw().iter().map(|value| f32::from(*value)).collect()
}

fn bytes(values: &[f32], image: &RgbImage) -> RgbImage {
    let cut = values.iter().map(|value| (value.clamp(0.0, 255.0) + 1e-3) as u8).collect();
    RgbImage::from_raw(image.width(), image.height(), cut).unwrap_or_else(|| image.clone())
}

/// Each value as the weighted sum of those that lie by a step to the right and below.
fn mixed(values: &[f32], image: &RgbImage, taps: &[([i64; 2], f64)]) -> Vec<f32> {
    let (width, height) = (i64::from(image.width()), i64::from(image.height()));
    let mut out = vec![0.0_f32; values.len()];
    for ([right, below], weight) in taps {
        let weight = *weight as f32;
        for row in 0..height {
            let source_row = (row + below).clamp(0, height - 1) * width;
            for column in 0..width {
                let source = 3 * (source_row + (column + right).clamp(0, width - 1)) as usize;
                let target = 3 * (row * width + column) as usize;
                for channel in 0..3 {
                    out[target + channel] += weight * values[source + channel];
                }
            }
        }
    }
    out
}
