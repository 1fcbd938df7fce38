//! What the network says of a track, and how it learns to.

use std::f64::consts::SQRT_2;

use rand::Rng;
use rand::seq::SliceRandom;

use crate::gru::{Adam, Gru, HIDDEN, Memory, OUTPUTS};
use crate::observe::{BoxTrack, FEATURES, FILTERED, Step};

/// One output is worth so much: of the depth's logarithm, and of the speed ahead, m/s, which is turned into the change
/// of that logarithm by the single image's distance of the nearest face.
const DEPTH_SCALE: f64 = 0.05;
const SPEED_SCALE: f64 = 5.0;

const BATCH: usize = 16;
const LEARNING_RATE: f64 = 4e-3;

/// Of the logarithm of an error bar, in units of the scales.
const LOG_BAR: [f64; 2] = [-6.0, 3.0];

/// What a network sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Inputs {
    /// Detections, and how the camera moves.
    Boxes,
    /// What the filter makes of them, too, which it corrects.
    Filter,
}

/// A network, and what its inputs usually are.
pub(crate) struct BoxNetwork {
    gru: Gru,
    inputs: Inputs,
    /// Mean and standard deviation of each feature.
    spread: [[f64; 2]; FEATURES],
    /// Factors on the error bars.
    bars: [f64; 2],
}

/// What is said after a step: by how much the logarithm of the single image's depth is to be corrected, and the change
/// in a second of that of the nearest face's depth; each with its standard deviation.
pub(crate) type Answer = [[f64; 2]; 2];

impl BoxNetwork {
    /// Learns for so many epochs, from one draw after the other.
    pub(crate) fn trained(inputs: Inputs, epochs: usize, draws: &[Vec<BoxTrack>], rng: &mut impl Rng) -> Self {
        let steps = || draws.iter().flatten().flat_map(|one| &one.steps);
        let spread = std::array::from_fn(|k| spread(steps().map(|one| one.features[k])));
        let gru = Gru::new(FEATURES, rng);
        let mut network = Self { gru, inputs, spread, bars: [1.0; 2] };
        let mut adam = Adam::new(&network.gru);
        for epoch in 0..epochs {
            let has_truth = |one: &&BoxTrack| one.steps.iter().any(|step| step.truth.is_some());
            let mut order: Vec<&BoxTrack> = draws[epoch % draws.len()].iter().filter(has_truth).collect();
            order.shuffle(rng);
            let batches: Vec<&[&BoxTrack]> = order.chunks(BATCH).collect();
            let mut sum = 0.0;
            for (place, batch) in batches.iter().enumerate() {
                let progress = (epoch as f64 + place as f64 / batches.len() as f64) / epochs as f64;
                let rate = LEARNING_RATE * 0.5 * (1.0 + (std::f64::consts::PI * progress).cos());
                let (loss, gradient) = network.gradient(batch);
                adam.step(&mut network.gru, &gradient, rate);
                sum += loss;
            }
            eprintln!("epoch {epoch}: loss {:.4}", sum / batches.len() as f64);
        }
        network
    }

    /// How many numbers it has learnt.
    pub(crate) fn parameters(&self) -> usize {
        self.gru.values.len()
    }

    fn run(&self, track: &BoxTrack) -> Vec<Memory> {
        let mut hidden = [0.0; HIDDEN];
        let step = |step: &Step| {
            let seen = match self.inputs {
                Inputs::Boxes => FEATURES - FILTERED,
                Inputs::Filter => FEATURES,
            };
            let scaled = |(k, [mean, deviation]): (usize, &[f64; 2])| {
                if k < seen { ((step.features[k] - mean) / deviation).clamp(-4.0, 4.0) } else { 0.0 }
            };
            let input: Vec<f64> = self.spread.iter().enumerate().map(scaled).collect();
            let memory = self.gru.step(&input, &hidden);
            hidden = memory.hidden;
            memory
        };
        track.steps.iter().map(step).collect()
    }

    /// What it starts from: what is to be added to the outputs, and what these are worth.
    fn base(&self, step: &Step) -> [[f64; 2]; 2] {
        let [depth, rate] = match self.inputs {
            Inputs::Boxes => [0.0; 2],
            Inputs::Filter => step.filter.map(Option::unwrap_or_default),
        };
        [[depth, DEPTH_SCALE], [rate, SPEED_SCALE / (step.depth_m - step.half_m)]]
    }

    /// Mean loss of a batch, and its gradient: Laplace's distribution.
    fn gradient(&self, batch: &[&BoxTrack]) -> (f64, Vec<f64>) {
        let mut gradient = vec![0.0; self.gru.values.len()];
        let count = batch.iter().flat_map(|one| &one.steps).filter(|one| one.truth.is_some()).count() as f64;
        let mut loss = 0.0;
        for track in batch {
            let memories = self.run(track);
            let mut slopes = vec![[0.0; OUTPUTS]; memories.len()];
            for ((memory, step), slope) in memories.iter().zip(&track.steps).zip(&mut slopes) {
                let Some(truth) = step.truth else { continue };
                for (k, [base, scale]) in self.base(step).into_iter().enumerate() {
                    let [value, log_bar] = [memory.output[2 * k], memory.output[2 * k + 1]];
                    let limited = log_bar.clamp(LOG_BAR[0], LOG_BAR[1]);
                    let off = value - (truth[k] - base) / scale;
                    let relative = off.abs() / limited.exp();
                    loss += (relative + limited) / count;
                    slope[2 * k] = off.signum() / limited.exp() / count;
                    // Outside its limits it comes back.
                    slope[2 * k + 1] = (1.0 - relative + (log_bar - limited)) / count;
                }
            }
            self.gru.backward(&memories, &slopes, &mut gradient);
        }
        (loss, gradient)
    }

    /// What it says of each step.
    pub(crate) fn answers(&self, track: &BoxTrack) -> Vec<Answer> {
        let answer = |(memory, step): (&Memory, &Step)| {
            let base = self.base(step);
            [0, 1].map(|k| {
                let [value, log_bar] = [memory.output[2 * k], memory.output[2 * k + 1].clamp(LOG_BAR[0], LOG_BAR[1])];
                let [start, scale] = base[k];
                // The 90% interval of Laplace's distribution is that of a normal one whose deviation is this (to 1%).
                [start + scale * value, self.bars[k] * SQRT_2 * scale * log_bar.exp()]
            })
        };
        self.run(track).iter().zip(&track.steps).map(answer).collect()
    }

    /// Makes its 90% intervals hold 90% of these.
    pub(crate) fn calibrate(&mut self, tracks: &[BoxTrack]) {
        const SIGMAS: f64 = 1.644_854;
        let mut relative = [Vec::new(), Vec::new()];
        for track in tracks {
            for (answer, step) in self.answers(track).iter().zip(&track.steps) {
                let Some(truth) = step.truth else { continue };
                for k in 0..2 {
                    relative[k].push((truth[k] - answer[k][0]).abs() / (SIGMAS * answer[k][1]));
                }
            }
        }
        for (bar, mut values) in self.bars.iter_mut().zip(relative) {
            values.sort_unstable_by(f64::total_cmp);
            *bar *= values.get(values.len() * 9 / 10).copied().unwrap_or(1.0);
        }
    }
}

fn spread(values: impl Iterator<Item = f64> + Clone) -> [f64; 2] {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    let variance = values.map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    [mean, if variance > 0.0 { variance.sqrt() } else { 1.0 }]
}
