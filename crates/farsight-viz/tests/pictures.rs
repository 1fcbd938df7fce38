//! What the pictures promise, without comparing pixels one by one.
#![allow(clippy::unwrap_used, reason = "the helpers of a test may panic")]

use farsight_core::{Box2d, Box3d, Camera, Detection, Dimensions, Label, ObjectClass};
use farsight_viz::{
    ColorBy, DrawOptions, Names, Scene, annotate, annotate_named, birds_eye, picture, picture_divisor,
    picture_with_words,
};
use image::{Rgb, RgbImage};

const GREY: Rgb<u8> = Rgb([90, 90, 90]);

fn camera() -> Camera {
    Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap()
}

fn car(location: [f64; 3], yaw: f64) -> Detection {
    let dimensions = Dimensions { height: 1.5, width: 1.6, length: 3.9 };
    let box3d = Box3d { dimensions, location, yaw };
    Detection { class: ObjectClass::Car, score: 0.9, box2d: Box2d::new(0.0, 0.0, 1.0, 1.0), box3d, range_sigma_m: None }
}

fn changed(before: &RgbImage, after: &RgbImage) -> usize {
    before.pixels().zip(after.pixels()).filter(|(a, b)| a != b).count()
}

#[test]
fn an_image_without_detections_is_left_alone() {
    let image = RgbImage::from_pixel(1242, 375, GREY);
    let scene = Scene { camera: &camera(), detections: &[], truth: &[] };
    assert_eq!(annotate(&image, &scene, &DrawOptions::default()), image);
}

#[test]
fn a_detection_is_drawn_where_it_projects() {
    let image = RgbImage::from_pixel(1242, 375, GREY);
    let detection = car([-4.0, 1.65, 15.0], 0.4);
    let scene = Scene { camera: &camera(), detections: std::slice::from_ref(&detection), truth: &[] };
    let annotated = annotate(&image, &scene, &DrawOptions::default());
    let area = detection.box3d.projected(&camera()).unwrap();
    for [u, v] in detection.box3d.corners().map(|corner| camera().pixel_from_point(corner).unwrap()) {
        assert_ne!(*annotated.get_pixel(u.round() as u32, v.round() as u32), GREY, "corner at {u}, {v}");
    }
    // Box, label and legend are all; the road to the right of the box is as it was.
    assert_eq!(*annotated.get_pixel(area.x2 as u32 + 40, 300), GREY);
}

#[test]
fn what_lies_behind_the_camera_is_not_drawn_on_the_image() {
    let image = RgbImage::from_pixel(100, 60, GREY);
    let behind = [car([0.0, 1.65, -20.0], 0.4)];
    let scene = Scene { camera: &camera(), detections: &behind, truth: &[] };
    // A picture this small has no room for the legend either.
    assert_eq!(changed(&image, &annotate(&image, &scene, &DrawOptions::default())), 0);
}

#[test]
fn truth_is_drawn_and_regions_without_labels_are_not() {
    let image = RgbImage::from_pixel(1242, 375, GREY);
    let Detection { box2d, box3d, .. } = car([0.0, 1.65, 12.0], 1.0);
    let label = |class| Label { class, truncation: 0.0, occlusion: 0, alpha: 0.0, box2d, box3d };
    let drawn = |truth: &[Label]| {
        let scene = Scene { camera: &camera(), detections: &[], truth };
        changed(&image, &annotate(&image, &scene, &DrawOptions::default()))
    };
    assert!(drawn(&[label(ObjectClass::Car)]) > 0);
    assert_eq!(drawn(&[label(ObjectClass::DontCare)]), 0);
}

#[test]
fn no_size_and_no_box_makes_it_panic() {
    let odd = [
        car([2.2, 1.65, 1.0], -1.57),
        car([0.0, 1.65, 0.0], 0.0),
        car([0.0, 1.65, -6.0], 0.0),
        car([f64::NAN, 1.0, 10.0], 0.0),
        car([1e30, 1.0, 1e30], f64::INFINITY),
        Detection { range_sigma_m: Some(1e12), ..car([0.0, 0.0, 1e-9], 0.0) },
    ];
    let scene = Scene { camera: &camera(), detections: &odd, truth: &[] };
    for size @ [width, height] in [[0, 0], [0, 9], [1, 1], [1, 400], [400, 1], [32, 32], [1242, 375]] {
        let image = RgbImage::from_pixel(width, height, GREY);
        for color_by in [ColorBy::Distance, ColorBy::Class] {
            let options = DrawOptions { color_by, ..DrawOptions::default() };
            assert_eq!(annotate(&image, &scene, &options).dimensions(), (width, height));
            assert_eq!(birds_eye(&scene, size, size, &options).width(), if height == 0 { 0 } else { width });
            picture(&image, &scene, &options);
        }
    }
}

