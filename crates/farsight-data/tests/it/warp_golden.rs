//! The warp against Pillow and OpenCV (golden `warp`).

use farsight_core::Affine2;
use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_data::{network_input, warp};
use farsight_testing::Golden;
use image::RgbImage;

const SIZE: [usize; 2] = [64, 20];
/// Pillow computes in f64, we in f32: a value within this of a whole number may be cut to either side of it.
const ROUNDING_TOLERANCE: f64 = 1e-3;
/// OpenCV rounds coordinates to 1/32 pixel; on this noisy image that is a few grey levels.
const OPENCV_TOLERANCE: u8 = 4;
const INPUT_TOLERANCE: f64 = 1e-5;

fn material(golden: &Golden, number: usize) -> (RgbImage, Affine2) {
    let image = RgbImage::from_raw(40, 24, golden.bytes("src_rgb")).unwrap();
    let [a, b, c, d, e, f, ..] = golden.rows::<9>(&format!("m{number}"))[0];
    (image, Affine2 { matrix: [[a, b, c], [d, e, f]] })
}

#[test]
fn half_pixel_is_pillow() {
    let golden = Golden::open("warp");
    for number in 0..4 {
        let (image, affine) = material(&golden, number);
        let warped = warp(&image, &affine, SIZE, Sampling::HalfPixel);
        let exact = golden.numbers(&format!("float{number}"));
        let pillow = golden.bytes(&format!("pil{number}"));
        for ((&found, &pillow), exact) in warped.as_raw().iter().zip(&pillow).zip(exact) {
            let between = (exact - exact.round()).abs() > ROUNDING_TOLERANCE;
            assert!(found.abs_diff(pillow) <= u8::from(!between), "warp {number}: {found} {pillow} {exact}");
        }
    }
}

#[test]
fn pixel_exact_is_opencv() {
    let golden = Golden::open("warp");
    for number in 0..4 {
        let (image, affine) = material(&golden, number);
        let warped = warp(&image, &affine, SIZE, Sampling::PixelExact);
        let opencv = golden.bytes(&format!("cv2_{number}"));
        let worst = warped.as_raw().iter().zip(&opencv).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(worst <= OPENCV_TOLERANCE, "warp {number}: {worst}");
    }
}

#[test]
fn the_network_input_is_official_smokes() {
    let golden = Golden::open("warp");
    let (image, affine) = material(&golden, 0);
    let rules = InputRules { size: SIZE, channels: ChannelOrder::Bgr, sampling: Sampling::HalfPixel };
    let input = network_input(&image, &affine, &rules, None);
    let expected = golden.numbers("net_input0");
    assert_eq!(input.len(), expected.len());
    let one_level = 1.0 / 255.0 / 0.224 + INPUT_TOLERANCE;
    let different = input.iter().zip(&expected).filter(|(a, b)| (f64::from(**a) - **b).abs() > INPUT_TOLERANCE);
    // A value on the edge of a whole number may be one level off; nothing else may differ.
    let different: Vec<_> = different.collect();
    assert!(different.iter().all(|(a, b)| (f64::from(**a) - **b).abs() < one_level), "{different:?}");
    assert!(different.len() * 100 <= input.len(), "{} of {}", different.len(), input.len());
}
