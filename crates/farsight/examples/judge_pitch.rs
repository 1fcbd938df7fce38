//! What it costs not to know how far down a camera looks: vehicles found and their distances with calibrations that
//! know it, with what is seen in each image, and with cameras that are taken for level, by farsight-w on OpenVINO:
//! `cargo run --release -p farsight --example judge_pitch -- [--table FILE.json] NAME=FOLDER...`.
//!
//! FOLDER is what `farsight synth --scene-config` writes: its calibrations are of turned cameras, its labels level.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "an example")]

use std::path::Path;

use farsight::{DetectedObject, EngineKind, Pipeline};
use farsight_core::detection::CALIBRATED_MIN_SCORE;
use farsight_core::overlap::iou_2d;
use farsight_core::{Camera, Label, ObjectClass};
use farsight_data::open_labelled;
use farsight_files::MeasuredTable;

/// What is written down as the command.
const COMMAND: &str = "cargo run --release -p farsight --example judge_pitch -- --table FILE.json NAME=FOLDER ...";

const COLUMNS: [&str; 9] = [
    "scenes",
    "looks down",
    "vehicles",
    "found: calibrated",
    "by what is seen",
    "taken for level",
    "relative error (and its mean): calibrated",
    "by what is seen ",
    "taken for level ",
];

/// What is known of the cameras.
const WAYS: usize = 3;

/// Bands of pitch, degrees.
const BANDS: [(&str, [f64; 2]); 6] = [
    ("up, or by less than 2°", [-90.0, 2.0]),
    ("2 to 4°", [2.0, 4.0]),
    ("4 to 8°", [4.0, 8.0]),
    ("8 to 12°", [8.0, 12.0]),
    ("more", [12.0, 90.0]),
    ("all", [-90.0, 90.0]),
];

/// A detection is of a vehicle that it overlaps by at least this in the image.
const OVERLAP: f64 = 0.5;

/// A vehicle: how far down its camera looks, degrees, and by which share of its distance each way was off, where it was
/// found.
struct Vehicle {
    pitch_deg: f64,
    off: [Option<f64>; WAYS],
}

fn is_vehicle(class: &ObjectClass) -> bool {
    matches!(class, ObjectClass::Car | ObjectClass::Van | ObjectClass::Truck)
}

/// Moderate by KITTI's rules.
fn is_judged(label: &Label) -> bool {
    let is_moderate = label.occlusion <= 1 && label.truncation <= 0.3 && label.box2d.height() >= 25.0;
    is_vehicle(&label.class) && is_moderate
}

/// The camera in coordinates along its own axis, of which nobody says how it is turned.
fn upright(camera: &Camera) -> Camera {
    let [cx, cy] = camera.principal_point();
    Camera::from_intrinsics(camera.focal_x(), camera.focal_y(), cx, cy).unwrap()
}

/// By which share of the distance of `label` what was found of it is off. `found` is in the coordinates of `seen_by`,
/// the label in those of `calibrated`.
fn off(label: &Label, found: &[DetectedObject], seen_by: &Camera, calibrated: &Camera) -> Option<f64> {
    let sure = found.iter().filter(|one| is_vehicle(&one.class) && one.score >= CALIBRATED_MIN_SCORE);
    let overlaps = sure.map(|one| (iou_2d(&one.box2d, &label.box2d), one));
    let (overlap, best) = overlaps.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let [x, y, z] = best.box3d.location;
    let homogeneous = seen_by.projection.map(|row| row[0] * x + row[1] * y + row[2] * z);
    let [.., level_z] = calibrated.direction(homogeneous)?;
    (overlap >= OVERLAP).then(|| level_z / label.box3d.depth_m() - 1.0)
}

fn row(scenes: &str, (name, [low, high]): (&str, [f64; 2]), vehicles: &[Vehicle]) -> Vec<String> {
    let band: Vec<&Vehicle> = vehicles.iter().filter(|one| low < one.pitch_deg && one.pitch_deg <= high).collect();
    let mut cells = vec![scenes.to_owned(), name.to_owned(), band.len().to_string()];
    let found = |way: usize| band.iter().filter_map(move |one| one.off[way]);
    for way in 0..WAYS {
        let share = found(way).count() as f64 / band.len().max(1) as f64;
        cells.push(format!("{:.0}%", 100.0 * share));
    }
    for way in 0..WAYS {
        let mean = |value: &dyn Fn(f64) -> f64| found(way).map(value).sum::<f64>() / found(way).count().max(1) as f64;
        cells.push(format!("{:.1}% ({:+.1}%)", 100.0 * mean(&f64::abs), 100.0 * mean(&|off| off)));
    }
    cells
}

fn main() {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let table = words.iter().position(|word| word == "--table").map(|at| {
        words.remove(at);
        words.remove(at)
    });
    let builder = Pipeline::builder().engine(EngineKind::OpenVino);
    let (pipeline, level) = (builder.open().unwrap(), builder.clone().pitch(0.0).open().unwrap());
    let mut rows = Vec::new();
    for word in &words {
        let (name, folder) = word.split_once('=').expect("expected NAME=FOLDER");
        let dataset = open_labelled(Path::new(folder), None).expect("a folder in KITTI's layout");
        let mut vehicles = Vec::new();
        for index in 0..dataset.len() {
            let (calibrated, image) = (dataset.camera(index).unwrap(), dataset.image(index).unwrap());
            let upright = upright(&calibrated);
            let ways = [(&pipeline, calibrated), (&pipeline, upright), (&level, upright)];
            let found = ways.map(|(pipeline, camera)| (camera, pipeline.detect(&image, &camera).unwrap()));
            let [pitch, _] = calibrated.attitude();
            vehicles.extend(dataset.labels(index).unwrap().iter().filter(|label| is_judged(label)).map(|label| {
                let off = std::array::from_fn(|way| off(label, &found[way].1, &found[way].0, &calibrated));
                Vehicle { pitch_deg: pitch.to_degrees(), off }
            }));
        }
        rows.extend(BANDS.map(|band| row(name, band, &vehicles)));
    }
    for row in &rows {
        println!("{}", row.join(" | "));
    }
    if let Some(path) = table {
        MeasuredTable { rows, ..MeasuredTable::new(COMMAND, COLUMNS) }.write(Path::new(&path)).unwrap();
    }
}
