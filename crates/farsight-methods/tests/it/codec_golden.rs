//! The codec, the transforms and the projections against an independent implementation (golden `codec200`).

use std::f64::consts::PI;

use farsight_core::DepthReference;
use farsight_core::{Affine2, Box2d, Box3d, Camera, ClassReference, Dimensions, wrapped_angle};
use farsight_data::Transform;
use farsight_methods::smoke::Codec;
use farsight_methods::smoke::codec::{Encoded, Regression};
use farsight_methods::smoke::targets::feature_camera;

use farsight_testing::Golden;

const METRE_TOLERANCE: f64 = 1e-3;
const ANGLE_TOLERANCE: f64 = 1e-4;
/// The golden's matrices are f32, so pixels are good to about 1e-3.
const PIXEL_TOLERANCE: f64 = 2e-3;
const MATRIX_TOLERANCE: f64 = 1e-4;
const INPUT_SIZE: [usize; 2] = [1280, 384];
const FEATURE_SIZE: [f64; 2] = [320.0, 96.0];

fn assert_close(name: &str, row: usize, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    let close = found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance);
    assert!(close, "row {row}, {name}: {found:?}, expected {expected:?}");
}

fn flat_matrix(map: &Affine2) -> [f64; 9] {
    let [[a, b, c], [d, e, f]] = map.matrix;
    [a, b, c, d, e, f, 0.0, 0.0, 1.0]
}

fn camera([fx, _, cx, _, fy, cy, ..]: [f64; 9]) -> Camera {
    Camera::from_intrinsics(fx, fy, cx, cy).unwrap()
}

fn edges(b: &Box2d) -> [f64; 4] {
    [b.x1, b.y1, b.x2, b.y2]
}

#[test]
fn transforms_projections_and_both_directions_of_the_code_agree() {
    let golden = Golden::open("codec200");
    let codec = Codec { classes: ClassReference::smoke(), depth: DepthReference::KITTI };
    let [sizes, cells] = ["image_size", "ipt"].map(|name| golden.integers(name).as_chunks::<2>().0.to_vec());
    let [classes, flips] = ["cls", "flip"].map(|name| golden.integers(name));
    let windows = golden.rows::<3>("center_size");
    let [input_maps, feature_maps, cameras, original_cameras] =
        ["trans_input", "trans_feat", "K", "K_original"].map(|name| golden.rows::<9>(name));
    let [locations, originals, dimensions, decoded_dimensions, decoded_locations] =
        ["loc", "loc_original", "lhw", "dec_lhw", "dec_loc"].map(|name| golden.rows::<3>(name));
    let [yaws, original_yaws, decoded_yaws, decoded_alphas] =
        ["ry", "ry_original", "dec_ry", "dec_alpha"].map(|name| golden.numbers(name));
    let [pixels, cells_exact] = ["center_uv", "center_feat"].map(|name| golden.rows::<2>(name));
    let [boxes, feature_boxes] = ["box_uv", "box_feat"].map(|name| golden.rows::<4>(name));
    let regressions = golden.rows::<8>("reg");
    let corners = golden.rows::<24>("corners_true_heading");

    for i in 0..200 {
        let image_size = sizes[i];
        let [length, height, width] = dimensions[i];
        let dimensions_of = Dimensions { height, width, length };
        let original = Box3d { dimensions: dimensions_of, location: originals[i], yaw: original_yaws[i] };
        let [center_x, center_y, window_width] = windows[i];
        let transform = Transform {
            mirror: flips[i] == 1,
            window: Affine2::window([center_x, center_y], window_width, INPUT_SIZE),
            jitter: None,
            reflections: None,
            shadow: None,
            sharpness: None,
            degradation: None,
            scaled: false,
            regress: true,
        };
        assert_close("T_in", i, &flat_matrix(&transform.window), &input_maps[i], MATRIX_TOLERANCE);
        let feature_map = transform.window.then(&Affine2::scaling(0.25));
        assert_close("T_f", i, &flat_matrix(&feature_map), &feature_maps[i], MATRIX_TOLERANCE);

        let mirrored = |camera: Camera| if transform.mirror { camera.mirrored(image_size[0]) } else { camera };
        let seen = mirrored(camera(original_cameras[i]));
        let expected = camera(cameras[i]);
        assert_close("K", i, seen.projection.as_flattened(), expected.projection.as_flattened(), METRE_TOLERANCE);

        let object = if transform.mirror { original.mirrored() } else { original };
        assert_close("location", i, &object.location, &locations[i], METRE_TOLERANCE);
        assert!(wrapped_angle(object.yaw - yaws[i]).abs() < ANGLE_TOLERANCE, "row {i}");
        let found: Vec<f64> = (0..3).flat_map(|axis| object.corners().map(|corner| corner[axis])).collect();
        assert_close("corners", i, &found, &corners[i], METRE_TOLERANCE);

        let center = seen.pixel_from_point(object.center()).unwrap();
        assert_close("centre", i, &center, &pixels[i], PIXEL_TOLERANCE);
        assert_close("box", i, &edges(&object.projected(&seen).unwrap()), &boxes[i], 2.0 * PIXEL_TOLERANCE);

        let feature = feature_camera(&transform.camera(&camera(original_cameras[i]), image_size[0]));
        let center = feature.pixel_from_point(object.center()).unwrap();
        assert_close("cell", i, &center, &cells_exact[i], PIXEL_TOLERANCE);
        let extent = object.projected(&feature).unwrap().clamped(FEATURE_SIZE[0] - 1.0, FEATURE_SIZE[1] - 1.0);
        assert_close("box in the map", i, &edges(&extent), &feature_boxes[i], PIXEL_TOLERANCE);

        let encoded = codec.encode(&object, classes[i], &feature).unwrap();
        assert_eq!(encoded.cell, cells[i], "row {i}");
        let Regression { depth, offset, log_dimensions_lhw: [l, h, w], direction } = encoded.regression;
        let target = [depth, offset[0], offset[1], l, h, w, direction[0], direction[1]];
        assert_close("targets", i, &target, &regressions[i], METRE_TOLERANCE);

        let regression = Regression::from_activated(regressions[i]);
        let decoded = codec.decode(&Encoded { cell: cells[i], regression }, classes[i], &feature);
        let Dimensions { height, width, length } = decoded.dimensions;
        assert_close("size", i, &[length, height, width], &decoded_dimensions[i], METRE_TOLERANCE);
        assert_close("place", i, &decoded.location, &decoded_locations[i], METRE_TOLERANCE);
        assert!(wrapped_angle(decoded.yaw - decoded_yaws[i]).abs() < ANGLE_TOLERANCE, "row {i}");
        assert!(wrapped_angle(regression.alpha() - decoded_alphas[i]).abs() < ANGLE_TOLERANCE, "row {i}");
    }
}

#[test]
fn the_official_flip_is_the_true_heading_turned_by_half_a_turn() {
    let golden = Golden::open("codec200");
    let [yaws, labels] = ["ry", "ry_label"].map(|name| golden.numbers(name));
    for (i, flip) in golden.integers("flip").into_iter().enumerate() {
        let turn = if flip == 1 { PI } else { 0.0 };
        assert!(wrapped_angle(yaws[i] - labels[i] - turn).abs() < ANGLE_TOLERANCE, "row {i}");
    }
}
