//! Laws of SMOKE's targets, codec, corner loss and decoder.

use std::f64::consts::PI;

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::heatmap::HeatmapRule;
use farsight_core::{
    Affine2, Box2d, Box3d, Camera, ClassReference, DepthReference, Dimensions, Label, ObjectClass, ScoreCalibration,
};
use farsight_methods::smoke::codec::CHANNELS;
use farsight_methods::smoke::corner_loss::corner_loss;
use farsight_methods::smoke::decode::detections;
use farsight_methods::smoke::targets::{HeatmapBox, ObjectTarget, TargetRules};
use farsight_methods::smoke::{Codec, HeadMaps};
use proptest::prelude::*;

const EXACT: f64 = 1e-9;

/// A camera with a fourth column, as KITTI's.
fn kitti_like() -> Camera {
    let projection =
        [[721.5377, 0.0, 609.5593, 44.857], [0.0, 721.5377, 172.854, 0.2164], [0.0, 0.0, 1.0, 0.002_745_9]];
    Camera::from_projection(projection).unwrap()
}

fn box3d(location: [f64; 3], yaw: f64) -> Box3d {
    Box3d { dimensions: Dimensions { height: 1.5, width: 1.6, length: 3.9 }, location, yaw }
}

#[test]
fn targets_are_objects_of_known_classes_whose_centre_is_in_the_image() {
    let rules = TargetRules {
        codec: Codec { classes: ClassReference::smoke(), depth: DepthReference::KITTI },
        heatmap: HeatmapRule::SMOKE,
        heatmap_box: HeatmapBox::Projected,
    };
    let label = |class, x| Label {
        class,
        truncation: 0.0,
        occlusion: 0,
        alpha: 0.0,
        box2d: Box2d::new(0.0, 0.0, 10.0, 10.0),
        box3d: box3d([x, 1.6, 20.0], 0.3),
    };
    let labels = [
        label(ObjectClass::Car, 0.0),
        label(ObjectClass::Van, 3.0),
        label(ObjectClass::Car, 40.0),
        label(ObjectClass::Pedestrian, -3.0),
    ];
    let targets = rules.targets(&labels, &kitti_like(), [1248, 384]);
    let classes: Vec<usize> = targets.objects.iter().map(|o| o.class).collect();
    assert_eq!(classes, [0, 2]);
    assert_eq!(targets.map_size, [312, 96]);
    let ones = targets.heatmap.iter().filter(|v| **v >= 1.0).count();
    assert_eq!(ones, 2);
}

#[test]
fn with_virtual_depth_twice_the_focal_length_means_twice_the_distance() {
    let depth = DepthReference { focal_px: Some(700.0), ..DepthReference::KITTI };
    let codec = Codec { classes: ClassReference::smoke(), depth };
    let focal = |f: f64| Camera::from_intrinsics(f, f, 160.0, 48.0).unwrap();
    let encoded = |z: f64, camera: &Camera| codec.encode(&box3d([0.0, 1.6, z], 0.3), 0, camera).unwrap();
    // The feature map's focal length is a quarter of the input's.
    let (normal, long) = (focal(175.0), focal(350.0));
    let near = encoded(20.0, &normal).regression.depth;
    assert!((near - (20.0 - depth.mean_m) / depth.std_m).abs() < EXACT, "the reference focal length changes nothing");
    assert!((encoded(40.0, &long).regression.depth - near).abs() < EXACT);
    let back = codec.decode(&encoded(40.0, &long), 0, &long);
    assert!((back.location[2] - 40.0).abs() < EXACT, "{back:?}");
}

/// The raw channels that decode to `object`, and what is to be learnt where it lies.
fn raw_and_target(codec: &Codec, object: Box3d, camera: &Camera) -> ([f64; CHANNELS], ObjectTarget) {
    let encoded = codec.encode(&object, 0, camera).unwrap();
    let regression = encoded.regression;
    let [length, height, width] = regression.log_dimensions_lhw.map(|log| ((0.5 + log) / (0.5 - log)).ln());
    let ([dx, dy], [cos, sin]) = (regression.offset, regression.direction);
    let raw = [regression.depth, dx, dy, length, height, width, cos, sin];
    (raw, ObjectTarget { class: 0, cell: encoded.cell, box3d: object })
}

#[test]
fn in_the_image_a_larger_car_farther_away_is_no_error_and_a_larger_one_is() {
    let codec = Codec { classes: ClassReference::smoke(), depth: DepthReference::KITTI };
    let camera = Camera::from_hfov(80.0, 320, 96).unwrap();
    let object = box3d([-4.0, 1.6, 18.0], 0.7);
    let (_, target) = raw_and_target(&codec, object, &camera);
    let Dimensions { height, width, length } = object.dimensions;
    let larger = Dimensions { height: 1.1 * height, width: 1.1 * width, length: 1.1 * length };
    let loss = |object: Box3d| corner_loss(&codec, raw_and_target(&codec, object, &camera).0, &target, &camera);

    assert!(loss(object).sum().value < EXACT);
    let farther = loss(Box3d { dimensions: larger, location: object.location.map(|v| 1.1 * v), yaw: object.yaw });
    assert!(farther.image.value < EXACT);
    assert!(farther.location.value > 8.0 * 1.8 - EXACT && farther.dimensions.value > 1.0);
    // In the same place: its centre stays where it was, so its feet sink.
    let [x, y, z] = object.location;
    let grown = loss(Box3d { dimensions: larger, location: [x, y + 0.05 * height, z], yaw: object.yaw });
    assert!(grown.image.value > 0.5 && grown.location.value < 8.0 * 0.05 * height + EXACT);
}

