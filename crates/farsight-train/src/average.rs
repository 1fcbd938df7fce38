//! Running means of a network's weights: an average of many steps is steadier than the last one, and often better on
//! what the network has never seen.

use farsight_graph::weights::Weights;
use tch::{Tensor, no_grad};

use crate::executor::{Network, fill, weight_from_tensor};

/// Prefix of the running means in a checkpoint.
const PREFIX: &str = "average.";

/// Exponential running means of all parameters and statistics (EMA), over the steps taken so far: each counts `decay`
/// times as much as the next.
#[derive(Debug)]
pub(crate) struct Averages {
    decay: f64,
    steps: u64,
    means: Vec<(String, Tensor)>,
}

impl Averages {
    /// No steps yet.
    pub(crate) fn new(decay: f64, network: &Network) -> Self {
        let means = network.parameters().map(|(name, tensor)| (name.to_owned(), tensor.detach().copy()));
        Self { decay, steps: 0, means: means.collect() }
    }

    /// Takes the weights after one more step in.
    pub(crate) fn follow(&mut self, network: &Network) {
        self.steps += 1;
        // The newest one's share of all steps so far: all of it after the first, so that the weights a run starts from
        // count as no step.
        let share = (1.0 - self.decay) / (1.0 - self.decay.powf(self.steps as f64));
        no_grad(|| {
            for ((_, mean), (_, tensor)) in self.means.iter_mut().zip(network.parameters()) {
                let _ = mean.lerp_(tensor, share);
            }
        });
    }

    /// Gives `network` the means; without a step it keeps what it has.
    pub(crate) fn use_averages(&self, network: &Network) {
        no_grad(|| {
            for ((_, mean), (_, tensor)) in self.means.iter().zip(network.parameters()) {
                tensor.shallow_clone().copy_(mean);
            }
        });
    }

    /// Adds the means to `weights`, beside the parameters.
    pub(crate) fn store(&self, weights: &mut Weights) {
        let means = self.means.iter().map(|(name, mean)| (format!("{PREFIX}{name}"), weight_from_tensor(mean)));
        weights.tensors.extend(means);
    }

    /// Puts the means in the place of the parameters in `weights`; the network keeps what it has.
    pub(crate) fn replace(&self, weights: &mut Weights) {
        let means = self.means.iter().map(|(name, mean)| (name.clone(), weight_from_tensor(mean)));
        weights.tensors.extend(means);
    }

    /// Takes the means out of `weights`, as [`Averages::store`] put them there after `steps` steps.
    ///
    /// # Errors
    /// The name of a tensor that is missing or has another shape.
    pub(crate) fn restore(&mut self, weights: &Weights, steps: u64) -> Result<(), String> {
        self.steps = steps;
        self.means.iter_mut().try_for_each(|(name, mean)| fill(mean, weights, &format!("{PREFIX}{name}")))
    }
}
