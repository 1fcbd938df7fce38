//! Labels made from rebuilt real frames against those that people drew.

use std::path::{Path, PathBuf};

use farsight_core::overlap::iou_2d;
use farsight_core::{Label, ObjectClass};
use farsight_data::kitti::{Calibration, read_labels};
use farsight_synth::labels::LabelRules;
use farsight_synth::render::render;
use farsight_synth::{SceneConfig, scene_from_labels};

/// Frames compared.
const FRAMES: usize = 42;

/// Real labels of cars, each with the label of the same car in the rebuilt frame, if that has one.
fn pairs(training: &Path) -> Vec<(Label, Option<Label>)> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(training.join("label_2"))
        .expect("labels")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    files.sort();
    let step = files.len() / FRAMES;
    let mut pairs = Vec::new();
    for file in files.iter().step_by(step.max(1)) {
        let real = read_labels(file).expect("labels");
        let calibration = training.join("calib").join(file.with_extension("txt").file_name().expect("a name"));
        let camera = Calibration::read(&calibration).expect("a calibration").camera();
        let generated = scene_from_labels(&SceneConfig::default(), &real, &camera, [1242, 375], 1);
        let made = LabelRules::default().labels(&generated.scene, &generated.objects, &render(&generated.scene));
        for label in real.into_iter().filter(|label| label.class == ObjectClass::Car) {
            let same = made.iter().find(|other| other.box3d == label.box3d).cloned();
            pairs.push((label, same));
        }
    }
    pairs
}

#[test]
fn made_labels_agree_with_those_that_people_drew() {
    let Some(training) = farsight_testing::kitti("frames/training") else { return };
    let pairs = pairs(&training);
    let clear: Vec<_> = pairs.iter().filter(|(real, _)| real.occlusion == 0 && real.truncation < 0.01).collect();
    let made: Vec<_> = clear.iter().filter_map(|(real, made)| made.as_ref().map(|made| (real, made))).collect();
    let overlap = made.iter().map(|(real, made)| iou_2d(&real.box2d, &made.box2d)).sum::<f64>() / made.len() as f64;
    let kept = made.len() as f64 / clear.len() as f64;
    let both = pairs.iter().filter_map(|(real, made)| made.as_ref().map(|made| (real, made)));
    let graded: Vec<_> = both.filter(|(real, _)| real.occlusion < 3).collect();
    let same = graded.iter().filter(|(real, made)| real.occlusion == made.occlusion).count() as f64;
    let off = graded.iter().map(|(real, made)| (real.truncation - made.truncation).abs()).sum::<f64>();
    let (same, off) = (same / graded.len() as f64, off / graded.len() as f64);
    println!("{} clear cars: {kept:.2} labelled, mean overlap {overlap:.3}", clear.len());
    let cut = graded.iter().filter(|(real, _)| real.truncation > 0.05).count();
    println!("{cut} cars are cut by the image's border");
    println!("{} graded cars: {same:.2} with the same occlusion, truncation off by {off:.3} on average", graded.len());
    assert!(clear.len() > 10 && kept > 0.9 && overlap > 0.95, "{kept} labelled, overlap {overlap}");
    assert!(cut > 5 && same > 0.6 && off < 0.06, "{same} with the same occlusion, truncation off by {off}");
}
