//! Image, camera and labels move together.

use std::f64::consts::PI;
use std::path::Path;

use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_core::{Affine2, Box2d, Box3d, Camera, Label, ObjectClass, wrapped_angle};
use farsight_data::annotations::DepthMap;
use farsight_data::kitti::RowKind;
use farsight_data::kitti::rows::rows_from_text;
use farsight_data::{AugmentationConfig, Frame, ItemKey, Transform};
use image::RgbImage;

use crate::material::{IMAGE_SIZE, all_views};

const PIXEL_TOLERANCE: f64 = 1e-9;
const ANGLE_TOLERANCE: f64 = 1e-12;
/// Nearer corners project to millions of pixels.
const NEAR_M: f64 = 1.0;
/// Corner of the mirrored box that the mirror image of each corner is: left and right change places.
const MIRRORED_CORNER: [usize; 8] = [5, 4, 3, 2, 1, 0, 7, 6];
const RULES: InputRules = InputRules { size: [1280, 384], channels: ChannelOrder::Rgb, sampling: Sampling::PixelExact };

/// Every transform that the policy draws, often.
fn lively() -> AugmentationConfig {
    AugmentationConfig { shift_scale_probability: 0.7, ..AugmentationConfig::default() }
}

#[test]
fn moved_labels_project_to_moved_pixels() {
    let Some(views) = all_views() else { return };
    let policy = lively();
    let mut seen = [0; 4];
    for (index, view) in views.iter().enumerate() {
        let transform = policy.draw(&mut ItemKey { epoch: 0, index, seed: 1 }.rng(), IMAGE_SIZE, &RULES);
        seen[usize::from(transform.mirror) + 2 * usize::from(transform.scaled)] += 1;
        let camera = transform.camera(&view.camera, IMAGE_SIZE[0]);
        let map = transform.input_from_image(IMAGE_SIZE[0]);
        for label in view.labels.iter().filter(|label| label.class != ObjectClass::DontCare) {
            let moved = transform.label(label, IMAGE_SIZE[0], RULES.size);
            let corners = moved.box3d.corners();
            for (number, corner) in label.box3d.corners().into_iter().enumerate().filter(|(_, c)| c[2] > NEAR_M) {
                let expected = map.apply(view.camera.pixel_from_point(corner).unwrap());
                let number = if transform.mirror { MIRRORED_CORNER[number] } else { number };
                let found = camera.pixel_from_point(corners[number]).unwrap();
                let difference = (0..2).map(|i| (found[i] - expected[i]).abs()).fold(0.0, f64::max);
                assert!(difference < PIXEL_TOLERANCE, "{}: {found:?} {expected:?} {transform:?}", view.id);
            }
            let turn = wrapped_angle(moved.box3d.alpha() - moved.alpha);
            let annotated = wrapped_angle(label.box3d.alpha() - label.alpha);
            let sign = if transform.mirror { -1.0 } else { 1.0 };
            assert!(wrapped_angle(turn - sign * annotated).abs() < ANGLE_TOLERANCE, "{}", view.id);
        }
    }
    assert!(seen.iter().all(|count| *count > 500), "{seen:?}");
}

fn label(row: &str) -> Label {
    rows_from_text(row, Path::new("row"), RowKind::Label).unwrap().remove(0).label
}

fn car() -> Label {
    label("Car 0.10 1 -1.58 600.00 170.00 700.00 250.00 1.50 1.60 4.00 2.00 1.70 15.00 -1.45")
}

fn dont_care() -> Label {
    label("DontCare -1 -1 -10 10.00 20.00 30.00 40.00 -1 -1 -1 -1000 -1000 -1000 -10")
}

fn mirror() -> Transform {
    let identity = Transform::identity(IMAGE_SIZE, &RULES);
    Transform { mirror: true, window: Affine2::IDENTITY, ..identity }
}

#[test]
fn mirroring_twice_gives_the_label_back() {
    let once = mirror().label(&car(), 1242, IMAGE_SIZE);
    assert_eq!(once.box2d, Box2d::new(541.0, 170.0, 641.0, 250.0));
    assert!((once.alpha - (1.58 - PI)).abs() < ANGLE_TOLERANCE);
    let twice = mirror().label(&once, 1242, IMAGE_SIZE);
    assert_eq!(twice.box2d, car().box2d);
    assert!((twice.box3d.yaw - car().box3d.yaw).abs() < ANGLE_TOLERANCE);
    assert_eq!(Box3d { yaw: car().box3d.yaw, ..twice.box3d }, car().box3d);
}

