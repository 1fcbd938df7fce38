//! The optimiser's steps against PyTorch's `torch.optim.Adam`, and what decay, bias factor and clipping mean.

use farsight_graph::init::initial_weights;
use farsight_graph::layers::{Builder, NormKind};
use farsight_graph::weights::Weights;
use farsight_train::adam::{Adam, AdamSettings};
use farsight_train::executor::{Network, Precision, doubles_from_tensor};
use tch::{Device, Tensor};

/// Double precision, after four steps.
const TOLERANCE: f64 = 1e-12;

/// The optimiser's state is stored in single precision.
const STORED: f64 = 1e-7;

const START: [f64; 4] = [0.5, -1.25, 2.0, 0.0];

/// Gradients of four steps: of changing sign, with a burst, zero until the last, and so small that epsilon counts.
const GRADIENTS: [[f64; 4]; 4] =
    [[0.3, -2.0, 0.0, 1e-9], [-0.1, -2.5, 0.0, 1e-9], [0.25, 40.0, 0.0, -3e-9], [0.2, -1.0, 0.5, 2e-9]];

/// A rate for each step, as a schedule gives them.
const RATES: [f64; 4] = [0.1, 0.05, 0.025, 0.0125];

/// What `torch.optim.Adam` of PyTorch 2.11 makes of them, in double precision.
///
/// A few lines of `NumPy` after the paper of Kingma and Ba agree to 4e-15.
const PYTORCH: [[f64; 4]; 4] = [
    [0.400_000_003_333_333_2, -1.150_000_000_5, 2.0, -0.009_090_909_090_909_09],
    [0.379_989_075_630_707, -1.100_017_948_922_234_1, 2.0, -0.013_636_363_636_363_634],
    [0.364_013_870_997_743_1, -1.114_397_237_191_04, 2.0, -0.012_637_637_757_915_75],
    [0.354_922_602_322_716_4, -1.120_103_667_689_064, 1.992_735_895_762_946_9, -0.012_893_109_656_186_093],
];

/// The same with `weight_decay=0.02`.
const PYTORCH_DECAY: [[f64; 4]; 4] = [
    [0.400_000_003_225_806_37, -1.150_000_000_493_827_1, 1.900_000_024_999_993_8, -0.009_090_909_090_909_09],
    [0.378_473_526_406_644_33, -1.100_013_344_175_74, 1.850_083_280_574_730_5, 0.028_112_854_845_908_9],
    [0.362_012_119_896_233_7, -1.114_374_464_531_911_8, 1.825_163_953_725_609_2, 0.017_339_490_601_769_786],
    [0.352_728_084_636_781_2, -1.120_069_250_680_000_7, 1.816_701_877_507_235_7, 0.009_856_448_581_987_783],
];

#[track_caller]
fn assert_near(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance * b.abs().max(1.0));
    assert!(near, "{what}: {found:?}, expected {expected:?}");
}

/// The weights called `name` after each step.
fn steps(settings: AdamSettings, name: &str) -> Vec<Vec<f64>> {
    let weights = Tensor::from_slice(&START).set_requires_grad(true);
    let mut adam = Adam::new(settings, [(name, &weights)].into_iter());
    let step = |(gradient, rate): (&[f64; 4], f64)| {
        adam.step(&[weights.shallow_clone()], &[Tensor::from_slice(gradient)], rate);
        doubles_from_tensor(&weights)
    };
    GRADIENTS.iter().zip(RATES).map(step).collect()
}

#[test]
fn steps_are_those_of_pytorch() {
    for (decay, expected) in [(0.0, PYTORCH), (0.02, PYTORCH_DECAY)] {
        let found = steps(AdamSettings::new(decay, 1.0), "head.weight");
        for (number, (found, expected)) in found.iter().zip(expected).enumerate() {
            assert_near(&format!("decay {decay}, step {}", number + 1), found, &expected, TOLERANCE);
        }
    }
}

#[test]
fn biases_move_by_their_own_rate() {
    let factor = 2.0;
    let settings = AdamSettings::new(0.0, factor);
    assert_eq!(steps(settings.clone(), "head.weight"), steps(AdamSettings::new(0.0, 1.0), "head.weight"));
    // Without decay a step does not depend on where the weights are, so all of them are twice as long.
    for (found, plain) in steps(settings, "head.bias").iter().zip(PYTORCH) {
        let expected: Vec<f64> = plain.iter().zip(START).map(|(end, start)| start + factor * (end - start)).collect();
        assert_near("bias", found, &expected, TOLERANCE);
    }
}

