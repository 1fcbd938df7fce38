//! Number plates are told where the image shows them.

use farsight_core::{Box3d, Camera, Dimensions, Label, ObjectClass};
use farsight_data::Frame;
use farsight_data::annotations::{Plate, Plates};
use farsight_synth::{SceneConfig, SceneStream, frame_from_labels};

/// Width of a plate, metres, and how far a mesh's fit to its box may stretch it.
const WIDTH_M: f64 = 0.52;
const STRETCH: f64 = 0.02;

fn plates_in(frame: &Frame) -> &[Plate] {
    &frame.annotation::<Plates>().unwrap().0
}

fn distance([a, b]: [[f64; 3]; 2]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn plates_of_random_scenes_are_as_wide_as_plates_and_lie_on_their_vehicles() {
    let stream = SceneStream { config: SceneConfig::default(), seed: 5 };
    let mut of_cars = 0;
    for index in 0..12 {
        let frame = stream.frame(index);
        let mut before = None;
        for plate in plates_in(&frame) {
            let label = &frame.labels[plate.label];
            assert!(before < Some(plate.label), "one plate for a label, in their order");
            before = Some(plate.label);
            let [right, left] = plate.ends.map(|end| frame.camera.pixel_from_point(end).unwrap());
            assert!(left[0] < right[0], "{left:?} is not left of {right:?}");
            for [u, v] in [right, left] {
                // The image may cut off an end of a plate that it shows.
                let box2d = label.box3d.projected(&frame.camera).unwrap();
                let is_on = u > box2d.x1 - 1.0 && u < box2d.x2 + 1.0 && v > box2d.y1 && v < box2d.y2 + 1.0;
                assert!(is_on, "({u}, {v}) is not on {label:?}");
            }
            if label.class == ObjectClass::Car {
                of_cars += 1;
                let width_m = distance(plate.ends);
                assert!((width_m / WIDTH_M - 1.0).abs() < STRETCH, "{width_m} m");
            }
        }
    }
    assert!(of_cars > 20, "{of_cars} plates of cars");
}

fn car([x, z]: [f64; 2], yaw: f64) -> Label {
    let dimensions = Dimensions { height: 1.5, width: 1.65, length: 4.0 };
    let box3d = Box3d { dimensions, location: [x, 1.65, z], yaw };
    let camera = camera();
    let box2d = box3d.projected(&camera).unwrap().clamped(1241.0, 374.0);
    Label { class: ObjectClass::Car, truncation: 0.0, occlusion: 0, alpha: box3d.alpha(), box2d, box3d }
}

fn camera() -> Camera {
    Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap()
}

fn plates_of(cars: &[Label]) -> Frame {
    frame_from_labels(cars, &camera(), [1242, 375], 3, "000000")
}

#[test]
fn a_plate_is_told_of_the_end_that_is_seen_and_of_none_that_is_hidden() {
    let away = -std::f64::consts::FRAC_PI_2;
    for (yaw, depth_m) in [(away, 18.0), (-away, 18.0)] {
        let frame = plates_of(&[car([0.3, 20.0], yaw)]);
        let [plate] = plates_in(&frame) else { panic!("{:?}", plates_in(&frame)) };
        assert!(plate.ends.iter().all(|end| (end[2] - depth_m).abs() < 0.1), "{:?}", plate.ends);
    }
    let hidden = plates_of(&[car([0.0, 8.0], away), car([0.0, 14.0], away)]);
    assert_eq!(plates_in(&hidden).len(), 1, "{:?}", plates_in(&hidden));
    assert!(plates_in(&plates_of(&[car([0.0, 20.0], 0.0)])).is_empty(), "seen from its side");
}
