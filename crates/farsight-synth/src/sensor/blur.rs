//! Blur of lens and motion: one kernel across and one down.

use crate::scene::Color;
use crate::vector::exp;

/// Blurs in place. `sigma_px` is the lens's, `motion_px` the length of the path across and down.
pub(super) fn blur(light: &mut [Color], size: [usize; 2], sigma_px: f32, motion_px: [f32; 2]) {
    let across = kernel(sigma_px, motion_px[0]);
    if across.len() > 1 {
        blur_rows(light, size[0], &across);
    }
    let down = kernel(sigma_px, motion_px[1]);
    if down.len() > 1 {
        blur_columns(light, size, &down);
    }
}

/// Weights of an odd number of pixels, sum 1: a box of length `motion` convolved with a Gaussian.
fn kernel(sigma: f32, motion: f32) -> Vec<f32> {
    let reach = (2.5 * sigma + 0.5 * motion).ceil() as i32;
    // The box as nine places along the path, the Gaussian no narrower than a third of a pixel.
    let sigma = sigma.max(0.3);
    let weight = |pixel: i32| {
        let place = |step: i32| pixel as f32 - motion * step as f32 / 8.0;
        (-4..=4).map(|step| exp(-place(step) * place(step) / (2.0 * sigma * sigma))).sum::<f32>()
    };
    let weights: Vec<f32> = (-reach..=reach).map(weight).collect();
    let sum: f32 = weights.iter().sum();
    weights.into_iter().map(|w| w / sum).collect()
}

fn blur_rows(light: &mut [Color], width: usize, kernel: &[f32]) {
    let reach = kernel.len() / 2;
    let mut padded = vec![[0.0; 3]; width + 2 * reach];
    for row in light.chunks_exact_mut(width) {
        padded[..reach].fill(row[0]);
        padded[reach..reach + width].copy_from_slice(row);
        padded[reach + width..].fill(row[width - 1]);
        let lines: Vec<&[Color]> = (0..kernel.len()).map(|offset| &padded[offset..offset + width]).collect();
        weighted_sum(row.as_flattened_mut(), kernel, &lines);
    }
}

fn blur_columns(light: &mut [Color], [width, height]: [usize; 2], kernel: &[f32]) {
    let reach = kernel.len() / 2;
    let source = light.to_vec();
    for (y, row) in light.chunks_exact_mut(width).enumerate() {
        let line = |offset: usize| {
            let line = (y + offset).saturating_sub(reach).min(height - 1);
            &source[line * width..(line + 1) * width]
        };
        let lines: Vec<&[Color]> = (0..kernel.len()).map(line).collect();
        weighted_sum(row.as_flattened_mut(), kernel, &lines);
    }
}

/// Numbers summed up at a time, in registers.
const AT_ONCE: usize = 16;

/// Sets `row` to the sum of the lines, each times its weight.
fn weighted_sum(row: &mut [f32], kernel: &[f32], lines: &[&[Color]]) {
    let whole = row.len() - row.len() % AT_ONCE;
    let (blocks, rest) = row.as_chunks_mut::<AT_ONCE>();
    for (number, block) in blocks.iter_mut().enumerate() {
        let start = number * AT_ONCE;
        let mut sum = [0.0; AT_ONCE];
        for (line, &weight) in lines.iter().zip(kernel) {
            let values = &line.as_flattened()[start..start + AT_ONCE];
            for (sum, &value) in sum.iter_mut().zip(values) {
                *sum += value * weight;
            }
        }
        *block = sum;
    }
    for (number, out) in rest.iter_mut().enumerate() {
        let terms = lines.iter().zip(kernel).map(|(line, weight)| line.as_flattened()[whole + number] * weight);
        *out = terms.sum();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::add_scaled;

    #[test]
    fn light_is_spread_and_none_is_lost() {
        let size = [31, 21];
        let mut light = vec![[0.0; 3]; 31 * 21];
        light[10 * 31 + 15] = [1.0, 2.0, 3.0];
        blur(&mut light, size, 0.8, [3.0, 0.0]);
        let sum = light.iter().fold([0.0; 3], |sum, &c| add_scaled(sum, c, 1.0));
        for (channel, expected) in sum.into_iter().zip([1.0, 2.0, 3.0]) {
            assert!((channel - expected).abs() < 1e-5, "{channel} of {expected} is left");
        }
        let beside = light[10 * 31 + 17][0];
        let below = light[12 * 31 + 15][0];
        assert!(beside > 2.0 * below, "motion across: {beside} beside, {below} below");
    }
}
