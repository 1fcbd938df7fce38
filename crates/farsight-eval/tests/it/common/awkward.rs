//! Small random sets with everything that an evaluator could get wrong.

use farsight_core::{Box2d, Box3d, Detection, Dimensions, Label, ObjectClass};
use farsight_eval::{Frame, Prediction};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Frames with everything that draws could get wrong: equal scores within and between frames, scores that are no
/// numbers, neighbours, excuses, small boxes of all classes that take objects, frames with nothing in them.
pub fn awkward_frames(count: usize, seed: u128) -> Vec<Frame> {
    let mut random = Pcg64::new(seed, 1);
    (0..count).map(|index| awkward_frame(index, &mut random)).collect()
}

fn awkward_frame(index: usize, random: &mut Pcg64) -> Frame {
    let classes = [ObjectClass::Car, ObjectClass::Car, ObjectClass::Van, ObjectClass::Pedestrian, ObjectClass::Cyclist];
    let labels: Vec<_> = (0..random.random_range(0..7))
        .map(|at: u32| {
            let depth_m = random.random_range(6.0..60.0);
            label(&classes[random.random_range(0..classes.len())], f64::from(at), depth_m, random.random_range(0..4))
        })
        .collect();
    let mut predictions = Vec::new();
    for label in &labels {
        for _ in 0..random.random_range(0..3) {
            let mut near = label.clone();
            near.box3d.location[2] += random.random_range(-1.0..1.0);
            near.box2d.x1 += random.random_range(-12.0..12.0);
            near.box2d.y1 += random.random_range(0.0..1.0) * 0.3 * near.box2d.height();
            if random.random_range(0..5) == 0 {
                near.class = classes[random.random_range(0..classes.len())].clone();
            }
            predictions.push(prediction(&near, random));
        }
    }
    for at in 0..random.random_range(0..4) {
        let depth_m = random.random_range(6.0..60.0);
        predictions.push(prediction(&label(&ObjectClass::Car, f64::from(at) + 0.4, depth_m, 0), random));
    }
    let mut labels = labels;
    if index.is_multiple_of(3) {
        labels.push(Label { class: ObjectClass::DontCare, ..label(&ObjectClass::Car, 0.5, 9.0, 0) });
    }
    Frame { id: format!("{index:06}"), labels, predictions }
}

pub fn label(class: &ObjectClass, at: f64, depth_m: f64, occlusion: i32) -> Label {
    let dimensions = Dimensions { height: 1.5, width: 1.6, length: 3.9 };
    let box3d = Box3d { dimensions, location: [0.3 * (at - 3.0) * depth_m, 1.65, depth_m], yaw: 0.3 * at };
    let (left, height_px) = (180.0 * at, 720.0 * 1.5 / depth_m);
    let box2d = Box2d::new(left, 170.0, left + 1.4 * height_px, 170.0 + height_px);
    Label { class: class.clone(), truncation: 0.0, occlusion, alpha: box3d.alpha(), box2d, box3d }
}

fn prediction(label: &Label, random: &mut Pcg64) -> Prediction {
    let Label { class, box2d, box3d, .. } = label.clone();
    let score = if random.random_range(0..40) == 0 { f64::NAN } else { f64::from(random.random_range(1..12)) / 10.0 };
    Prediction::from(Detection { class, score, box2d, box3d, range_sigma_m: None })
}
