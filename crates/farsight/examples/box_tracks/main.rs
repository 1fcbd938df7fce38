//! Whether a small recurrent network on tracks of boxes tells distance and speed better than the filter does:
//!
//! ```sh
//! cargo run --release -p farsight --example box_tracks -- --noise DATA DETECTIONS --tune DATA DETECTIONS \
//!     --judge NAME DATA DETECTIONS [--table FILE]
//! ```
//!
//! It learns from simulated traffic (no pictures) with the errors that a model made in the sequences of `--noise`, and
//! from these sequences themselves. Error bars are set on `--tune`. All three may be given several times; folders are
//! those of `tune_tracks`. It sees the tracks that the tracker makes; the filter and it are judged by the same tracks.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::format_push_string,
    clippy::print_stderr,
    reason = "an example"
)]

#[path = "../tune_tracks/data.rs"]
mod data;
mod gru;
mod network;
mod observe;
mod simulate;

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::Path;

use farsight_core::statistics::{quantile, sorted};
use farsight_eval::Bootstrap;
use farsight_eval::tracks::{Errors, JudgedSequence, PredictedFrame, TracksReport};
use farsight_files::MeasuredTable;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use data::{Sequence, judged, sequences, told};
use network::{Answer, BoxNetwork, Inputs};
use observe::{BoxTrack, Observed, half_m};
use simulate::{Donors, detections, traffic};

/// Simulated sequences: their seed, how many, how long, frames a second.
const SEED: u64 = 400;
const SEQUENCES: u64 = 480;
const FRAMES: usize = 50;
const FPS: f64 = 10.0;

/// So often other errors are drawn for them; each epoch of a training has one of these draws.
const DRAWS: usize = 8;
const EPOCHS: usize = 40;

/// Networks of each kind.
const NETWORKS: u64 = 3;

/// How often tracks of real detections are among the simulated ones.
const REAL_TIMES: usize = 2;

/// An image counts less and less with its age, seconds.
const AVERAGED_S: f64 = 0.5;

/// Speeds are judged of tracks that are told of for so long, seconds, as in `eval-tracks`.
const SETTLED_S: f64 = 1.0;

/// Times to collision up to this one are judged, seconds.
const LONG_S: f64 = 6.0;

/// From so many standard deviations on it is said to close: one-sided 80%. Half the width of 90% intervals.
const CLOSES_SIGMAS: f64 = 0.842;
const MOST_SIGMAS: f64 = 1.644_854;

/// A row of the table.
type Row = [String; 10];

const COLUMNS: [&str; 10] = [
    "sequences",
    "told by",
    "distance: MAE",
    "closing speed: MAE below 30 m",
    "to 60 m",
    "time to collision below 6 s: relative error",
    "told in",
    "90% intervals hold: distance",
    "closing speed",
    "time to collision",
];

const COMMAND: &str = "cargo run --release -p farsight --example box_tracks -- --noise 300 detections/300 --noise 301 detections/301 \
    --tune 100 detections/100 --judge \"seed 200\" 200 detections/200 --judge \"seeds 201, 202\" 201 detections/201 \
    --judge \"seeds 201, 202\" 202 detections/202 --table docs/results/box-tracks.json";

struct Set {
    name: String,
    sequences: Vec<Sequence>,
    observed: Vec<Observed>,
}

