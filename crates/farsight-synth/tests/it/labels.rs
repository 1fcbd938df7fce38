//! Labels lie on the pixels of what they describe.

use crate::support::{CAMERA_HEIGHT_M, block, camera, empty, flat, ground, object, street};
use farsight_core::{Box2d, Box3d, Dimensions, Label, ObjectClass};
use farsight_data::kitti::RowKind;
use farsight_data::kitti::rows::{rows_from_text, text_from_labels};
use farsight_synth::labels::LabelRules;
use farsight_synth::render::{Rendered, render};
use farsight_synth::scene::{InstanceId, LabelledObject, Scene, Vec3};

fn labelled(bottom: Vec3, size: Vec3, instance: InstanceId) -> LabelledObject {
    let [width, height, length] = size.map(f64::from);
    let yaw = -std::f64::consts::FRAC_PI_2;
    let box3d = Box3d { dimensions: Dimensions { height, width, length }, location: bottom.map(f64::from), yaw };
    LabelledObject { class: ObjectClass::Car, box3d, instance, plate: None }
}

/// Blocks on the ground, their objects, the image and the labels.
fn labelled_scene(blocks: &[(Vec3, Vec3)]) -> (Scene, Rendered, Vec<Label>) {
    let mut scene = empty(camera(), [1242, 375]);
    scene.objects.push(flat(ground(150.0, 5.0, 0)));
    let mut objects = Vec::new();
    for (&(bottom, size), instance) in blocks.iter().zip(1..) {
        scene.objects.push(object(block(bottom, size, 0), instance));
        objects.push(labelled(bottom, size, instance));
    }
    let rendered = render(&scene);
    let labels = LabelRules::default().labels(&scene, &objects, &rendered);
    (scene, rendered, labels)
}

const CAR: Vec3 = [1.7, 1.5, 4.2];

fn on_ground(x: f32, z: f32) -> (Vec3, Vec3) {
    ([x, CAMERA_HEIGHT_M, z], CAR)
}

/// The box around an instance's pixels.
fn seen(rendered: &Rendered, instance: InstanceId) -> Option<Box2d> {
    let pixels = rendered.instance.iter().enumerate().filter(|(_, i)| **i == instance);
    Box2d::bounding(pixels.map(|(at, _)| [(at % rendered.size[0]) as f64, (at / rendered.size[0]) as f64]))
}

#[test]
fn each_label_lies_on_its_pixels_and_its_box_projects_there() {
    let (scene, rendered, labels) =
        labelled_scene(&[on_ground(-3.0, 12.0), on_ground(3.5, 20.0), on_ground(0.0, 45.0)]);
    assert_eq!(labels.len(), 3);
    for (label, instance) in labels.iter().zip(1..) {
        assert_eq!((label.occlusion, &label.class), (0, &ObjectClass::Car));
        assert!(label.truncation.abs() < 1e-9);
        let pixels = seen(&rendered, instance).expect("it is seen");
        let projected = label.box3d.projected(&scene.camera).expect("in front");
        for other in [pixels, projected] {
            let edges = |b: Box2d| [b.x1, b.y1, b.x2, b.y2];
            for (a, b) in edges(label.box2d).into_iter().zip(edges(other)) {
                assert!((a - b).abs() <= 1.0, "{:?} is not {other:?}", label.box2d);
            }
        }
        let middle = rendered.size[0] * (pixels.y1 + pixels.height() / 2.0) as usize
            + (pixels.x1 + pixels.width() / 2.0) as usize;
        let nearest = label.box3d.depth_m() - 2.1;
        assert!((f64::from(rendered.depth_m[middle]) - nearest).abs() < 2.0, "its depth is that of its box");
        assert!((label.alpha - label.box3d.alpha()).abs() < 1e-12);
    }
}

#[test]
fn occlusion_follows_from_what_is_hidden() {
    let front = on_ground(0.0, 15.0);
    // Each peeps out a little less behind the same car in front.
    let grades = [2.4, 1.5, 0.95].map(|x| {
        let (_, rendered, labels) = labelled_scene(&[front, on_ground(x, 22.0)]);
        (f64::from(rendered.visible[2]) / f64::from(rendered.amodal[2]), labels[1].clone())
    });
    let expected = [0, 1, 2];
    for ((visible, label), expected) in grades.iter().zip(expected) {
        assert_eq!(label.occlusion, expected, "{visible} is visible");
    }
    let (_, _, labels) = labelled_scene(&[front, on_ground(0.0, 22.0)]);
    assert!(labels.len() == 1 || labels[1].class == ObjectClass::DontCare, "hidden but for its roof: {labels:?}");
}

#[test]
fn truncation_is_the_share_of_the_box_outside() {
    let (_, _, labels) = labelled_scene(&[on_ground(-6.2, 9.0), on_ground(30.0, 10.0)]);
    let [label] = &labels[..] else { panic!("the second car is outside: {labels:?}") };
    assert!(label.box2d.x1.abs() < 1e-9);
    assert!(label.truncation > 0.2 && label.truncation < 0.8, "{}", label.truncation);
    // The box is a whole one: height and right edge are inside.
    let whole = label.box2d.width() / (1.0 - label.truncation);
    assert!((whole - label.box2d.width()) > 20.0);
}

#[test]
fn the_far_and_the_small_are_dont_care() {
    let (_, _, labels) = labelled_scene(&[on_ground(4.0, 97.0), on_ground(0.0, 30.0)]);
    assert_eq!(labels[0].class, ObjectClass::DontCare);
    assert!(text_from_labels(&labels).starts_with("DontCare -1 -1 -10 "));
    assert_eq!(labels[1].class, ObjectClass::Car);
}

#[test]
fn a_car_beside_the_camera_is_cut_at_the_near_plane() {
    let (_, _, labels) = labelled_scene(&[on_ground(2.2, 1.5)]);
    let [label] = &labels[..] else { panic!("{labels:?}") };
    assert!(label.truncation > 0.5 && label.truncation < 1.0, "{}", label.truncation);
    assert!(label.box2d.x2 <= 1241.0 && label.box2d.y2 <= 374.0 && label.box2d.x1 >= 0.0);
}

#[test]
fn labels_are_kitti_rows() {
    let scene = street();
    let objects = [labelled([2.4, CAMERA_HEIGHT_M, 9.0], CAR, 1), labelled([2.6, CAMERA_HEIGHT_M, 40.0], CAR, 3)];
    let labels = LabelRules { farthest_m: 30.0, ..LabelRules::default() }.labels(&scene, &objects, &render(&scene));
    let text = text_from_labels(&labels);
    let rows =
        rows_from_text(&text, std::path::Path::new("made"), RowKind::Label).expect("rows that a strict reader takes");
    assert_eq!(rows.len(), 2);
    assert!(text.contains("DontCare -1 -1 -10 ") && text.contains(" -1 -1 -1 -1000 -1000 -1000 -10\n"), "{text}");
}
