//! How well `farsight calibrate` finds out how a camera stands: rendered cameras in cars and on masts, each in one part
//! of the world, a dozen images of each, by farsight-w on OpenVINO: `cargo run --release -p farsight --example
//! judge_calibrate -- [--table FILE.json]`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "an example")]

use std::path::Path;

use farsight::{CameraStand, EngineKind, Pipeline, Road, RoadCalibrator};
use farsight_core::Camera;
use farsight_files::MeasuredTable;
use farsight_synth::generator::SceneConfig;
use farsight_synth::{CameraRanges, RegionWeights, SceneStream};

/// What is written down as the command.
const COMMAND: &str = "cargo run --release -p farsight --example judge_calibrate -- --table FILE.json";

const COLUMNS: [&str; 9] = [
    "cameras",
    "height",
    "looks down",
    "told of",
    "pitch: mean error (largest)",
    "roll: mean error (largest)",
    "height: mean error (largest; mean with its sign)",
    "height within 1 / 1.64 error bars",
    "pitch within 1 / 1.64 error bars",
];

/// Cameras of a kind, and images of each.
const CAMERAS: usize = 16;
const IMAGES: u64 = 12;

const SEED: u64 = 5000;

/// Kinds of cameras: name, heights in metres, pitches in degrees.
const KINDS: [(&str, [f64; 2], [f64; 2]); 2] =
    [("in cars", [1.2, 2.4], [-1.0, 4.0]), ("on masts", [4.0, 8.0], [5.0, 20.0])];

/// Half the width of the interval that holds 90%, standard deviations.
const MOST: f64 = 1.64;

/// Where `place` of [`CAMERAS`] lies in `range`; `turn` mixes them.
fn spread([low, high]: [f64; 2], place: usize, turn: usize) -> f64 {
    low + (high - low) * ((place * turn) % CAMERAS) as f64 / (CAMERAS - 1) as f64
}

/// A camera of a kind: images of 960x540 pixels, 50 to 90 degrees wide.
fn ranges(heights_m: [f64; 2], pitches_deg: [f64; 2], place: usize) -> CameraRanges {
    let only = |value: f64| [value, value];
    CameraRanges {
        image_sizes: vec![[960, 540]],
        focal_widths: only(spread([0.5, 1.07], place, 7)),
        center: [0.5, 0.5],
        center_reach: 0.0,
        height_m: only(spread(heights_m, place, 1)),
        pitch_deg: only(spread(pitches_deg, place, 5)),
        roll_deg: 0.0,
        lateral_m: 0.0,
        offset_m: 0.0,
        ..CameraRanges::kitti()
    }
}

/// A camera stands in one part of the world.
fn region(place: usize) -> RegionWeights {
    let mut regions = RegionWeights { kitti: 0.0, ..RegionWeights::default() };
    let RegionWeights { europe, north_america, china, japan, india, .. } = &mut regions;
    let all = [europe, north_america, china, japan, india];
    *all[place % all.len()] = 1.0;
    regions
}

/// What is true of a camera and what was told.
struct Judged {
    height_m: f64,
    attitude_deg: [f64; 2],
    told: CameraStand,
}

fn judged(pipeline: &Pipeline, kind: usize, place: usize) -> Option<Judged> {
    let (_, heights_m, pitches_deg) = KINDS[kind];
    let cameras = vec![ranges(heights_m, pitches_deg, place)];
    let height_m = cameras[0].height_m[0];
    let config = SceneConfig { cameras, regions: region(place), ..SceneConfig::default() };
    let stream = SceneStream { config, seed: SEED + (kind * CAMERAS + place) as u64 };
    let frames: Vec<_> = (0..IMAGES).map(|index| stream.frame(index)).collect();
    let turned = frames[0].camera;
    let [cx, cy] = turned.principal_point();
    let upright = Camera::from_intrinsics(turned.focal_x(), turned.focal_y(), cx, cy).unwrap();
    let mut calibrator = RoadCalibrator::new(pipeline.clone(), upright, Road::Below).unwrap();
    let mut told = None;
    for _ in 0..2 {
        for frame in &frames {
            calibrator.add(&frame.image).unwrap();
        }
        told = Some(calibrator.end_round().ok()?);
    }
    Some(Judged { height_m, attitude_deg: turned.attitude().map(f64::to_degrees), told: told? })
}

fn row(kind: usize, judged: &[Judged]) -> Vec<String> {
    let (name, [lowest, highest], [least, most]) = KINDS[kind];
    let of = |error: &dyn Fn(&Judged) -> f64| judged.iter().map(error).collect::<Vec<f64>>();
    let mean = |errors: &[f64]| errors.iter().map(|error| error.abs()).sum::<f64>() / errors.len() as f64;
    let largest = |errors: &[f64]| errors.iter().fold(0.0, |most: f64, error| most.max(error.abs()));
    let pitch = of(&|one| one.told.pitch_rad[0].to_degrees() - one.attitude_deg[0]);
    let roll = of(&|one| one.told.roll_rad[0].to_degrees() + one.attitude_deg[1]);
    let height = of(&|one| one.told.height_m[0] / one.height_m - 1.0);
    let held = |off: &dyn Fn(&Judged) -> f64| {
        let within = |sigmas: f64| judged.iter().filter(|one| off(one).abs() <= sigmas).count();
        format!("{} / {} of {}", within(1.0), within(MOST), judged.len())
    };
    vec![
        format!("{CAMERAS} {name}"),
        format!("{lowest} to {highest} m"),
        format!("{least} to {most}°"),
        judged.len().to_string(),
        format!("{:.2}° ({:.2}°)", mean(&pitch), largest(&pitch)),
        format!("{:.2}° ({:.2}°)", mean(&roll), largest(&roll)),
        format!(
            "{:.1}% ({:.1}%; {:+.1}%)",
            100.0 * mean(&height),
            100.0 * largest(&height),
            100.0 * height.iter().sum::<f64>() / height.len() as f64
        ),
        held(&|one| (one.told.height_m[0] - one.height_m) / one.told.height_m[1]),
        held(&|one| (one.told.pitch_rad[0] - one.attitude_deg[0].to_radians()) / one.told.pitch_rad[1]),
    ]
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let pipeline = Pipeline::builder().engine(EngineKind::OpenVino).open().unwrap();
    let rows: Vec<Vec<String>> = (0..KINDS.len())
        .map(|kind| {
            let judged: Vec<Judged> = (0..CAMERAS).filter_map(|place| judged(&pipeline, kind, place)).collect();
            row(kind, &judged)
        })
        .collect();
    for row in &rows {
        println!("{}", row.join(" | "));
    }
    if let [option, path] = &words[..] {
        assert_eq!(option, "--table");
        MeasuredTable { rows, ..MeasuredTable::new(COMMAND, COLUMNS) }.write(Path::new(path)).unwrap();
    }
}