fn main() -> std::io::Result<()> {
    let (mut noise, mut tune, mut judged, mut table) = (Vec::new(), Vec::new(), BTreeMap::new(), None);
    let mut arguments = std::env::args().skip(1);
    while let Some(name) = arguments.next() {
        let mut next = || arguments.next().expect("a value");
        let set = if name == "--judge" { next() } else { String::new() };
        if name == "--table" {
            table = Some(next());
            continue;
        }
        let found = sequences(Path::new(&next()), Path::new(&next()))?;
        match name.as_str() {
            "--noise" => noise.extend(found),
            "--tune" => tune.extend(found),
            "--judge" => judged.entry(set).or_insert_with(Vec::new).extend(found),
            _ => panic!("no option {name}"),
        }
    }
    let donors = Donors::new(&noise);
    let tracks = |all: &[Sequence]| all.iter().flat_map(|one| Observed::new(one).tracks).collect::<Vec<BoxTrack>>();
    let real = [tracks(&noise), tracks(&without_ego(&noise))];
    let known = [tracks(&tune), tracks(&without_ego(&tune))].concat();
    let simulated = traffic(SEED, SEQUENCES, FRAMES, FPS);
    let simulated = [without_ego(&simulated), simulated];
    // Every second draw is without ego motion.
    let draw = |number: usize| {
        let mut rng = Pcg64Mcg::seed_from_u64(number as u64);
        let mut drawn: Vec<BoxTrack> = (0..REAL_TIMES).flat_map(|_| real[1 - number % 2].iter().cloned()).collect();
        for one in &simulated[number % 2] {
            let found = detections(one, &donors, &mut rng);
            drawn.extend(Observed::new(&Sequence { detections: found, ..one.clone() }).tracks);
        }
        eprintln!("{} tracks, {} boxes", drawn.len(), drawn.iter().map(|one| one.steps.len()).sum::<usize>());
        drawn
    };
    let draws: Vec<Vec<BoxTrack>> = (0..DRAWS).map(draw).collect();
    let mut sets = Vec::new();
    for (name, sequences) in judged {
        let without = Set::new(format!("{name}, without ego motion"), without_ego(&sequences));
        sets.extend([Set::new(name, sequences), without]);
    }
    let mut rows: Vec<Vec<Row>> = sets.iter().map(Set::rows).collect();
    for (name, inputs) in [("network on boxes", Inputs::Boxes), ("network on boxes and filter", Inputs::Filter)] {
        let network = |seed: u64| {
            let mut network = BoxNetwork::trained(inputs, EPOCHS, &draws, &mut Pcg64Mcg::seed_from_u64(seed));
            network.calibrate(&known);
            eprintln!("{name}, seed {seed}: {} parameters", network.parameters());
            network
        };
        let networks: Vec<BoxNetwork> = (1..=NETWORKS).map(network).collect();
        for (set, rows) in sets.iter().zip(&mut rows) {
            rows.push(set.row(name, &networks.iter().map(|one| set.answered(one)).collect::<Vec<_>>()));
        }
    }
    let mut measured = MeasuredTable::new(COMMAND, COLUMNS);
    measured.rows = rows.into_iter().flatten().map(Into::into).collect();
    let mut out = std::io::stdout();
    for row in &measured.rows {
        writeln!(out, "{}", row.join(" | "))?;
    }
    if let Some(path) = table {
        measured.write(Path::new(&path)).unwrap();
    }
    Ok(())
}

fn without_ego(sequences: &[Sequence]) -> Vec<Sequence> {
    sequences.iter().map(|one| Sequence { ego: None, ..one.clone() }).collect()
}

impl Set {
    fn new(name: String, sequences: Vec<Sequence>) -> Self {
        let observed = sequences.iter().map(Observed::new).collect();
        Self { name, sequences, observed }
    }

    fn filtered(&self) -> Vec<JudgedSequence> {
        self.observed.iter().map(|one| one.judged.clone()).collect()
    }

    /// As the network tells them.
    fn answered(&self, network: &BoxNetwork) -> Vec<JudgedSequence> {
        let of_one = |(sequence, observed): (&Sequence, &Observed)| {
            let mut answers: BTreeMap<(usize, u64), (Answer, f64)> = BTreeMap::new();
            for track in &observed.tracks {
                for (step, answer) in track.steps.iter().zip(network.answers(track)) {
                    answers.insert((step.frame, track.id), (answer, step.depth_m));
                }
            }
            let frame = |(number, tracks): (usize, &Vec<farsight::Track>)| {
                let mut frame = told(sequence, number, tracks);
                tell(&mut frame, number, &answers);
                Some(frame)
            };
            judged(sequence, &observed.frames.iter().enumerate().map(frame).collect::<Vec<_>>())
        };
        self.sequences.iter().zip(&self.observed).map(of_one).collect()
    }