#[test]
fn a_wide_image_has_the_panel_below_and_others_beside() {
    let scene = Scene { camera: &camera(), detections: &[], truth: &[] };
    let composed = |width, height| picture(&RgbImage::new(width, height), &scene, &DrawOptions::default()).dimensions();
    let (width, height) = composed(1242, 375);
    assert!(width == 1242 && height > 2 * 375);
    let (width, height) = composed(1920, 1080);
    assert!(width > 1920 && height == 1080);
}

#[test]
fn pictures_are_as_large_as_their_images_and_not_as_their_longer_side_squared() {
    // Ordinary sizes are drawn as they are.
    for size in [[1242, 375], [1920, 1080], [3840, 2160], [3999, 2999], [2000, 5000], [100, 3000]] {
        assert_eq!(picture_divisor(size), 1, "{size:?}");
    }
    assert_eq!([[4000, 3000], [4032, 3024], [12_000, 9000]].map(picture_divisor), [2, 2, 4]);
    let scene = Scene { camera: &camera(), detections: &[], truth: &[] };
    for size @ [width, height] in [[100, 20_000], [20_000, 100], [1, 60_000], [3000, 4500]] {
        let image = RgbImage::from_pixel(width, height, GREY);
        let drawn = picture(&image, &scene, &DrawOptions::default());
        let pixels = u64::from(drawn.width()) * u64::from(drawn.height());
        assert!(pixels <= 2 * u64::from(width * height) + 8_000_000, "{size:?}: {:?}", drawn.dimensions());
    }
}

#[test]
fn in_a_smaller_picture_boxes_are_where_they_are_in_the_image() {
    let image = RgbImage::from_pixel(6000, 3000, GREY);
    let camera = Camera::from_hfov(60.0, 6000, 3000).unwrap();
    let detection = car([-4.0, 1.65, 15.0], 0.4);
    let scene = Scene { camera: &camera, detections: std::slice::from_ref(&detection), truth: &[] };
    let drawn = picture(&image, &scene, &DrawOptions::default());
    assert_eq!(picture_divisor([6000, 3000]), 2);
    for corner in detection.box3d.corners() {
        let [u, v] = camera.pixel_from_point(corner).unwrap().map(|at| (f64::midpoint(at, 0.5) - 0.5).round() as u32);
        assert_ne!(*drawn.get_pixel(u, v), GREY, "corner at {u}, {v}");
    }
    assert_eq!(*drawn.get_pixel(2900, 1400), GREY);
}

#[test]
fn names_are_written_on_detections_and_on_the_truth() {
    let image = RgbImage::from_pixel(1242, 375, GREY);
    let (left, right) = (car([-6.0, 1.65, 15.0], 0.4), car([6.0, 1.65, 15.0], 0.4));
    let Detection { box2d, box3d, class, .. } = right;
    let truth = [Label { class, truncation: 0.0, occlusion: 0, alpha: 0.0, box2d, box3d }];
    let camera = camera();
    let scene = Scene { camera: &camera, detections: &[left], truth: &truth };
    let drawn = |detections: &[&str], truth: &[&str]| {
        let [detections, truth] =
            [detections, truth].map(|names| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>());
        annotate_named(&image, &scene, &DrawOptions::default(), &Names { detections: &detections, truth: &truth })
    };
    // Each name changes its own half of the image.
    let half = |picture: &RgbImage, x: u32| image::imageops::crop_imm(picture, x, 0, 621, 375).to_image();
    let (plain, with_detection, with_truth) = (drawn(&[], &[]), drawn(&["d7"], &[]), drawn(&[], &["g7"]));
    assert!(changed(&half(&plain, 0), &half(&with_detection, 0)) > 500);
    assert_eq!(half(&plain, 621), half(&with_detection, 621));
    assert!(changed(&half(&plain, 621), &half(&with_truth, 621)) > 500);
    assert_ne!(drawn(&["d7"], &["g7"]), drawn(&["d8"], &["g7"]));
}

#[test]
fn words_are_written_on_their_detections() {
    let image = RgbImage::from_pixel(1242, 375, GREY);
    let detections = [car([-6.0, 1.65, 15.0], 0.4), car([6.0, 1.65, 15.0], 0.4)];
    let camera = camera();
    let scene = Scene { camera: &camera, detections: &detections, truth: &[] };
    let drawn = |words: [&str; 2]| {
        let words = words.map(str::to_owned);
        let whole = picture_with_words(&image, &scene, &DrawOptions::default(), &words);
        [0, 621].map(|x| image::imageops::crop_imm(&whole, x, 0, 621, 375).to_image())
    };
    let ([left, right], [other_left, other_right]) = (drawn(["#1 Car", "#2 Car"]), drawn(["#1 Car", "#3 Car"]));
    assert_eq!(left, other_left);
    assert_ne!(right, other_right);
}
