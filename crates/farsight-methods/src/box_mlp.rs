//! Distance from a 2D box and a class alone, learnt: a multi-layer perceptron after `DisNet` (Haseeb et al., *A Novel
//! Method for Distance Estimation from Monocular Camera*, 2018), which has the same six inputs and three hidden layers
//! of 100 with SELU.
//!
//! Here sides of boxes are divided by the focal length, so that any camera will do, and they and the depth are taken as
//! logarithms, so that an error of a tenth counts the same near and far. It looks at no pixel: what a detector's own
//! distance has to beat.

use farsight_core::{Box2d, Camera};
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// Logarithms of height, width and diagonal of the box, as tangents; mean height, width and length of the class,
/// metres.
const FEATURES: usize = 6;

/// Inputs of the layers, and the one output.
const WIDTHS: [usize; 5] = [FEATURES, 100, 100, 100, 1];

/// A smaller box says nothing, pixels.
const MIN_SIDE_PX: f64 = 1.0;

const BATCH: usize = 64;
const EPOCHS: usize = 20;
const LEARNING_RATE: f64 = 1e-3;

/// What Adam remembers of gradients and of their squares, and what it adds to the root of these.
const DECAYS: [f64; 2] = [0.9, 0.999];
const EPSILON: f64 = 1e-8;

/// Scale and slope of SELU (Klambauer et al. 2017), with which layers keep their inputs' mean and variance.
const SELU_SCALE: f64 = 1.050_700_987_355_480_5;
const SELU_ALPHA: f64 = 1.673_263_242_354_377_2;

/// A box whose distance is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Example {
    /// What the network sees of it ([`features`]).
    pub features: [f64; FEATURES],
    /// Depth of the object, metres.
    pub depth_m: f64,
}

/// What the network sees of a box of an object whose class has the mean size `hwl` (height, width, length, metres);
/// none of a box with a side of less than a pixel.
pub fn features(box2d: &Box2d, camera: &Camera, hwl: [f64; 3]) -> Option<[f64; FEATURES]> {
    let (width, height) = (box2d.width(), box2d.height());
    if width.is_nan() || height.is_nan() || width.min(height) < MIN_SIDE_PX {
        return None;
    }
    let (width, height) = (width / camera.focal_x(), height / camera.focal_y());
    let [h, w, l] = hwl;
    Some([height.ln(), width.ln(), height.hypot(width).ln(), h, w, l])
}

/// A network that has learnt.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxMlp {
    layers: Vec<Layer>,
    /// Mean and standard deviation of each feature, and last of the logarithm of the depth, among the examples.
    spread: [[f64; 2]; FEATURES + 1],
}

impl BoxMlp {
    /// Learns from `examples`: mean squared error of the logarithm of the depth, Adam with a rate that falls to zero
    /// along a cosine. None without an example.
    pub fn fit(examples: &[Example], rng: &mut impl Rng) -> Option<Self> {
        let count = examples.len() as f64;
        let spread = |value: &dyn Fn(&Example) -> f64| {
            let mean = examples.iter().map(value).sum::<f64>() / count;
            let variance = examples.iter().map(|one| (value(one) - mean).powi(2)).sum::<f64>() / count;
            // What is the same everywhere says nothing.
            [mean, if variance > 0.0 { variance.sqrt() } else { 1.0 }]
        };
        if examples.is_empty() {
            return None;
        }
        let mut spreads = [[0.0, 1.0]; FEATURES + 1];
        for (k, known) in spreads.iter_mut().enumerate() {
            *known = if k < FEATURES { spread(&|one| one.features[k]) } else { spread(&|one| one.depth_m.ln()) };
        }
        let layers = WIDTHS.windows(2).map(|pair| Layer::new(pair[0], pair[1], rng)).collect();
        let mut network = Self { layers, spread: spreads };
        let mut adam = Adam::new(&network.layers);
        let mut order: Vec<&Example> = examples.iter().collect();
        let steps = EPOCHS * examples.len().div_ceil(BATCH);
        for _ in 0..EPOCHS {
            order.shuffle(rng);
            for batch in order.chunks(BATCH) {
                let gradient = network.gradient(batch);
                let progress = adam.steps as f64 / steps as f64;
                let rate = LEARNING_RATE * 0.5 * (1.0 + (std::f64::consts::PI * progress).cos());
                adam.step(&mut network.layers, &gradient, rate);
            }
        }
        Some(network)
    }

    /// Depth, metres, of what has these [`features`].
    pub fn depth_m(&self, features: &[f64; FEATURES]) -> f64 {
        let [mean, deviation] = self.spread[FEATURES];
        let outputs = self.outputs(features);
        (mean + deviation * outputs[outputs.len() - 1][0]).exp()
    }