    /// Rows of what is no network.
    fn rows(&self) -> Vec<Row> {
        let mut rows = Vec::new();
        if self.sequences.iter().any(|one| one.ego.is_some()) {
            rows = vec![self.distances("single images", 1), self.distances("their average, perfectly moved", 0)];
        }
        rows.push(self.row("filter", &[]));
        rows
    }

    /// A row of several networks, or of the filter: means, and how far they are from the filter. Times to collision are
    /// compared where both tell one.
    fn row(&self, name: &str, networks: &[Vec<JudgedSequence>]) -> Row {
        let filter = self.filtered();
        let all: Vec<&[JudgedSequence]> =
            if networks.is_empty() { vec![&filter] } else { networks.iter().map(Vec::as_slice).collect() };
        let pairs: Vec<[Vec<Tally>; 2]> =
            all.iter().map(|one| [tallies(one, &filter), tallies(&filter, one)]).collect();
        let mean = |which: usize, k: usize, times: &[u32]| {
            pairs.iter().map(|pair| mae(&pair[which], k, times)).sum::<f64>() / pairs.len() as f64
        };
        let cell = |k: usize, unit: &str, scale: f64| {
            let digits = if unit == "%" { 1 } else { 3 };
            let mut cell = format!("{:.digits$}{unit}", scale * mean(0, k, &vec![1; filter.len()]));
            if !networks.is_empty() {
                let bootstrap = Bootstrap::default();
                let drawn = (0..bootstrap.resamples).map(|number| bootstrap.draw(filter.len(), number));
                let off = sorted(drawn.map(|times| scale * (mean(0, k, &times) - mean(1, k, &times))));
                let [low, high] = [0.025, 0.975].map(|share| quantile(&off, share));
                cell += &format!(" [{low:+.digits$}, {high:+.digits$}]");
            }
            cell
        };
        let errors: Vec<Errors> = all.iter().map(|one| TracksReport::new(one).errors).collect();
        let count = errors.len() as f64;
        let share = |value: &dyn Fn(&Errors) -> Option<f64>| {
            format!("{:.0}%", 100.0 * errors.iter().filter_map(value).sum::<f64>() / count)
        };
        let bins = || errors.iter().flat_map(|one| &one.ttc[..2]);
        let told = bins().map(|bin| bin.told).sum::<usize>() as f64 / count;
        let there = bins().map(|bin| bin.count).sum::<usize>() as f64 / count;
        [
            self.name.clone(),
            name.to_owned(),
            cell(0, " m", 1.0),
            cell(1, " m/s", 1.0),
            cell(2, " m/s", 1.0),
            cell(3, "%", 100.0),
            format!("{told:.0} of {there:.0}"),
            share(&|one| one.depth_coverage.map(|all| all[2])),
            share(&|one| one.closing_coverage.map(|all| all[2])),
            share(&|one| one.ttc_coverage),
        ]
    }

    /// Distances of single images, and what they give where the past ones are moved as their objects really moved, and
    /// averaged: what a filter that knows only them may hope for.
    fn distances(&self, name: &str, which: usize) -> Row {
        let mut sums = [0.0; 2];
        let mut count = 0.0;
        for (sequence, observed) in self.sequences.iter().zip(&self.observed) {
            for track in &observed.tracks {
                let (mut sum, mut weights, mut last) = (0.0, 0.0, None);
                for step in &track.steps {
                    let Some([correction, _]) = step.truth else { continue };
                    let dt_s = last.map_or(0.0, |last| (step.frame - last) as f64 / sequence.fps);
                    let (left, weight) = ((-dt_s / AVERAGED_S).exp(), step.log_sigma.powi(-2));
                    (sum, weights) = (left * sum + weight * correction, left * weights + weight);
                    last = Some(step.frame);
                    let true_m = step.depth_m * correction.exp();
                    for (total, off) in sums.iter_mut().zip([sum / weights, correction]) {
                        *total += true_m * (-off).exp_m1().abs();
                    }
                    count += 1.0;
                }
            }
        }
        let mut row: Row = std::array::from_fn(|_| "-".to_owned());
        (row[0], row[1], row[2]) = (self.name.clone(), name.to_owned(), format!("{:.3} m", sums[which] / count));
        row
    }
}

