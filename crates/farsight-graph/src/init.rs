//! Weights before training: drawn here and not by an engine, so that a seed means the same network everywhere.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;

use crate::graph::{Graph, Init, Parameter};
use crate::weights::{WeightTensor, Weights};

/// Initial weights of `graph`.
///
/// Every parameter has a stream of its own, made from `seed` and its name: adding a block to the network changes
/// nothing elsewhere, so networks with and without MSFE start from the same backbone.
pub fn initial_weights(graph: &Graph, seed: u64) -> Weights {
    let tensor =
        |p: &Parameter| (p.name.clone(), WeightTensor { shape: p.shape.clone(), values: initial_values(p, seed) });
    Weights { tensors: graph.parameters.iter().map(tensor).collect(), metadata: BTreeMap::new() }
}

fn initial_values(parameter: &Parameter, seed: u64) -> Vec<f32> {
    let count = parameter.len();
    let mut rng = Pcg64Mcg::seed_from_u64(seed ^ fnv1a(parameter.name.as_bytes()));
    match parameter.init {
        Init::Constant(value) => vec![value; count],
        Init::Uniform(bound) => (0..count).map(|_| rng.random_range(-bound..=bound)).collect(),
        Init::Normal(std) => (0..count).map(|_| std * rng.sample::<f32, _>(StandardNormal)).collect(),
        Init::BilinearUp => bilinear_kernel(parameter.shape[3]).repeat(parameter.shape[0]),
    }
}

/// The `kernel` x `kernel` weights of a bilinear enlargement (spec 3.2).
fn bilinear_kernel(kernel: usize) -> Vec<f32> {
    let reach = kernel.div_ceil(2);
    let center = (2 * reach - 1 - reach % 2) as f32 / (2 * reach) as f32;
    let profile: Vec<f32> = (0..kernel).map(|tap| 1.0 - (tap as f32 / reach as f32 - center).abs()).collect();
    profile.iter().flat_map(|row| profile.iter().map(move |column| row * column)).collect()
}

/// FNV-1a, which is the same on every machine and in every release of the standard library.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::bilinear_kernel;

    #[test]
    fn bilinear_profiles_are_those_of_the_specification() {
        let four = bilinear_kernel(4);
        assert_eq!(four[..4].iter().map(|v| v / four[0] * 0.25).collect::<Vec<_>>(), [0.25, 0.75, 0.75, 0.25]);
        let eight: Vec<f32> = bilinear_kernel(8)[..8].iter().map(|v| v / 0.125).collect();
        assert_eq!(eight, [0.125, 0.375, 0.625, 0.875, 0.875, 0.625, 0.375, 0.125]);
    }
}
