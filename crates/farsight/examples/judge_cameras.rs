//! Compares cameras that are estimated from images (`--hfov auto`) with those of their calibrations:
//! `cargo run --release -p farsight --example judge_cameras [--model FILE] [--table FILE.json] NAME=FOLDER...`.
//!
//! FOLDER is in KITTI's layout. Pitch and roll are judged where calibrations know them, as those of rendered scenes do:
//! their second axis points straight down.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "an example")]

use std::path::{Path, PathBuf};

use farsight::{CameraEstimate, CameraEstimates, CameraEstimatorModel};
use farsight_core::Camera;
use farsight_core::statistics::{quantile, sorted};
use farsight_data::open_labelled;
use farsight_files::MeasuredTable;

/// One image: what is true and what was estimated.
struct Judged {
    hfov_deg: [f64; 2],
    /// Logarithm of estimated over true focal length, and its error bar.
    focal: [f64; 2],
    /// Of pitch and roll, degrees, where they are known.
    tilt_errors_deg: Option<[f64; 2]>,
}

/// What is written down as the command.
const COMMAND: &str = "cargo run --release -p farsight --example judge_cameras";

const COLUMNS: [&str; 9] = [
    "set",
    "images",
    "true field of view",
    "focal length, error in the median",
    "its mean error",
    "field of view, MAE",
    "within 1 / 1.64 error bars",
    "pitch, MAE",
    "roll, MAE",
];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut words = arguments.iter().map(String::as_str);
    let (mut estimates, mut table, mut sets) = (CameraEstimates::default(), None, Vec::new());
    while let Some(word) = words.next() {
        match word {
            "--model" => {
                let file = words.next().expect("expected --model FILE");
                let model = CameraEstimatorModel::read(Path::new(file)).expect("a camera estimator");
                estimates = CameraEstimates::with_model(model);
            }
            "--table" => table = Some(PathBuf::from(words.next().expect("expected --table FILE.json"))),
            set => sets.push(set.split_once('=').expect("expected NAME=FOLDER")),
        }
    }
    let mut rows = Vec::new();
    for (name, folder) in sets {
        let dataset = open_labelled(Path::new(folder), None).expect("a folder in KITTI's layout");
        let judged: Vec<Judged> = (0..dataset.len())
            .map(|index| {
                let (camera, image) = (dataset.camera(index).unwrap(), dataset.image(index).unwrap());
                let size = [image.width() as usize, image.height() as usize];
                judged(&camera, size, &estimates.estimate(&image).expect("an estimate"))
            })
            .collect();
        rows.push(row(name, &judged));
    }
    let described = MeasuredTable { rows, ..MeasuredTable::new(COMMAND, COLUMNS) };
    for row in &described.rows {
        println!("{}", row.join("  "));
    }
    if let Some(table) = table {
        described.write(&table).expect("the table is written");
    }
}

fn judged(camera: &Camera, size: [usize; 2], estimate: &CameraEstimate) -> Judged {
    let width = size[0] as f64;
    let true_focal = camera.focal_x();
    let hfov = |focal: f64| 2.0 * (width / (2.0 * focal)).atan().to_degrees();
    // A camera that is taken to be level to the last digit was not measured.
    let is_known = camera.projection[2][1] != 0.0;
    let [pitch, roll] = camera.attitude();
    let errors = [estimate.pitch_rad[0] - pitch, estimate.roll_rad[0] - roll];
    Judged {
        hfov_deg: [hfov(true_focal), hfov(estimate.focal_px)],
        focal: [(estimate.focal_px / true_focal).ln(), estimate.focal_log_sigma],
        tilt_errors_deg: is_known.then(|| errors.map(|error| error.to_degrees().abs())),
    }
}

fn row(name: &str, judged: &[Judged]) -> Vec<String> {
    let count = judged.len() as f64;
    let mean = |value: &dyn Fn(&Judged) -> f64| judged.iter().map(value).sum::<f64>() / count;
    let within = |bars: f64| mean(&|one| f64::from(u8::from(one.focal[0].abs() <= bars * one.focal[1])));
    let tilt = |axis: usize| {
        let errors: Vec<f64> = judged.iter().filter_map(|one| Some(one.tilt_errors_deg?[axis])).collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        if errors.is_empty() { "-".to_owned() } else { format!("{mean:.1}°") }
    };
    let truths = sorted(judged.iter().map(|one| one.hfov_deg[0]));
    vec![
        name.to_owned(),
        judged.len().to_string(),
        format!("{:.0} to {:.0}°", truths[0], truths[truths.len() - 1]),
        format!("{:.0}%", 100.0 * quantile(&sorted(judged.iter().map(|one| one.focal[0].abs())), 0.5)),
        format!("{:+.0}%", 100.0 * mean(&|one| one.focal[0])),
        format!("{:.1}°", mean(&|one| (one.hfov_deg[0] - one.hfov_deg[1]).abs())),
        format!("{:.0} / {:.0}%", 100.0 * within(1.0), 100.0 * within(1.64)),
        tilt(0),
        tilt(1),
    ]
}
