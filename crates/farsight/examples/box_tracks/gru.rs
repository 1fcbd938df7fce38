//! A gated recurrent unit (Cho et al. 2014) with a linear layer on top, its gradient through time, and Adam.

use rand::{Rng, RngExt};

/// Numbers that the unit remembers.
pub(crate) const HIDDEN: usize = 48;

/// Numbers that it puts out.
pub(crate) const OUTPUTS: usize = 4;

/// Update gate, reset gate, candidate.
const GATES: usize = 3;

/// What Adam remembers of gradients and of their squares, and what it adds to the root of these.
const DECAYS: [f64; 2] = [0.9, 0.999];
const EPSILON: f64 = 1e-8;

/// Gradients of a batch that are longer are shortened to this.
const MAX_NORM: f64 = 5.0;

/// The network. Matrices are stored input by input: `[inputs, outputs]`.
#[derive(Debug, Clone)]
pub(crate) struct Gru {
    inputs: usize,
    pub(crate) values: Vec<f64>,
}

/// Where a layer lies in the values: its matrix, `[rows, columns]`.
#[derive(Clone, Copy)]
struct Place {
    start: usize,
    rows: usize,
    columns: usize,
}

/// What a step leaves for the way back.
pub(crate) struct Memory {
    input: Vec<f64>,
    before: [f64; HIDDEN],
    gates: [[f64; HIDDEN]; GATES],
    /// What the hidden numbers add to the candidate, before the reset gate.
    recurrent: [f64; HIDDEN],
    pub(crate) hidden: [f64; HIDDEN],
    pub(crate) output: [f64; OUTPUTS],
}

impl Gru {
    /// Weights as PyTorch draws them, uniform within one over the root of the hidden numbers; the last layer puts out
    /// 0 at first.
    pub(crate) fn new(inputs: usize, rng: &mut impl Rng) -> Self {
        let mut network = Self { inputs, values: Vec::new() };
        let [_, _, _, last] = network.places();
        let reach = (HIDDEN as f64).sqrt().recip();
        network.values = (0..last.start).map(|_| rng.random_range(-reach..reach)).collect();
        network.values.resize(last.start + last.rows * last.columns, 0.0);
        network
    }

    /// From the inputs (and 1) to the gates, from the hidden numbers to them, the candidate's second bias, and from
    /// hidden numbers, inputs and 1 to the outputs.
    fn places(&self) -> [Place; 4] {
        let shapes = [
            [self.inputs + 1, GATES * HIDDEN],
            [HIDDEN, GATES * HIDDEN],
            [1, HIDDEN],
            [HIDDEN + self.inputs + 1, OUTPUTS],
        ];
        let mut start = 0;
        shapes.map(|[rows, columns]| {
            let place = Place { start, rows, columns };
            start += rows * columns;
            place
        })
    }

    /// One step after `before`.
    pub(crate) fn step(&self, input: &[f64], before: &[f64; HIDDEN]) -> Memory {
        let [of_input, of_hidden, second_bias, last] = self.places();
        let input: Vec<f64> = input.iter().copied().chain([1.0]).collect();
        let mut from_input = [0.0; GATES * HIDDEN];
        self.add_product(of_input, &input, &mut from_input);
        let mut from_hidden = [0.0; GATES * HIDDEN];
        self.add_product(of_hidden, before, &mut from_hidden);
        let mut gates = [[0.0; HIDDEN]; GATES];
        let mut recurrent = [0.0; HIDDEN];
        let mut hidden = [0.0; HIDDEN];
        for k in 0..HIDDEN {
            let [update, reset] =
                [0, 1].map(|gate| sigmoid(from_input[gate * HIDDEN + k] + from_hidden[gate * HIDDEN + k]));
            recurrent[k] = from_hidden[2 * HIDDEN + k] + self.values[second_bias.start + k];
            let candidate = (from_input[2 * HIDDEN + k] + reset * recurrent[k]).tanh();
            hidden[k] = (1.0 - update) * candidate + update * before[k];
            (gates[0][k], gates[1][k], gates[2][k]) = (update, reset, candidate);
        }
        let mut output = [0.0; OUTPUTS];
        let top: Vec<f64> = hidden.iter().chain(&input).copied().collect();
        self.add_product(last, &top, &mut output);
        Memory { input, before: *before, gates, recurrent, hidden, output }
    }