#[test]
fn decay_is_a_part_of_the_gradient() {
    // So it goes through the moments: in the first step every weight moves by the rate, whatever its size.
    // Decoupled decay (AdamW) would move each by its own hundredth of that.
    let weights = Tensor::from_slice(&[4.0, -0.5, 0.0]).set_requires_grad(true);
    let mut adam = Adam::new(AdamSettings::new(0.01, 1.0), [("w", &weights)].into_iter());
    adam.step(&[weights.shallow_clone()], &[weights.zeros_like()], 0.1);
    assert_near("decay alone", &doubles_from_tensor(&weights), &[3.9, -0.4, 0.0], 1e-6);
}

/// Two weights and two biases.
fn network() -> Network {
    let mut b = Builder::new(NormKind::Batch);
    let input = b.input(1);
    let output = b.conv_with_bias(input, "head", 2, 1, None);
    b.tap("out", output);
    let graph = b.finish();
    let mut weights = initial_weights(&graph, 0);
    for (name, values) in [("head.weight", [1.0, 2.0]), ("head.bias", [-3.0, 0.5])] {
        weights.tensors.get_mut(name).unwrap().values = values.to_vec();
    }
    Network::new(graph, &weights, Device::Cpu, Precision::F64).unwrap()
}

/// Something whose gradient is `weight` for the weights and `bias` for the biases.
fn objective(network: &Network, weight: [f64; 2], bias: [f64; 2]) -> Tensor {
    let along = |(name, tensor): (&str, &Tensor)| {
        let direction = if name == "head.bias" { bias } else { weight };
        (tensor.view(-1) * Tensor::from_slice(&direction)).sum(tch::Kind::Double)
    };
    network.trainable_parameters().map(along).sum()
}

/// The norm that a step tells, and a tenth of the gradient that it moved against: the mean after one step.
fn descent(clip_norm: f64, decay: f64) -> (f64, [Vec<f64>; 2]) {
    let network = network();
    let mut adam = Adam::new(AdamSettings::new(decay, 1.0), network.trainable_parameters());
    let norm = adam.descend(&network, &objective(&network, [3.0, 0.0], [0.0, -4.0]), clip_norm, 0.1).unwrap();
    let mut state = Weights::default();
    adam.store(&mut state);
    let mean = |name: &str| state.tensors[&format!("adam.mean.head.{name}")].values.iter().copied().map(f64::from);
    (norm, ["weight", "bias"].map(|name| mean(name).collect()))
}

#[test]
fn gradients_are_cut_to_the_norm_of_all_together() {
    let rows = [
        (0.0, [[0.3, 0.0], [0.0, -0.4]]),
        (5.0, [[0.3, 0.0], [0.0, -0.4]]),
        (6.0, [[0.3, 0.0], [0.0, -0.4]]),
        (1.0, [[0.06, 0.0], [0.0, -0.08]]),
    ];
    for (clip_norm, expected) in rows {
        let (norm, means) = descent(clip_norm, 0.0);
        assert_near("norm before the cut", &[norm], &[5.0], TOLERANCE);
        for (mean, expected) in means.iter().zip(expected) {
            assert_near(&format!("cut to {clip_norm}"), mean, &expected, STORED);
        }
    }
}

#[test]
fn decay_is_added_after_the_cut() {
    let (norm, [weight, bias]) = descent(1.0, 0.1);
    assert_near("norm of the gradient alone", &[norm], &[5.0], TOLERANCE);
    assert_near("weight", &weight, &[0.1 * (0.6 + 0.1), 0.1 * 0.2], STORED);
    assert_near("bias", &bias, &[0.1 * -0.3, 0.1 * (-0.8 + 0.05)], STORED);
}

#[test]
fn a_gradient_that_is_not_finite_moves_nothing() {
    for value in [f64::NAN, f64::INFINITY] {
        let network = network();
        let before = network.weights();
        let mut adam = Adam::new(AdamSettings::new(0.1, 1.0), network.trainable_parameters());
        let bad = adam.descend(&network, &objective(&network, [1.0, 1.0], [value, 1.0]), 1.0, 0.1).unwrap_err();
        assert_eq!(bad.parameter, "head.bias");
        assert!(!bad.norm.is_finite());
        assert_eq!(network.weights(), before);
    }
}