#[test]
fn dont_care_rows_move_in_the_image_only() {
    let moved = mirror().label(&dont_care(), 1242, IMAGE_SIZE);
    assert_eq!(moved.box2d, Box2d::new(1211.0, 20.0, 1231.0, 40.0));
    assert_eq!(Label { box2d: dont_care().box2d, ..moved }, dont_care());
}

#[test]
fn boxes_are_clipped_to_the_input() {
    let mut transform = Transform::identity(IMAGE_SIZE, &RULES);
    transform.window = Affine2::window([650.0, 187.5], 60.0, RULES.size);
    assert_eq!(transform.label(&car(), 1242, RULES.size).box2d, Box2d::new(0.0, 0.0, 1279.0, 383.0));
    assert!(transform.label(&dont_care(), 1242, RULES.size).box2d.area() == 0.0);
}

#[test]
fn a_sample_is_the_frame_moved() {
    let camera = Camera::from_intrinsics(700.0, 700.0, 600.0, 180.0).unwrap();
    let image = RgbImage::from_pixel(1242, 375, image::Rgb([90, 100, 110]));
    let depth_m = (0..1242 * 375).map(|pixel| (pixel % 1242) as f32).collect();
    let frame = Frame::new("000042", image, camera, vec![car(), dont_care()]).with(DepthMap { depth_m });
    let transform = lively().draw(&mut ItemKey { epoch: 3, index: 4, seed: 5 }.rng(), IMAGE_SIZE, &RULES);
    let sample = transform.apply(&frame, &RULES);
    assert_eq!((sample.id.as_str(), sample.size, sample.input.len()), ("000042", RULES.size, 3 * 1280 * 384));
    assert_eq!(sample.camera, transform.camera(&camera, 1242));
    assert_eq!(sample.labels[0], transform.label(&car(), 1242, RULES.size));
    assert_eq!(sample.input, transform.input(&frame.image, &RULES));

    // The depth of this frame is the number of the column, so it must be where the inverse of the transform looks.
    let surface = transform.surface_m(&frame, &RULES, 4).unwrap();
    assert_eq!(surface.len(), 320 * 96);
    let image_from_input = transform.input_from_image(1242).inverse().unwrap();
    let mut seen = 0;
    for (cell, &depth) in surface.iter().enumerate().filter(|(_, depth)| depth.is_finite()) {
        let pixel = image_from_input.apply([(cell % 320 * 4) as f64 + 1.5, (cell / 320 * 4) as f64 + 1.5]);
        assert!((f64::from(depth) - pixel[0]).abs() <= 0.5 + 1e-9, "cell {cell}: {depth}, not {pixel:?}");
        seen += 1;
    }
    assert!(seen > surface.len() / 2, "{seen} cells see the image");
}

#[test]
fn reflections_shadows_sharpness_and_degradations_change_pixels_and_neither_camera_nor_labels() {
    let image =
        RgbImage::from_fn(1242, 375, |x, y| image::Rgb([(x % 256) as u8, (y % 256) as u8, ((x * y) % 256) as u8]));
    let frame = Frame::new("0", image, Camera::from_hfov(80.0, 1242, 375).unwrap(), vec![car(), dont_care()]);
    let always = AugmentationConfig {
        reflection_probability: 1.0,
        shadow_probability: 1.0,
        sharpness_probability: 1.0,
        degradation_probability: 1.0,
        ..lively()
    };
    for index in 0..5 {
        let drawn = always.draw(&mut ItemKey { epoch: 0, index, seed: 3 }.rng(), IMAGE_SIZE, &RULES);
        // Drawn last, so that what others draw does not depend on them.
        let without = Transform { reflections: None, shadow: None, sharpness: None, degradation: None, ..drawn };
        assert_eq!(without, lively().draw(&mut ItemKey { epoch: 0, index, seed: 3 }.rng(), IMAGE_SIZE, &RULES));
        let (with, plain) = (drawn.apply(&frame, &RULES), without.apply(&frame, &RULES));
        for one in [
            Transform { reflections: drawn.reflections, ..without },
            Transform { shadow: drawn.shadow, ..without },
            Transform { sharpness: drawn.sharpness, ..without },
            Transform { degradation: drawn.degradation, ..without },
        ] {
            assert_ne!(one.apply(&frame, &RULES).input, plain.input);
        }
        assert_eq!((with.camera, with.labels), (plain.camera, plain.labels));
    }
    for wrong in [
        AugmentationConfig { reflection_probability: 1.5, ..lively() },
        AugmentationConfig { reflection_strength: -0.1, ..lively() },
        AugmentationConfig { shadow_probability: 2.0, ..lively() },
        AugmentationConfig { sharpness_probability: -0.1, ..lively() },
        AugmentationConfig { sharpness_factor: 0.9, ..lively() },
        AugmentationConfig { degradation_probability: 1.1, ..lively() },
    ] {
        let names = ["reflection_", "shadow_", "sharpness_", "degradation_"];
        assert!(wrong.problem().is_some_and(|problem| names.iter().any(|name| problem.starts_with(name))));
    }
}