    /// The features in standard deviations, then what each layer puts out, after its activation.
    fn outputs(&self, features: &[f64; FEATURES]) -> Vec<Vec<f64>> {
        let inputs = features.iter().zip(&self.spread).map(|(value, [mean, deviation])| (value - mean) / deviation);
        let mut outputs = vec![inputs.collect::<Vec<_>>()];
        for (place, layer) in self.layers.iter().enumerate() {
            let mut output = layer.output(&outputs[place]);
            if place + 1 < self.layers.len() {
                for value in &mut output {
                    *value = selu(*value);
                }
            }
            outputs.push(output);
        }
        outputs
    }

    /// Error of the logarithm of the depth, in its standard deviations.
    fn error(&self, output: f64, example: &Example) -> f64 {
        let [mean, deviation] = self.spread[FEATURES];
        output - (example.depth_m.ln() - mean) / deviation
    }

    /// Gradient of half the mean squared error.
    fn gradient(&self, batch: &[&Example]) -> Vec<Layer> {
        let mut gradient: Vec<Layer> = self.layers.iter().map(Layer::zeros).collect();
        for example in batch {
            let outputs = self.outputs(&example.features);
            let mut slope = vec![self.error(outputs[WIDTHS.len() - 1][0], example) / batch.len() as f64];
            for (place, layer) in self.layers.iter().enumerate().rev() {
                slope = layer.backward(&mut gradient[place], &outputs[place], &slope);
                if place > 0 {
                    let each = slope.iter_mut().zip(&outputs[place]);
                    each.for_each(|(slope, output)| *slope *= selu_slope(*output));
                }
            }
        }
        gradient
    }
}

/// Scaled exponential linear unit.
fn selu(value: f64) -> f64 {
    SELU_SCALE * if value > 0.0 { value } else { SELU_ALPHA * value.exp_m1() }
}

/// Its slope where it puts out this.
fn selu_slope(output: f64) -> f64 {
    if output > 0.0 { SELU_SCALE } else { output + SELU_SCALE * SELU_ALPHA }
}

/// A fully connected layer, or the gradient of one.
#[derive(Debug, Clone, PartialEq)]
struct Layer {
    inputs: usize,
    /// `[outputs, inputs]`.
    weights: Vec<f64>,
    bias: Vec<f64>,
}

impl Layer {
    /// As SELU asks for: normal, with the variance of one over the inputs.
    fn new(inputs: usize, outputs: usize, rng: &mut impl Rng) -> Self {
        let deviation = (inputs as f64).sqrt().recip();
        let weights = (0..inputs * outputs).map(|_| deviation * rng.sample::<f64, _>(StandardNormal)).collect();
        Self { inputs, weights, bias: vec![0.0; outputs] }
    }

    fn zeros(&self) -> Self {
        Self { inputs: self.inputs, weights: vec![0.0; self.weights.len()], bias: vec![0.0; self.bias.len()] }
    }

    fn output(&self, input: &[f64]) -> Vec<f64> {
        let dot = |row: &[f64]| row.iter().zip(input).map(|(weight, value)| weight * value).sum::<f64>();
        self.weights.chunks_exact(self.inputs).zip(&self.bias).map(|(row, bias)| dot(row) + bias).collect()
    }

    /// Adds what an `input` and the slope of its output are worth to `gradient`; the slope of the input.
    fn backward(&self, gradient: &mut Self, input: &[f64], slope: &[f64]) -> Vec<f64> {
        let mut before = vec![0.0; self.inputs];
        for (place, slope) in slope.iter().enumerate() {
            let row = place * self.inputs..(place + 1) * self.inputs;
            gradient.bias[place] += slope;
            for (sum, value) in gradient.weights[row.clone()].iter_mut().zip(input) {
                *sum += slope * value;
            }
            for (sum, weight) in before.iter_mut().zip(&self.weights[row]) {
                *sum += slope * weight;
            }
        }
        before
    }

    fn values(&self) -> impl Iterator<Item = &f64> {
        self.weights.iter().chain(&self.bias)
    }

    fn values_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        self.weights.iter_mut().chain(&mut self.bias)
    }
}

/// Adam (Kingma and Ba 2015).
struct Adam {
    /// Running means of the gradients and of their squares.
    moments: Vec<[f64; 2]>,
    steps: usize,
}

impl Adam {
    fn new(layers: &[Layer]) -> Self {
        Self { moments: vec![[0.0; 2]; layers.iter().map(|layer| layer.values().count()).sum()], steps: 0 }
    }

