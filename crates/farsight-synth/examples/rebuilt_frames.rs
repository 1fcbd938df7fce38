//! Rebuilds every frame of a KITTI folder from its labels and says how it went; pairs of photograph and rebuilt frame
//! go into a picture.
//!
//! `cargo run --release -p farsight-synth --example rebuilt_frames -- KITTI_ROOT [pairs.png COUNT]`
#![allow(missing_docs, clippy::print_stdout)]

use std::path::Path;
use std::time::Instant;

use farsight_core::{Camera, Label, ObjectClass};
use farsight_data::kitti::{Calibration, read_labels};
use farsight_synth::sensor::SensorModel;
use farsight_synth::{LabelledScene, SceneConfig, render, scene_from_labels};
use image::{RgbImage, imageops};

const SIZE: [usize; 2] = [1242, 375];
const CELL: [u32; 2] = [828, 250];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let root = Path::new(arguments.first().ok_or("where is KITTI?")?).join("training");
    let mut names: Vec<_> =
        std::fs::read_dir(root.join("label_2"))?.map(|e| e.map(|e| e.path())).collect::<Result<_, _>>()?;
    names.sort();
    let count: usize = arguments.get(2).map_or(Ok(0), |n| n.parse())?;
    let mut sheet = RgbImage::new(2 * CELL[0], count as u32 * CELL[1]);
    let (mut objects, mut shares, start) = (0, Vec::new(), Instant::now());
    for (index, path) in names.iter().enumerate() {
        let labels = read_labels(path)?;
        let stem = path.file_stem().ok_or("a label file has no name")?.to_string_lossy().into_owned();
        let camera = Calibration::read(&root.join("calib").join(format!("{stem}.txt")))?.camera();
        let generated = rebuilt(&labels, &camera, index as u64)?;
        objects += generated.objects.len();
        let step = (names.len() / count.max(1)).max(1);
        if count > 0 && index % step == 0 && index / step < count {
            let row = i64::from(CELL[1]) * (index / step) as i64;
            let photo = image::open(root.join("image_2").join(format!("{stem}.png")))?.to_rgb8();
            let rendered = render::render(&generated.scene);
            shares.extend(clear_shares(&labels, &generated, &rendered));
            let made = SensorModel::IDEAL.capture(&rendered);
            for (column, picture) in [photo, made].iter().enumerate() {
                let small = imageops::resize(picture, CELL[0], CELL[1], imageops::FilterType::Triangle);
                imageops::replace(&mut sheet, &small, i64::from(CELL[0]) * column as i64, row);
            }
        }
    }
    println!("{} frames rebuilt with {objects} objects in {:.1} s", names.len(), start.elapsed().as_secs_f64());
    let clear = shares.iter().filter(|&&share| share > 0.7).count();
    println!("{} objects labelled as not occluded were rendered; of {clear} more than 70 % is seen", shares.len());
    if let Some(path) = arguments.get(1) {
        sheet.save(path)?;
    }
    Ok(())
}

/// The frame, checked: every label but `DontCare` is there, in its place.
fn rebuilt(labels: &[Label], camera: &Camera, seed: u64) -> Result<LabelledScene, String> {
    let generated = scene_from_labels(&SceneConfig::default(), labels, camera, SIZE, seed);
    let kept = labels.iter().filter(|label| label.class != ObjectClass::DontCare);
    let found = generated.objects.iter().map(|object| (&object.class, &object.box3d));
    if kept.map(|label| (&label.class, &label.box3d)).eq(found) {
        Ok(generated)
    } else {
        Err(format!("frame {seed} is not what its labels say"))
    }
}

/// The visible shares of the objects that are labelled as not occluded.
fn clear_shares(labels: &[Label], generated: &LabelledScene, rendered: &render::Rendered) -> Vec<f64> {
    let kept = labels.iter().filter(|label| label.class != ObjectClass::DontCare);
    let clear = kept.zip(&generated.objects).filter(|(label, _)| label.occlusion == 0);
    let share = |instance: usize| f64::from(rendered.visible[instance]) / f64::from(rendered.amodal[instance].max(1));
    clear.map(|(_, object)| share(usize::from(object.instance))).collect()
}
