//! Where the error of detectors comes from: how far off they see the centres of cars in the image, by apparent size,
//! and what AP would be if one part of each matched detection were true (`farsight eval --oracle`):
//! `cargo run --release -p farsight-eval --example judge_mechanism [--table FILE.json] DATA SPLIT NAME=RESULTS,...`.
//!
//! DATA is in KITTI's layout. RESULTS are folders of result files, one for each seed, such as `RUN/both-1/results` of
//! `farsight experiment run --out RUN`; SPLIT is its `RUN/evaluate.txt`. Cars, Moderate; AP is the mean over the seeds.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "an example")]

use std::path::{Path, PathBuf};

use farsight_core::statistics::{quantile, sorted};
use farsight_data::kitti::{Calibration, read_split};
use farsight_eval::ap::{Metric, OverlapSet};
use farsight_eval::oracle::{OraclePart, with_truth};
use farsight_eval::ranging::{RangingOptions, match_frame};
use farsight_eval::{Difficulty, EvaluatedClass, FrameFiles, LabelSource};
use farsight_files::MeasuredTable;

/// What is written down as the command.
const COMMAND: &str = "cargo run --release -p farsight-eval --example judge_mechanism";

const COLUMNS: [&str; 9] = [
    "arm",
    "centres off, cars 25 to 40 px high",
    "40 to 80 px",
    "over 80 px",
    "AP 3D",
    "with true depth",
    "true centre",
    "true size",
    "true heading",
];

/// Lowest heights of the groups of cars, pixels; the first is KITTI's Moderate limit.
const HEIGHTS_PX: [f64; 3] = [25.0, 40.0, 80.0];

/// What the evaluator's list of levels has for Moderate.
const MODERATE: usize = Difficulty::Moderate as usize;

fn main() {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let table_file = words.iter().position(|word| word == "--table").map(|at| {
        words.remove(at);
        PathBuf::from(words.remove(at))
    });
    let [data, split, arms @ ..] = &words[..] else { panic!("expected DATA SPLIT NAME=RESULTS,...") };
    let ids = read_split(Path::new(split)).expect("a split");
    let mut table = MeasuredTable::new(COMMAND, COLUMNS);
    for arm in arms {
        let (name, runs) = arm.split_once('=').expect("NAME=RESULTS,...");
        let runs: Vec<&Path> = runs.split(',').map(Path::new).collect();
        let row = row(name, &Path::new(data).join("training"), &ids, &runs);
        println!("{}", row.join("  "));
        table.put(row);
    }
    if let Some(file) = table_file {
        table.write(&file).expect("a file to write to");
    }
}

fn row(name: &str, data: &Path, ids: &[String], runs: &[&Path]) -> [String; 9] {
    let options = RangingOptions { bootstrap: None, ..RangingOptions::default() };
    let mut errors_px = [const { Vec::new() }; 3];
    let sets: [&[OraclePart]; 5] =
        [&[], &[OraclePart::Depth], &[OraclePart::Centre], &[OraclePart::Size], &[OraclePart::Heading]];
    let mut sums = [0.0; 5];
    for run in runs {
        let labels = LabelSource::Folder(data.join("label_2"));
        let files = FrameFiles::open(labels, run, Some(ids.to_vec())).expect("results").with_any_classes();
        for id in ids {
            centre_errors(&files, id, data, &options, &mut errors_px);
        }
        for (sum, parts) in sums.iter_mut().zip(sets) {
            let (evaluation, _) =
                files.evaluate_changed(&options, |frame| with_truth(&frame, parts, &options)).expect("results");
            let ap = evaluation.report().ap.ap(OverlapSet::Strict, Metric::Box3d, EvaluatedClass::Car);
            *sum += ap.map_or(0.0, |ap| ap.r40[MODERATE]) / runs.len() as f64;
        }
    }
    let median = |errors: Vec<f64>| match sorted(errors) {
        errors if errors.is_empty() => "-".to_owned(),
        errors => format!("{:.2} px", quantile(&errors, 0.5)),
    };
    let [small, middle, large] = errors_px.map(median);
    let [plain, depth, centre, size, heading] = sums.map(|ap| format!("{ap:.2}"));
    [name.to_owned(), small, middle, large, plain, depth, centre, size, heading]
}

/// Adds how far the centres of what was found are off in the image, by the heights of the cars.
fn centre_errors(files: &FrameFiles, id: &str, data: &Path, options: &RangingOptions, errors_px: &mut [Vec<f64>; 3]) {
    let (frame, _) = files.read(id).expect("a frame");
    let camera = Calibration::read(&data.join(format!("calib/{id}.txt"))).expect("a calibration").camera();
    for target in match_frame(&frame, 0, options).0 {
        let is_moderate = target.difficulty.is_some_and(|level| level as usize <= MODERATE);
        let (EvaluatedClass::Car, true, Some(found)) = (target.class, is_moderate, target.found) else { continue };
        let truth = frame.labels[target.label as usize].box3d.center();
        let told = frame.predictions[found.prediction as usize].detection.box3d.center();
        let [Some(truth), Some(told)] = [truth, told].map(|center| camera.pixel_from_point(center)) else { continue };
        let group = HEIGHTS_PX.iter().rposition(|lowest| target.height_px >= *lowest);
        if let Some(group) = group {
            errors_px[group].push((truth[0] - told[0]).hypot(truth[1] - told[1]));
        }
    }
}