proptest! {
    #[test]
    fn the_gradient_of_the_loss_in_the_image_is_its_slope(ray in -1.5..1.5, z in 3.0..50.0, yaw in -PI..PI, change in prop::array::uniform8(-0.3..0.3)) {
        const STEP: f64 = 1e-6;
        let codec = Codec { classes: ClassReference::smoke(), depth: DepthReference::KITTI };
        let camera = Camera::from_hfov(120.0, 320, 96).unwrap();
        let (raw, target) = raw_and_target(&codec, box3d([ray * z, 1.6, z], yaw), &camera);
        let raw: [f64; CHANNELS] = std::array::from_fn(|channel| raw[channel] + change[channel]);
        let found = corner_loss(&codec, raw, &target, &camera).image;
        for channel in 0..CHANNELS {
            let at = |step: f64| {
                let mut moved = raw;
                moved[channel] += step;
                corner_loss(&codec, moved, &target, &camera).image.value
            };
            let slopes = [(at(STEP) - found.value) / STEP, (found.value - at(-STEP)) / STEP];
            // Not where a difference changes its sign or a corner passes the limit in between.
            prop_assume!((slopes[0] - slopes[1]).abs() < 1e-3 * (1.0 + slopes[0].abs()));
            let difference = (found.gradient[channel] - slopes[0]).abs();
            prop_assert!(difference < 2e-3 * (1.0 + slopes[0].abs()), "channel {channel}: {} and {slopes:?}", found.gradient[channel]);
        }
    }
}

#[test]
fn calibrated_scores_put_a_large_box_with_a_low_peak_before_a_small_one_with_a_high_peak() {
    let (map_size, image_size) = ([160, 48], [640, 192]);
    let camera = Camera::from_intrinsics(372.0, 372.0, 320.0, 96.0).unwrap();
    let view = View { image_size, camera, input_camera: camera };
    let mut codec = Codec { classes: ClassReference::smoke(), depth: DepthReference::KITTI };
    let area = map_size[0] * map_size[1];
    let mut maps = HeadMaps { logits: vec![-9.0; 3 * area], regression: vec![0.0; CHANNELS * area], map_size };
    // Peak and depth of a near car on the left and of a far one on the right.
    for (cell, logit, depth_m) in [(24 * 160 + 50, -2.0, 9.0), (24 * 160 + 110, 0.5, 45.0)] {
        maps.logits[cell] = logit;
        maps.regression[cell] = ((depth_m - codec.depth.mean_m) / codec.depth.std_m) as f32;
        maps.regression[7 * area + cell] = 1.0;
    }
    let depths = |codec: &Codec, min_score: f64| {
        let min_score = Some(min_score);
        let found = detections(codec, &maps, &view, &DecodeOptions { min_score, ..DecodeOptions::default() });
        found.iter().map(|d| (d.box3d.depth_m().round(), d.score)).collect::<Vec<_>>()
    };
    let peak = |logit: f64| 1.0 / (1.0 + (-logit).exp());
    let plain = depths(&codec, 0.05);
    assert_eq!(plain.iter().map(|d| d.0).collect::<Vec<_>>(), [45.0, 9.0]);
    assert!((plain[1].1 - peak(-2.0)).abs() < 1e-6);

    let calibration =
        ScoreCalibration { peak: 1.0, height: 2.0, height_squared: 0.0, bias: 0.0, heights_px: [5.0, 100.0] };
    codec.classes[0].score = Some(calibration);
    // The low peak is above the limit once it is a probability.
    let fitted = depths(&codec, 0.3);
    assert_eq!(fitted.iter().map(|d| d.0).collect::<Vec<_>>(), [9.0, 45.0]);
    let near = detections(&codec, &maps, &view, &DecodeOptions::default()).remove(0);
    assert!((near.score - calibration.probability(peak(-2.0), near.box2d.height())).abs() < 1e-6);

    // Half the image's pixels in the input: half the height.
    let large =
        View { image_size: [1280, 384], camera: camera.transformed(&Affine2::scaling(2.0)), input_camera: camera };
    let same = detections(&codec, &maps, &large, &DecodeOptions::default()).remove(0);
    assert!((same.score - near.score).abs() < 0.01 && same.box2d.height() > 1.9 * near.box2d.height());
}

#[test]
fn of_more_objects_than_are_asked_for_the_likeliest_stay_whatever_their_peaks() {
    let (map_size, image_size) = ([160, 48], [640, 192]);
    let camera = Camera::from_intrinsics(372.0, 372.0, 320.0, 96.0).unwrap();
    let view = View { image_size, camera, input_camera: camera };
    let mut codec = Codec { classes: ClassReference::smoke(), depth: DepthReference::KITTI };
    codec.classes[0].score =
        Some(ScoreCalibration { peak: 1.0, height: 2.0, height_squared: 0.0, bias: 0.0, heights_px: [5.0, 100.0] });
    let area = map_size[0] * map_size[1];
    let mut maps = HeadMaps { logits: vec![-9.0; 3 * area], regression: vec![0.0; CHANNELS * area], map_size };
    // Twenty distant cars with high peaks, and a near one with the lowest.
    let far = (0..20).map(|i| (20 * 160 + 4 + 7 * i, 0.5, 60.0));
    for (cell, logit, depth_m) in far.chain([(40 * 160 + 80, -1.0, 8.0)]) {
        maps.logits[cell] = logit;
        maps.regression[cell] = ((depth_m - codec.depth.mean_m) / codec.depth.std_m) as f32;
        maps.regression[7 * area + cell] = 1.0;
    }
    let found = detections(
        &codec,
        &maps,
        &view,
        &DecodeOptions { min_score: Some(0.01), max_detections: 5, ..DecodeOptions::default() },
    );
    assert_eq!(found.len(), 5);
    assert!((found[0].box3d.depth_m() - 8.0).abs() < 0.1, "{:?}", found[0]);
}
