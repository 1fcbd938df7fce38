//! What it would bring to know the road under a moving camera, nods included: distances of cars in single images of
//! rendered sequences, put onto a road that is found in each image or known from the labels, by farsight-s on OpenVINO:
//! `cargo run --release -p farsight --example known_road -- [--table FILE.json] FOLDER...`.
//!
//! FOLDER is what `farsight synth --sequence` writes.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "an example")]

use std::path::{Path, PathBuf};

use farsight::shipped::Family;
use farsight::{Detection, EngineKind, ModelSource, Pipeline, Road, RoadPlane, read_image};
use farsight_core::linear::solved;
use farsight_core::overlap::iou_2d;
use farsight_core::road::{SURE_SCORE, fit_to_road};
use farsight_core::{Label, ObjectClass};
use farsight_data::kitti::Calibration;
use farsight_eval::tracks::read_sequence;
use farsight_files::MeasuredTable;

/// What is written down as the command.
const COMMAND: &str = "cargo run --release -p farsight --example known_road -- --table FILE.json 200 201";

const COLUMNS: [&str; 5] = ["road", "cars", "distance: MAE", "to 20 m; to 40 m; beyond", "mean relative error"];

/// A detection is of a car that it overlaps by more than this in the image.
const OVERLAP: f64 = 0.5;

/// Cars that are labelled: Moderate by KITTI's rules.
fn is_judged(label: &Label) -> bool {
    label.class == ObjectClass::Car && label.occlusion <= 1 && label.truncation <= 0.3 && label.box2d.height() >= 25.0
}

/// The plane on which labels stand, by least squares; nearly level where there are few.
fn plane(labels: &[&Label]) -> Option<[f64; 3]> {
    let (mut curvature, mut right) = ([[0.01, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]], [0.0; 3]);
    for label in labels {
        let [x, y, z] = label.box3d.location;
        let row = [-z, -x, 1.0];
        for (i, cells) in curvature.iter_mut().enumerate() {
            cells.iter_mut().zip(row).for_each(|(cell, value)| *cell += row[i] * value);
            right[i] += row[i] * y;
        }
    }
    solved(curvature, right)
}

/// What is known of the road, in words, of a plane with this slope, tilt and height.
fn roads([slope, tilt, height_m]: [f64; 3]) -> [(&'static str, Road); 5] {
    let known = |sigmas| Road::Known(RoadPlane { slope, tilt, height_m, sigmas });
    [
        ("none, each car by itself", Road::Ignored),
        ("found in each image", Road::Below),
        ("found, height of the camera known", Road::BelowBy(height_m)),
        ("known but for nods of 5 mrad", known([0.005, 0.003, 0.05])),
        ("known in each image to 1 mrad", known([0.001, 0.001, 0.02])),
    ]
}

/// Depths and errors of the depth, metres, of the cars of `labels` that were found.
fn errors<'a>(labels: &'a [&Label], found: &'a [Detection]) -> impl Iterator<Item = [f64; 2]> + 'a {
    labels.iter().filter(|label| is_judged(label)).filter_map(move |label| {
        let sure = found.iter().filter(|one| one.score > SURE_SCORE);
        let overlaps = sure.map(|one| (iou_2d(&one.box2d, &label.box2d), one));
        let (overlap, best) = overlaps.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let depth_m = label.box3d.depth_m();
        (overlap > OVERLAP).then(|| [depth_m, best.box3d.depth_m() - depth_m])
    })
}

fn row(road: &str, judged: &[[f64; 2]]) -> [String; 5] {
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let mae = |from_m: f64, to_m: f64| {
        let within = judged.iter().filter(|[depth_m, _]| (from_m..to_m).contains(depth_m));
        mean(within.map(|[_, error_m]| error_m.abs()).collect())
    };
    let relative = mean(judged.iter().map(|[depth_m, error_m]| error_m.abs() / depth_m).collect());
    [
        road.to_owned(),
        judged.len().to_string(),
        format!("{:.3} m", mae(0.0, f64::INFINITY)),
        format!("{:.2}; {:.2}; {:.2} m", mae(0.0, 20.0), mae(20.0, 40.0), mae(40.0, f64::INFINITY)),
        format!("{:.2}%", 100.0 * relative),
    ]
}

fn main() {
    let mut folders: Vec<String> = std::env::args().skip(1).collect();
    let table = folders.iter().position(|word| word == "--table").map(|at| {
        folders.remove(at);
        folders.remove(at)
    });
    let builder = Pipeline::builder().model(ModelSource::from_word(Family::FarsightS.name()));
    let pipeline = builder.engine(EngineKind::OpenVino).open().unwrap();
    let mut judged = vec![Vec::new(); roads([0.0; 3]).len()];
    for folder in &folders {
        let root = Path::new(folder).join("training");
        let mut labels: Vec<PathBuf> =
            std::fs::read_dir(root.join("label_02")).unwrap().map(|entry| entry.unwrap().path()).collect();
        labels.sort();
        for file in labels {
            let name = file.file_stem().unwrap().to_string_lossy().into_owned();
            let camera = Calibration::read(&root.join("calib").join(format!("{name}.txt"))).unwrap().camera();
            for (number, frame) in read_sequence(&file, None).unwrap().iter().enumerate() {
                let image = read_image(root.join("image_02").join(&name).join(format!("{number:06}.png"))).unwrap();
                let found = pipeline.detect_off_road(&image, &camera).unwrap();
                let labels: Vec<&Label> = frame.tracks.iter().map(|track| &track.label).collect();
                let Some(plane) = plane(&labels) else { continue };
                for ((_, road), judged) in roads(plane).into_iter().zip(&mut judged) {
                    judged.extend(errors(&labels, &fit_to_road(found.clone(), road, &pipeline.scale())));
                }
            }
        }
        println!("{folder}: {} cars found", judged[0].len());
    }
    let rows: Vec<[String; 5]> =
        roads([0.0; 3]).iter().zip(&judged).map(|((road, _), judged)| row(road, judged)).collect();
    for row in &rows {
        println!("{}", row.join(" | "));
    }
    if let Some(path) = table {
        let rows = rows.into_iter().map(Vec::from).collect();
        MeasuredTable { rows, ..MeasuredTable::new(COMMAND, COLUMNS) }.write(Path::new(&path)).unwrap();
    }
}
