//! Adam with L2 weight decay; its state is plain tensors, so a checkpoint can hold all of it.

use std::collections::BTreeMap;

use farsight_graph::weights::Weights;
use tch::{Tensor, no_grad};

use crate::executor::{Network, fill, weight_from_tensor};

/// Settings of the optimiser that do not change during a run.
#[derive(Debug, Clone, PartialEq)]
pub struct AdamSettings {
    /// Decay of the mean of gradients.
    pub beta1: f64,
    /// Decay of the mean of squared gradients.
    pub beta2: f64,
    /// Added to the root.
    pub epsilon: f64,
    /// Weight decay, added to the gradient (as `PyTorch`'s Adam).
    pub weight_decay: f64,
    /// Factor on the learning rate of biases (official SMOKE: 2).
    pub bias_rate_factor: f64,
    /// Factors on the learning rate of parameters whose names start so; of several the longest start counts.
    pub rate_factors: BTreeMap<String, f64>,
}

impl AdamSettings {
    /// Adam's usual numbers.
    pub fn new(weight_decay: f64, bias_rate_factor: f64) -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8, weight_decay, bias_rate_factor, rate_factors: BTreeMap::new() }
    }

    /// The factor on the learning rate of the parameter called `name`.
    fn rate_factor(&self, name: &str) -> f64 {
        let named = self.rate_factors.iter().filter(|(prefix, _)| name.starts_with(prefix.as_str()));
        let of_part = named.max_by_key(|(prefix, _)| prefix.len()).map_or(1.0, |(_, factor)| *factor);
        if name.contains("bias") { of_part * self.bias_rate_factor } else { of_part }
    }
}

/// A gradient that is not finite.
#[derive(Debug, Clone, PartialEq)]
pub struct BadGradient {
    /// The first parameter that has one.
    pub parameter: String,
    /// The norm of its gradient.
    pub norm: f64,
}

impl BadGradient {
    /// What it is that is not finite.
    pub fn what(&self) -> String {
        format!("the norm of the gradient of {}", self.parameter)
    }
}

/// Running means of one parameter.
#[derive(Debug)]
struct Moments {
    name: String,
    mean: Tensor,
    square: Tensor,
    /// Factor on the learning rate.
    rate_factor: f64,
}

/// The optimiser with its state.
#[derive(Debug)]
pub struct Adam {
    settings: AdamSettings,
    moments: Vec<Moments>,
    steps: u64,
}

/// Prefixes of the running means in a checkpoint.
const MEAN_PREFIX: &str = "adam.mean.";
const SQUARE_PREFIX: &str = "adam.square.";

impl Adam {
    /// A fresh optimiser for these parameters.
    pub fn new<'a>(settings: AdamSettings, parameters: impl Iterator<Item = (&'a str, &'a Tensor)>) -> Self {
        let moments = parameters.map(|(name, tensor)| Moments {
            name: name.to_owned(),
            mean: tensor.zeros_like().set_requires_grad(false),
            square: tensor.zeros_like().set_requires_grad(false),
            rate_factor: settings.rate_factor(name),
        });
        let moments = moments.collect();
        Self { settings, moments, steps: 0 }
    }

    /// Moves `parameters` against `gradients`, both in the order given to [`Adam::new`].
    pub fn step(&mut self, parameters: &[Tensor], gradients: &[Tensor], rate: f64) {
        let AdamSettings { beta1, beta2, epsilon, weight_decay, .. } = self.settings;
        self.steps += 1;
        let steps = self.steps as f64;
        let mean_correction = 1.0 - beta1.powf(steps);
        let square_correction = (1.0 - beta2.powf(steps)).sqrt();
        no_grad(|| {
            for ((parameter, gradient), moments) in parameters.iter().zip(gradients).zip(&mut self.moments) {
                let gradient =
                    if weight_decay == 0.0 { gradient.shallow_clone() } else { gradient + parameter * weight_decay };
                let _ = moments.mean.lerp_(&gradient, 1.0 - beta1);
                let _ = moments.square.lerp_(&gradient.square(), 1.0 - beta2);
                let rate = rate * moments.rate_factor;
                let root = moments.square.sqrt().g_mul_scalar_(1.0 / square_correction).g_add_scalar_(epsilon);
                let update = (&moments.mean / root).g_mul_scalar_(rate / mean_correction);
                let _ = parameter.shallow_clone().g_sub_(&update);
            }
        });
    }

    /// Moves the parameters of `network` against the gradient of `objective`, cut to the norm `clip_norm` (0: as it
    /// is). Returns the norm before that.
    ///
    /// # Errors
    /// When the norm is not finite; nothing is moved then.
    pub fn descend(
        &mut self,
        network: &Network,
        objective: &Tensor,
        clip_norm: f64,
        rate: f64,
    ) -> Result<f64, BadGradient> {
        let parameters: Vec<Tensor> =
            network.trainable_parameters().map(|(_, tensor)| tensor.shallow_clone()).collect();
        let mut gradients = Tensor::run_backward(&[objective], &parameters, false, false);
        let norms: Vec<Tensor> = gradients.iter().map(Tensor::norm).collect();
        let norm = Tensor::stack(&norms, 0).norm().double_value(&[]);
        if !norm.is_finite() {
            let named =
                network.trainable_parameters().zip(&norms).map(|((name, _), norm)| (name, norm.double_value(&[])));
            let first = named.into_iter().find(|(_, norm)| !norm.is_finite());
            let (parameter, norm) = first.unwrap_or(("all parameters", norm));
            return Err(BadGradient { parameter: parameter.to_owned(), norm });
        }
        if clip_norm > 0.0 && norm > clip_norm {
            for gradient in &mut gradients {
                let _ = gradient.g_mul_scalar_(clip_norm / norm);
            }
        }
        self.step(&parameters, &gradients, rate);
        Ok(norm)
    }

    /// Counts a step without a gradient.
    pub fn rest(&mut self) {
        self.steps += 1;
    }

    /// Adds the state to `weights`, beside the parameters.
    pub fn store(&self, weights: &mut Weights) {
        for moments in &self.moments {
            weights.tensors.insert(format!("{MEAN_PREFIX}{}", moments.name), weight_from_tensor(&moments.mean));
            weights.tensors.insert(format!("{SQUARE_PREFIX}{}", moments.name), weight_from_tensor(&moments.square));
        }
    }

    /// Takes the state out of `weights`, as [`Adam::store`] put it there after `steps` steps.
    ///
    /// # Errors
    /// The name of a tensor that is missing or has another shape.
    pub fn restore(&mut self, weights: &Weights, steps: u64) -> Result<(), String> {
        self.steps = steps;
        for moments in &mut self.moments {
            for (prefix, place) in [(MEAN_PREFIX, &mut moments.mean), (SQUARE_PREFIX, &mut moments.square)] {
                fill(place, weights, &format!("{prefix}{}", moments.name))?;
            }
        }
        Ok(())
    }
}
