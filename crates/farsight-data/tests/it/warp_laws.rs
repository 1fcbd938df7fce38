//! What every warp must do, whatever the image.

use farsight_core::Affine2;
use farsight_core::input::{CHANNEL_MEAN, CHANNEL_STD, ChannelOrder, InputRules, Sampling};
use farsight_data::{ColorJitter, network_input, network_input_into, warp};
use image::RgbImage;
use image::imageops::flip_horizontal;
use proptest::prelude::*;

const ALL: [Sampling; 3] = [Sampling::PixelExact, Sampling::HalfPixel, Sampling::Antialias];
const INPUT_TOLERANCE: f32 = 2e-5;
/// One grey level, normalised with the smallest standard deviation.
const ONE_LEVEL: f32 = 1.0 / 255.0 / 0.224 + INPUT_TOLERANCE;

fn rules(size: [usize; 2], sampling: Sampling) -> InputRules {
    InputRules { size, channels: ChannelOrder::Rgb, sampling }
}

fn images() -> impl Strategy<Value = RgbImage> {
    (1_u32..20, 1_u32..12).prop_flat_map(|(width, height)| {
        let bytes = prop::collection::vec(any::<u8>(), (3 * width * height) as usize);
        bytes.prop_map(move |bytes| RgbImage::from_raw(width, height, bytes).unwrap())
    })
}

fn size(image: &RgbImage) -> [usize; 2] {
    [image.width() as usize, image.height() as usize]
}

