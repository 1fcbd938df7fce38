//! The filter's options by what makes the truth likely.

use std::io::{self, Write};
use std::thread::{available_parallelism, scope};

use farsight::TrackerOptions;

use crate::data::{Sequence, judged};
use crate::settings::FILTER;
use crate::tracked;

/// By these factors an option is tried larger and smaller, the coarsest first.
const FACTORS: [f64; 3] = [1.8, 1.3, 1.1];

/// Shares are below this.
const MOST_SHARE: f64 = 0.98;

/// From so many standard deviations on an error counts linearly.
const LINEAR_SIGMAS: f64 = 2.5;

/// Standard deviation of a closing speed that is not told, m/s.
const UNTOLD_MPS: f64 = 12.0;

/// Looks for options of motion and noise with a lower [`loss`], one option after the other, until none helps.
pub(crate) fn fit(sequences: &[Sequence], start: &TrackerOptions) -> io::Result<TrackerOptions> {
    let mut out = io::stdout();
    let mut best = start.clone();
    let mut least = loss(sequences, &best);
    writeln!(out, "loss {least:.4}")?;
    for factor in FACTORS {
        loop {
            let before = least;
            for (name, place) in FILTER {
                for factor in [factor, 1.0 / factor] {
                    let mut changed = best.clone();
                    let value = place(&mut changed);
                    *value *= factor;
                    if name.ends_with("_share") {
                        *value = value.min(MOST_SHARE);
                    }
                    let told = *value;
                    let found = loss(sequences, &changed);
                    if found < least {
                        (best, least) = (changed, found);
                        writeln!(out, "loss {found:.4}: {name}={told:.4}")?;
                        break;
                    }
                }
            }
            if least > before - 1e-3 {
                break;
            }
        }
    }
    let told = FILTER.map(|(name, place)| format!("{name}={:.4}", place(&mut best.clone())));
    writeln!(out, "{}", told.join(" "))?;
    Ok(best)
}

/// Minus the logarithm of the likelihood of true distances and closing speeds, the mean over all that is told of, with
/// and without known ego motion. Large errors count less than a normal distribution has it.
fn loss(sequences: &[Sequence], options: &TrackerOptions) -> f64 {
    let workers = available_parallelism().map_or(1, Into::into);
    let parts: Vec<[f64; 4]> = scope(|scope| {
        let share = |worker: usize| {
            let mine = sequences.iter().skip(worker).step_by(workers);
            scope.spawn(move || mine.fold([0.0; 4], |sum, one| added(sum, of_sequence(one, options))))
        };
        let running: Vec<_> = (0..workers).map(share).collect();
        running.into_iter().map(|one| one.join().expect("a worker")).collect()
    });
    let [distance, distances, closing, closings] = parts.into_iter().fold([0.0; 4], added);
    distance / distances + closing / closings
}

fn added(sum: [f64; 4], more: [f64; 4]) -> [f64; 4] {
    std::array::from_fn(|i| sum[i] + more[i])
}

/// Sum and count of the losses of distances and of closing speeds.
fn of_sequence(sequence: &Sequence, options: &TrackerOptions) -> [f64; 4] {
    let mut sums = [0.0; 4];
    for ego in [sequence.ego.clone(), None] {
        let known = Sequence { ego, ..sequence.clone() };
        for sample in judged(&known, &tracked(&known, options, true)).samples {
            if let [Some(off), Some(sigma)] = sample.depth {
                let share = sigma / (sample.depth_m + off);
                sums[0] += surprise((off / sample.depth_m).ln_1p(), share);
                sums[1] += 1.0;
            }
            if let Some(known) = sample.true_closing_mps {
                let told = sample.closing.unwrap_or([known, UNTOLD_MPS]);
                sums[2] += surprise(told[0], told[1]);
                sums[3] += 1.0;
            }
        }
    }
    sums
}

fn surprise(off: f64, sigma: f64) -> f64 {
    let sigmas = (off / sigma).abs();
    let squared = 0.5 * sigmas.min(LINEAR_SIGMAS).powi(2);
    squared + LINEAR_SIGMAS * (sigmas - LINEAR_SIGMAS).max(0.0) + sigma.ln()
}