    fn step(&mut self, layers: &mut [Layer], gradient: &[Layer], rate: f64) {
        self.steps += 1;
        let corrections = DECAYS.map(|decay| 1.0 - decay.powf(self.steps as f64));
        let values = layers.iter_mut().flat_map(Layer::values_mut).zip(gradient.iter().flat_map(Layer::values));
        for ((value, slope), moments) in values.zip(&mut self.moments) {
            for (moment, (new, decay)) in moments.iter_mut().zip([*slope, slope * slope].into_iter().zip(DECAYS)) {
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

    /// Boxes of plates 1.5 m high and 1.8 m wide, 4 to 70 m off.
    fn plates(count: usize, rng: &mut impl Rng) -> Vec<Example> {
        let camera = Camera::from_hfov(80.0, 1280, 384).unwrap();
        let plate = |_| {
            let depth_m = (rng.random_range(4.0_f64.ln()..70.0_f64.ln())).exp();
            let [width, height] = [1.8, 1.5].map(|side| camera.focal_x() * side / depth_m);
            let box2d = Box2d::new(600.0, 100.0, 600.0 + width, 100.0 + height);
            Example { features: features(&box2d, &camera, [1.5, 1.6, 3.9]).unwrap(), depth_m }
        };
        (0..count).map(plate).collect()
    }

    #[test]
    fn plates_of_one_size_are_found_where_they_stand() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let network = BoxMlp::fit(&plates(2000, &mut rng), &mut rng).unwrap();
        for Example { features, depth_m } in plates(50, &mut rng) {
            let found = network.depth_m(&features);
            assert!((found / depth_m - 1.0).abs() < 0.02, "{found} m, not {depth_m} m");
        }
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let examples = plates(5, &mut rng);
        let batch: Vec<&Example> = examples.iter().collect();
        let layers = WIDTHS.windows(2).map(|pair| Layer::new(pair[0], pair[1], &mut rng)).collect();
        let mut network = BoxMlp { layers, spread: [[-2.0, 0.7]; FEATURES + 1] };
        let loss = |network: &BoxMlp| {
            let error = |one: &&Example| network.error(network.outputs(&one.features)[4][0], one).powi(2) / 2.0;
            batch.iter().map(error).sum::<f64>() / batch.len() as f64
        };
        let gradient = network.gradient(&batch);
        let slopes: Vec<Vec<f64>> = gradient.iter().map(|layer| layer.values().copied().collect()).collect();
        for (place, slopes) in slopes.iter().enumerate() {
            let largest = slopes.iter().fold(0.0_f64, |most, slope| most.max(slope.abs()));
            for k in (0..slopes.len()).step_by(37) {
                let mut moved = |by: f64| {
                    *network.layers[place].values_mut().nth(k).unwrap() += by;
                    loss(&network)
                };
                let (above, below) = (moved(1e-5), moved(-2e-5));
                moved(1e-5);
                let expected = (above - below) / 2e-5;
                assert!((slopes[k] - expected).abs() < 1e-6 * largest.max(1.0), "layer {place}, {k}: {expected}");
            }
        }
    }

    #[test]
    fn the_camera_does_not_matter() {
        let (wide, narrow) = (Camera::from_hfov(90.0, 1000, 400).unwrap(), Camera::from_hfov(30.0, 1000, 400).unwrap());
        let zoom = narrow.focal_x() / wide.focal_x();
        let near = features(&Box2d::new(10.0, 10.0, 50.0, 40.0), &wide, [1.5, 1.6, 3.9]).unwrap();
        let far = features(&Box2d::new(0.0, 0.0, 40.0 * zoom, 30.0 * zoom), &narrow, [1.5, 1.6, 3.9]).unwrap();
        assert!(near.iter().zip(far).all(|(a, b)| (a - b).abs() < 1e-9), "{near:?}, {far:?}");
    }

    #[test]
    fn what_says_nothing_gives_nothing() {
        let camera = Camera::from_hfov(80.0, 1280, 384).unwrap();
        for box2d in
            [Box2d::new(0.0, 0.0, 0.5, 9.0), Box2d::new(0.0, 9.0, 9.0, 3.0), Box2d::new(0.0, 0.0, f64::NAN, 9.0)]
        {
            assert_eq!(features(&box2d, &camera, [1.5, 1.6, 3.9]), None, "{box2d:?}");
        }
        assert_eq!(BoxMlp::fit(&[], &mut Pcg64Mcg::seed_from_u64(3)), None);
    }
}
