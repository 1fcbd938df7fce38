//! Draws the labels of KITTI frames as if they had been detected.
//!
//! ```text
//! cargo run -p farsight-viz --example show_labels -- KITTI_FOLDER OUT_FOLDER 000032 000049
//! ```

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use farsight_core::{Detection, Label, ObjectClass};
use farsight_data::kitti::{Calibration, read_labels};
use farsight_data::read_image;
use farsight_viz::{DrawOptions, Scene, picture};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    ensure!(arguments.len() > 2, "expected KITTI_FOLDER OUT_FOLDER FRAME...");
    let training = PathBuf::from(&arguments[0]).join("training");
    let out = PathBuf::from(&arguments[1]);
    fs::create_dir_all(&out).with_context(|| format!("{}", out.display()))?;
    for frame in &arguments[2..] {
        let image = read_image(&training.join(format!("image_2/{frame}.png")))?;
        let camera = Calibration::read(&training.join(format!("calib/{frame}.txt")))?.camera();
        let labels = read_labels(&training.join(format!("label_2/{frame}.txt")))?;
        let detections: Vec<Detection> = labels.into_iter().filter_map(as_detection).collect();
        let scene = Scene { camera: &camera, detections: &detections, truth: &[] };
        picture(&image, &scene, &DrawOptions::default()).save(out.join(format!("{frame}.png")))?;
    }
    Ok(())
}

fn as_detection(label: Label) -> Option<Detection> {
    let Label { class, box2d, box3d, .. } = label;
    (class != ObjectClass::DontCare).then_some(Detection { class, score: 1.0, box2d, box3d, range_sigma_m: None })
}
