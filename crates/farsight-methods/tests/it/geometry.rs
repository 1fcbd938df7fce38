//! The geometry of the core crate over every camera and label of KITTI.

use farsight_core::DepthReference;
use farsight_core::{Affine2, Camera, ClassReference, Label, ObjectClass, wrapped_angle};
use farsight_methods::smoke::Codec;
use farsight_methods::smoke::targets::feature_camera;

use crate::material::{IMAGE_SIZE, all_views};

const PIXEL_TOLERANCE: f64 = 1e-9;
const METRE_TOLERANCE: f64 = 1e-6;
const ANGLE_TOLERANCE: f64 = 1e-9;
/// Objects of the three classes whose centre lies in a 1242 x 375 image.
const MIN_VISIBLE: usize = 30_000;

fn labelled(label: &Label) -> bool {
    label.class != ObjectClass::DontCare
}

/// Points that are farther in front of the camera than this; nearer ones project to millions of pixels.
const NEAR_M: f64 = 1.0;

#[test]
fn projection_commutes_with_crop_scale_pad_and_mirror() {
    let Some(views) = all_views() else { return };
    let [width, height] = IMAGE_SIZE.map(|side| side as f64);
    let crop = Affine2 { matrix: [[1.0, 0.0, -200.0], [0.0, 1.0, -35.5]] };
    let pad = Affine2 { matrix: [[1.0, 0.0, 19.0], [0.0, 1.0, 4.5]] };
    let window = Affine2::window([0.55 * width, 0.4 * height], 1.3 * width, [1280, 384]);
    let mirror = Affine2::mirror(IMAGE_SIZE[0]);
    let mut points = 0;
    for view in views {
        for label in view.labels.iter().filter(|label| labelled(label)) {
            for corner in label.box3d.corners().into_iter().filter(|corner| corner[2] > NEAR_M) {
                let pixel = view.camera.pixel_from_point(corner).unwrap();
                for map in [crop, pad, window, Affine2::scaling(0.25)] {
                    assert_same_pixel(&view.camera.transformed(&map), corner, map.apply(pixel), &view.id);
                }
                let mirrored = [-corner[0], corner[1], corner[2]];
                assert_same_pixel(&view.camera.mirrored(IMAGE_SIZE[0]), mirrored, mirror.apply(pixel), &view.id);
                points += 1;
            }
        }
    }
    assert!(points > 8 * MIN_VISIBLE, "{points}");
}

fn assert_same_pixel(camera: &Camera, point: [f64; 3], expected: [f64; 2], id: &str) {
    let [u, v] = camera.pixel_from_point(point).unwrap();
    let difference = (u - expected[0]).abs().max((v - expected[1]).abs());
    assert!(difference < PIXEL_TOLERANCE, "{id}: {point:?} at {u} {v}, expected {expected:?}");
}

#[test]
fn decode_inverts_encode_on_every_visible_object() {
    let Some(views) = all_views() else { return };
    let codec = Codec { classes: ClassReference::smoke(), depth: DepthReference::KITTI };
    let input = Affine2::window([621.0, 187.5], 1242.0, [1280, 384]);
    let mut visible = 0;
    for view in views {
        let camera = feature_camera(&view.camera.transformed(&input));
        for label in view.labels.iter().filter(|label| in_image(label, &view.camera)) {
            let Some(class) = codec.classes.iter().position(|c| c.class == label.class) else { continue };
            let Some(encoded) = codec.encode(&label.box3d, class, &camera) else {
                // The input cuts a pixel off the top and bottom of the image.
                continue;
            };
            let decoded = codec.decode(&encoded, class, &camera);
            let truth = &label.box3d;
            let metres = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < METRE_TOLERANCE);
            let sizes = [truth, &decoded].map(|b| [b.dimensions.height, b.dimensions.width, b.dimensions.length]);
            assert!(metres(truth.location, decoded.location), "{}: {truth:?} {decoded:?}", view.id);
            assert!(metres(sizes[0], sizes[1]), "{}: {truth:?} {decoded:?}", view.id);
            let turn = wrapped_angle(truth.yaw - decoded.yaw).abs();
            assert!(turn < ANGLE_TOLERANCE, "{}: {truth:?} {decoded:?}", view.id);
            visible += 1;
        }
    }
    assert!(visible > MIN_VISIBLE, "{visible}");
    println!("{visible} objects");
}

fn in_image(label: &Label, camera: &Camera) -> bool {
    let [width, height] = IMAGE_SIZE.map(|side| side as f64);
    let pixel = camera.pixel_from_point(label.box3d.center());
    labelled(label) && pixel.is_some_and(|[u, v]| (0.0..width).contains(&u) && (0.0..height).contains(&v))
}