/// The standard deviation of a channel, shares of white, away from the border.
fn contrast(image: &RgbImage) -> f64 {
    let values: Vec<f64> = image
        .enumerate_pixels()
        .filter(|(x, y, _)| (2..image.width() - 2).contains(x) && (2..image.height() - 2).contains(y))
        .map(|(_, _, pixel)| f64::from(pixel[0]) / 255.0)
        .collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn shrinking_makes_grey_of_what_is_too_fine_instead_of_a_pattern() {
    // 1242 x 375 to 416 x 128: stripes of two pixels have no place in it; sampled, they come back as slow waves.
    let stripes = |period: u32| {
        RgbImage::from_fn(1242, 375, |x, _| image::Rgb([if x % period < period / 2 { 255 } else { 0 }; 3]))
    };
    let shrunk = |image: &RgbImage, sampling| {
        warp(image, &Affine2::window([621.0, 187.5], 1242.0, [416, 128]), [416, 128], sampling)
    };
    let fine = stripes(2);
    assert!(contrast(&shrunk(&fine, Sampling::PixelExact)) > 0.15);
    let left = contrast(&shrunk(&fine, Sampling::Antialias));
    assert!(left < 0.04, "{left}");
    // What the output can show, it shows.
    let coarse = stripes(60);
    let kept = contrast(&shrunk(&coarse, Sampling::Antialias));
    assert!(kept > 0.45, "{kept}");
}

proptest! {
    #[test]
    fn antialiasing_changes_nothing_that_does_not_shrink(
        image in images(), center in [0.0..20.0, 0.0..12.0], width in 2.0..12.0,
    ) {
        let window = Affine2::window(center, width, [12, 6]);
        let [exact, antialias] = [Sampling::PixelExact, Sampling::Antialias]
            .map(|sampling| network_input(&image, &window, &rules([12, 6], sampling), None));
        prop_assert_eq!(exact, antialias);
    }

    #[test]
    fn antialiased_pixels_are_means_over_a_triangle(
        image in images(), center in [0.0..20.0, 0.0..12.0], step in 1.0..4.0, mirrored in any::<bool>(),
    ) {
        let (size, length) = ([5, 3], 5.0 * step);
        let window = Affine2::window(center, length, size);
        let map = if mirrored { Affine2::mirror(image.width() as usize).then(&window) } else { window };
        let found = warp(&image, &map, size, Sampling::Antialias);
        let inverse = map.inverse().unwrap();
        for (column, row, pixel) in found.enumerate_pixels() {
            let [x, y] = inverse.apply([f64::from(column), f64::from(row)]);
            let triangle = |distance: f64| f64::max(1.0 - distance.abs() / step, 0.0);
            let around = |c: f64| f64::ceil(c - step) as i64..=f64::floor(c + step) as i64;
            let (mut sum, mut total) = (0.0, 0.0);
            for source_row in around(y) {
                for source_column in around(x) {
                    let weight = triangle(source_column as f64 - x) * triangle(source_row as f64 - y);
                    let inside = (0..i64::from(image.width())).contains(&source_column)
                        && (0..i64::from(image.height())).contains(&source_row);
                    let value = if inside { image.get_pixel(source_column as u32, source_row as u32)[1] } else { 0 };
                    sum += weight * f64::from(value);
                    total += weight;
                }
            }
            prop_assert!((f64::from(pixel[1]) - sum / total).abs() < 0.51, "{} {}", pixel[1], sum / total);
        }
    }

    #[test]
    fn nothing_done_changes_nothing(image in images()) {
        for sampling in ALL {
            prop_assert_eq!(&warp(&image, &Affine2::IDENTITY, size(&image), sampling), &image);
        }
    }

    #[test]
    fn the_mirror_mirrors_pixels(image in images()) {
        for sampling in ALL {
            let mirror = Affine2::mirror(size(&image)[0]);
            prop_assert_eq!(warp(&image, &mirror, size(&image), sampling), flip_horizontal(&image));
        }
    }

    #[test]
    fn mirror_and_window_in_one_are_the_mirror_then_the_window(
        image in images(), center in [0.0..20.0, 0.0..12.0], width in 2.0..30.0,
    ) {
        let window = Affine2::window(center, width, [24, 10]);
        let both = Affine2::mirror(size(&image)[0]).then(&window);
        let rules = rules([24, 10], Sampling::PixelExact);
        let at_once = network_input(&image, &both, &rules, None);
        let one_by_one = network_input(&flip_horizontal(&image), &window, &rules, None);
        for (a, b) in at_once.iter().zip(&one_by_one) {
            prop_assert!((a - b).abs() < INPUT_TOLERANCE, "{} {}", a, b);
        }
    }

    #[test]
    fn whole_shifts_move_pixels_and_leave_black(image in images(), shift in [-5_i32..6, -5_i32..6]) {
        let map = Affine2 { matrix: [[1.0, 0.0, f64::from(shift[0])], [0.0, 1.0, f64::from(shift[1])]] };
        for sampling in ALL {
            let moved = warp(&image, &map, size(&image), sampling);
            for (x, y, pixel) in moved.enumerate_pixels() {
                let from = [x as i32 - shift[0], y as i32 - shift[1]].map(u32::try_from);
                let [Ok(x), Ok(y)] = from else {
                    prop_assert_eq!(pixel.0, [0; 3]);
                    continue;
                };
                let expected = image.get_pixel_checked(x, y).map_or([0; 3], |pixel| pixel.0);
                prop_assert_eq!(pixel.0, expected);
            }
        }
    }

    /// Upright maps take a faster way; a shear too small to matter forces the other one.
    #[test]
    fn both_ways_through_the_warp_agree(
        image in images(), center in [-5.0..25.0, -5.0..15.0], width in 2.0..60.0, mirror in any::<bool>(),
    ) {
        let window = Affine2::window(center, width, [24, 10]);
        let upright = if mirror { Affine2::mirror(size(&image)[0]).then(&window) } else { window };
        let mut turned = upright;
        turned.matrix[0][1] = 1e-14;
        for sampling in ALL {
            if sampling == Sampling::Antialias && width > 24.0 {
                // Only upright maps are smoothed where they shrink.
                continue;
            }
            let rules = rules([24, 10], sampling);
            let [a, b] = [upright, turned].map(|map| network_input(&image, &map, &rules, None));
            let differing = a.iter().zip(&b).filter(|(a, b)| (*a - *b).abs() > ONE_LEVEL).count();
            // Half-pixel borders are sharp: a sample exactly on one may fall to either side.
            prop_assert!(differing == 0 || sampling == Sampling::HalfPixel, "{}", differing);
        }
    }

    /// Whatever the vector held before, all of it is written.
    #[test]
    fn a_used_vector_changes_nothing(
        image in images(), center in [-10.0..30.0, -10.0..22.0], width in 2.0..60.0, shear in -0.3..0.3, upright: bool,
    ) {
        let mut map = Affine2::window(center, width, [24, 10]);
        map.matrix[0][1] = if upright { 0.0 } else { shear };
        for sampling in ALL {
            let rules = rules([24, 10], sampling);
            let mut used = vec![f32::NAN; 1000];
            network_input_into(&mut used, &image, &map, &rules, None);
            prop_assert_eq!(used, network_input(&image, &map, &rules, None));
        }
    }

    /// A linear ramp is what bilinear sampling keeps exactly.
    #[test]
    fn a_ramp_stays_a_ramp(center in [10.0..30.0, 8.0..12.0], width in 6.0..16.0) {
        let image = RgbImage::from_fn(41, 21, |x, y| image::Rgb([6 * x as u8, 12 * y as u8, 100]));
        let map = Affine2::window(center, width, [16, 4]);
        let inverse = map.inverse().unwrap();
        let input = network_input(&image, &map, &rules([16, 4], Sampling::PixelExact), None);
        for row in 0..4 {
            for column in 0..16 {
                let [x, y] = inverse.apply([column as f64, row as f64]);
                if !(0.0..=40.0).contains(&x) || !(0.0..=20.0).contains(&y) {
                    continue;
                }
                for (channel, expected) in [6.0 * x, 12.0 * y, 100.0].into_iter().enumerate() {
                    let found = input[channel * 64 + row * 16 + column];
                    let expected = (expected as f32 / 255.0 - CHANNEL_MEAN[channel]) / CHANNEL_STD[channel];
                    prop_assert!((found - expected).abs() < INPUT_TOLERANCE, "{} {}", found, expected);
                }
            }
        }
    }
}

fn black() -> [f32; 3] {
    [0, 1, 2].map(|channel| -CHANNEL_MEAN[channel] / CHANNEL_STD[channel])
}

#[test]
fn a_half_pixel_mirror_and_window_in_one_are_the_mirror_then_the_window() {
    let image =
        RgbImage::from_fn(40, 12, |x, y| image::Rgb([(x * 37 % 251) as u8, (y * 91 % 241) as u8, (x * y) as u8]));
    let rules = rules([32, 32], Sampling::HalfPixel);
    for width in [24.3, 40.0, 55.7] {
        let window = Affine2::window([18.0, 6.3], width, rules.size);
        let at_once = network_input(&image, &Affine2::mirror(40).then(&window), &rules, None);
        let one_by_one = network_input(&flip_horizontal(&image), &window, &rules, None);
        assert!(at_once.iter().zip(&one_by_one).all(|(a, b)| (a - b).abs() < ONE_LEVEL), "{width}");
    }
}

#[test]
fn what_lies_outside_is_black_even_after_the_jitter() {
    let image = RgbImage::from_pixel(8, 8, image::Rgb([255; 3]));
    let jitter = ColorJitter { brightness: 1.3, contrast: 0.5, saturation: 1.5, hue_rad: 0.2 };
    let outside = Affine2 { matrix: [[1.0, 0.0, 100.0], [0.0, 1.0, 0.0]] };
    let singular = Affine2 { matrix: [[0.0; 3]; 2] };
    for sampling in ALL {
        for map in [outside, singular] {
            let input = network_input(&image, &map, &rules([16, 4], sampling), Some(&jitter));
            assert_eq!(input.len(), 3 * 16 * 4);
            for (plane, black) in input.chunks_exact(64).zip(black()) {
                assert!(plane.iter().all(|value| (value - black).abs() < INPUT_TOLERANCE));
            }
        }
    }
}

#[test]
fn the_jitter_is_its_matrix_clipped() {
    let image = RgbImage::from_pixel(4, 4, image::Rgb([250, 120, 10]));
    let jitter = ColorJitter { brightness: 1.2, contrast: 1.4, saturation: 0.7, hue_rad: 0.1 };
    let rgb = [250.0, 120.0, 10.0].map(|v: f64| v / 255.0);
    let expected = jitter.matrix().map(|m| (m[0] * rgb[0] + m[1] * rgb[1] + m[2] * rgb[2] + m[3]).clamp(0.0, 1.0));
    for (channels, order) in [(ChannelOrder::Rgb, [0, 1, 2]), (ChannelOrder::Bgr, [2, 1, 0])] {
        let rules = InputRules { size: [4, 4], channels, sampling: Sampling::PixelExact };
        let input = network_input(&image, &Affine2::IDENTITY, &rules, Some(&jitter));
        for plane in 0..3 {
            // The constants keep their order, whichever colour the plane holds.
            let expected = (expected[order[plane]] as f32 - CHANNEL_MEAN[plane]) / CHANNEL_STD[plane];
            assert!((input[16 * plane + 5] - expected).abs() < INPUT_TOLERANCE, "{channels:?} {plane}");
        }
    }
}