/// Of one sequence: sums and counts of the absolute errors of distance, of closing speed below 30 m and to 60 m, and of
/// the relative one of time to collision below 6 s.
type Tally = [[f64; 2]; 4];

/// Times to collision count where the others tell one, too.
fn tallies(judged: &[JudgedSequence], others: &[JudgedSequence]) -> Vec<Tally> {
    let of_one = |(one, other): (&JudgedSequence, &JudgedSequence)| {
        let mut tally = Tally::default();
        let mut add = |k: usize, off: f64| tally[k] = [tally[k][0] + off.abs(), tally[k][1] + 1.0];
        let told: BTreeSet<(usize, [u64; 2])> =
            other.samples.iter().filter(|one| one.ttc_s.is_some()).map(|one| (one.frame, one.ids)).collect();
        for sample in &one.samples {
            if let Some(off) = sample.depth[0] {
                add(0, off);
            }
            if sample.age_s < SETTLED_S {
                continue;
            }
            if let Some([off, _]) = sample.closing.filter(|_| sample.depth_m < 60.0) {
                add(if sample.depth_m < 30.0 { 1 } else { 2 }, off);
            }
            let is_told = told.contains(&(sample.frame, sample.ids));
            if let (Some(ttc_s), Some(known_s), true) = (sample.ttc_s, sample.true_ttc_s, is_told)
                && (0.0..LONG_S).contains(&known_s)
            {
                add(3, ttc_s / known_s - 1.0);
            }
        }
        tally
    };
    judged.iter().zip(others).map(of_one).collect()
}

/// Mean of one of the errors over sequences, each taken so many times.
fn mae(tallies: &[Tally], k: usize, times: &[u32]) -> f64 {
    let total =
        |part: usize| tallies.iter().zip(times).map(|(one, times)| f64::from(*times) * one[k][part]).sum::<f64>();
    total(0) / total(1)
}

/// Puts in what the network says, wherever the filter says something.
fn tell(frame: &mut PredictedFrame, number: usize, answers: &BTreeMap<(usize, u64), (Answer, f64)>) {
    for track in &mut frame.tracks {
        let Some(([[correction, log_sigma], [rate, rate_sigma]], single_m)) = answers.get(&(number, track.id)) else {
            continue;
        };
        let depth_m = single_m * correction.exp();
        let factor = depth_m / track.box3d.depth_m();
        track.box3d.location = track.box3d.location.map(|value| value * factor);
        track.range_sigma_m = Some(log_sigma * depth_m);
        track.speed_mps = None;
        if track.closing_mps.is_some() {
            let near_m = (depth_m - half_m(&track.box3d)).max(0.3);
            let sigma = (near_m * rate_sigma).hypot(rate * log_sigma * depth_m);
            track.closing_mps = Some([-rate * near_m, sigma]);
            let (fastest, slowest) = (-rate + MOST_SIGMAS * rate_sigma, -rate - MOST_SIGMAS * rate_sigma);
            track.ttc_s = (-rate > CLOSES_SIGMAS * rate_sigma).then(|| -1.0 / rate);
            track.ttc_interval_s = (fastest > 0.0).then(|| (1.0 / fastest, (slowest > 0.0).then(|| 1.0 / slowest)));
        }
    }
}