#[test]
fn the_policy_draws_its_shares() {
    const DRAWS: usize = 20_000;
    let policy = AugmentationConfig::default();
    let mut rng = ItemKey { epoch: 0, index: 0, seed: 7 }.rng();
    let drawn: Vec<_> = (0..DRAWS).map(|_| policy.draw(&mut rng, IMAGE_SIZE, &RULES)).collect();
    let share = |holds: fn(&Transform) -> bool| drawn.iter().filter(|t| holds(t)).count() as f64 / DRAWS as f64;
    for (name, found, expected) in [
        ("mirrored", share(|t| t.mirror), 0.5),
        ("scaled", share(|t| t.scaled), 0.3),
        ("jittered", share(|t| t.jitter.is_some()), 0.5),
        ("regressed", share(|t| t.regress), 1.0),
    ] {
        assert!((found - expected).abs() < 0.02, "{name}: {found}");
    }
    let scales: Vec<f64> = drawn.iter().filter(|t| t.scaled).map(|t| 1280.0 / 1242.0 / t.window.matrix[0][0]).collect();
    for step in policy.scale_steps {
        assert!(scales.iter().any(|scale| (scale - step).abs() < 1e-9), "{step}");
    }
    let factors = drawn.iter().filter_map(|t| t.jitter).flat_map(|j| [j.brightness, j.contrast, j.saturation]);
    assert!(factors.into_iter().all(|factor| (0.8..=1.2).contains(&factor)));
}

#[test]
fn the_official_switch_masks_scaled_images_alone() {
    let policy = AugmentationConfig { mask_scaled_regression: true, ..AugmentationConfig::default() };
    let mut rng = ItemKey { epoch: 0, index: 0, seed: 7 }.rng();
    for _ in 0..200 {
        let transform = policy.draw(&mut rng, IMAGE_SIZE, &RULES);
        assert_eq!(transform.regress, !transform.scaled);
    }
}

#[test]
fn no_augmentation_is_the_identity() {
    let mut rng = ItemKey { epoch: 0, index: 0, seed: 7 }.rng();
    let drawn = AugmentationConfig::none().draw(&mut rng, IMAGE_SIZE, &RULES);
    assert_eq!(drawn, Transform::identity(IMAGE_SIZE, &RULES));
}

#[test]
fn configurations_are_read_strictly_and_checked() {
    let read = |text: &str| serde_json::from_str::<AugmentationConfig>(text);
    assert_eq!(read("{}").unwrap(), AugmentationConfig::default());
    assert!(read(r#"{"flip_probabilty": 0.5}"#).is_err());
    // Configs of older runs have older names.
    let old =
        r#"{"window_probability": 0.1, "shade_probability": 0.2, "detail_probability": 0.3, "detail_factor": 2.5}"#;
    let expected = AugmentationConfig {
        shift_scale_probability: 0.1,
        shadow_probability: 0.2,
        sharpness_probability: 0.3,
        sharpness_factor: 2.5,
        ..AugmentationConfig::default()
    };
    assert_eq!(read(old).unwrap(), expected);
    let default = AugmentationConfig::default();
    assert_eq!(default.problem(), None);
    let cases = [
        (
            AugmentationConfig { flip_probability: 1.5, ..default.clone() },
            "flip_probability is 1.5; expected a number from 0 to 1",
        ),
        (
            AugmentationConfig { contrast: f64::NAN, ..default.clone() },
            "contrast is NaN; expected a number from 0 to 1",
        ),
        (
            AugmentationConfig { scale_steps: vec![], ..default.clone() },
            "scale_steps is empty; expected at least one positive number",
        ),
        (
            AugmentationConfig { scale_steps: vec![0.0], ..default.clone() },
            "scale_steps has 0; expected positive number",
        ),
        (AugmentationConfig { hue_rad: 4.0, ..default }, "hue_rad is 4; expected radians from 0 to pi"),
    ];
    for (config, expected) in cases {
        assert_eq!(config.problem().as_deref(), Some(expected));
    }
}