    /// Adds to `gradient` what the slopes of a sequence's outputs are worth.
    pub(crate) fn backward(&self, memories: &[Memory], slopes: &[[f64; OUTPUTS]], gradient: &mut [f64]) {
        let [of_input, of_hidden, second_bias, last] = self.places();
        let mut after = [0.0; HIDDEN];
        for (memory, slope) in memories.iter().zip(slopes).rev() {
            let Memory { input, before, gates: [update, reset, candidate], recurrent, hidden, .. } = memory;
            let top: Vec<f64> = hidden.iter().chain(input).copied().collect();
            add_outer(last, &top, slope, gradient);
            let from_output = self.transposed_product(last, slope);
            let mut by_gate = [0.0; GATES * HIDDEN];
            let mut by_recurrent = [0.0; GATES * HIDDEN];
            let mut back = [0.0; HIDDEN];
            for k in 0..HIDDEN {
                let of_hidden = after[k] + from_output[k];
                let of_update = of_hidden * (before[k] - candidate[k]) * update[k] * (1.0 - update[k]);
                let of_candidate = of_hidden * (1.0 - update[k]) * (1.0 - candidate[k] * candidate[k]);
                let of_reset = of_candidate * recurrent[k] * reset[k] * (1.0 - reset[k]);
                by_gate[k] = of_update;
                by_gate[HIDDEN + k] = of_reset;
                by_gate[2 * HIDDEN + k] = of_candidate;
                by_recurrent[k] = of_update;
                by_recurrent[HIDDEN + k] = of_reset;
                by_recurrent[2 * HIDDEN + k] = of_candidate * reset[k];
                gradient[second_bias.start + k] += of_candidate * reset[k];
                back[k] = of_hidden * update[k];
            }
            add_outer(of_input, input, &by_gate, gradient);
            add_outer(of_hidden, before, &by_recurrent, gradient);
            for (sum, value) in back.iter_mut().zip(self.transposed_product(of_hidden, &by_recurrent)) {
                *sum += value;
            }
            after = back;
        }
    }

    fn add_product(&self, place: Place, input: &[f64], sums: &mut [f64]) {
        let matrix = &self.values[place.start..place.start + place.rows * place.columns];
        for (row, value) in matrix.chunks_exact(place.columns).zip(input) {
            for (sum, weight) in sums.iter_mut().zip(row) {
                *sum += weight * value;
            }
        }
    }

    fn transposed_product(&self, place: Place, slope: &[f64]) -> Vec<f64> {
        let matrix = &self.values[place.start..place.start + place.rows * place.columns];
        matrix.chunks_exact(place.columns).map(|row| row.iter().zip(slope).map(|(a, b)| a * b).sum()).collect()
    }
}

fn add_outer(place: Place, input: &[f64], slope: &[f64], gradient: &mut [f64]) {
    let matrix = &mut gradient[place.start..place.start + place.rows * place.columns];
    for (row, value) in matrix.chunks_exact_mut(place.columns).zip(input) {
        for (sum, slope) in row.iter_mut().zip(slope) {
            *sum += slope * value;
        }
    }
}

fn sigmoid(value: f64) -> f64 {
    1.0 / (1.0 + (-value).exp())
}

/// Adam (Kingma and Ba 2015).
pub(crate) struct Adam {
    moments: Vec<[f64; 2]>,
    steps: i32,
}

impl Adam {
    pub(crate) fn new(network: &Gru) -> Self {
        Self { moments: vec![[0.0; 2]; network.values.len()], steps: 0 }
    }

    pub(crate) fn step(&mut self, network: &mut Gru, gradient: &[f64], rate: f64) {
        self.steps += 1;
        let norm = gradient.iter().map(|slope| slope * slope).sum::<f64>().sqrt();
        let factor = (MAX_NORM / norm.max(f64::MIN_POSITIVE)).min(1.0);
        let corrections = DECAYS.map(|decay| 1.0 - decay.powi(self.steps));
        for ((value, slope), moments) in network.values.iter_mut().zip(gradient).zip(&mut self.moments) {
            let slope = factor * slope;
            for (moment, (new, decay)) in moments.iter_mut().zip([slope, slope * slope].into_iter().zip(DECAYS)) {
                *moment = decay * *moment + (1.0 - decay) * new;
            }
            let [mean, square] = [0, 1].map(|k| moments[k] / corrections[k]);
            *value -= rate * mean / (square.sqrt() + EPSILON);
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let mut network = Gru::new(3, &mut rng);
        for value in &mut network.values {
            *value = rng.random_range(-0.4..0.4);
        }
        let inputs: Vec<[f64; 3]> = (0..5).map(|_| [0; 3].map(|_| rng.random_range(-1.0..1.0))).collect();
        let run = |network: &Gru| {
            let mut hidden = [0.0; HIDDEN];
            let step = |input: &[f64; 3]| {
                let memory = network.step(input, &hidden);
                hidden = memory.hidden;
                memory
            };
            inputs.iter().map(step).collect::<Vec<Memory>>()
        };
        // Half the sum of the squares.
        let loss = |network: &Gru| run(network).iter().flat_map(|one| one.output).map(|v| v * v / 2.0).sum::<f64>();
        let memories = run(&network);
        let slopes: Vec<[f64; OUTPUTS]> = memories.iter().map(|one| one.output).collect();
        let mut gradient = vec![0.0; network.values.len()];
        network.backward(&memories, &slopes, &mut gradient);
        for place in (0..gradient.len()).step_by(13) {
            let mut moved = |by: f64| {
                network.values[place] += by;
                loss(&network)
            };
            let (above, below) = (moved(1e-5), moved(-2e-5));
            moved(1e-5);
            let expected = (above - below) / 2e-5;
            assert!((gradient[place] - expected).abs() < 1e-7, "{place}: {} is not {expected}", gradient[place]);
        }
    }
}
