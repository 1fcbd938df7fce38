//! Adam with L2 weight decay; its state is plain tensors, so a checkpoint can hold all of it.

use std::collections::BTreeMap;

use farsight_graph::weights::Weights;
use tch::{Device, Kind, Tensor, no_grad};

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

/// Where one parameter's numbers lie in the running means.
#[derive(Debug)]
struct Place {
    name: String,
    shape: Vec<i64>,
    start: i64,
    count: i64,
}

impl Place {
    /// Its numbers of the running means `flat`, in its shape.
    fn of(&self, flat: &Tensor) -> Tensor {
        flat.narrow(0, self.start, self.count).view(self.shape.as_slice())
    }
}

/// The optimiser with its state.
///
/// The running means of all parameters lie one behind the other in one tensor: a step is a dozen operations on that,
/// not on each of the hundreds of parameters, which a GPU would spend its time on being told of.
#[derive(Debug)]
pub struct Adam {
    settings: AdamSettings,
    places: Vec<Place>,
    mean: Tensor,
    square: Tensor,
    /// Factors on the learning rate; none where all are 1.
    rate_factors: Option<Tensor>,
    steps: u64,
}

/// Prefixes of the running means in a checkpoint.
const MEAN_PREFIX: &str = "adam.mean.";
const SQUARE_PREFIX: &str = "adam.square.";

impl Adam {
    /// A fresh optimiser for these parameters, which are of one kind and on one device.
    pub fn new<'a>(settings: AdamSettings, parameters: impl Iterator<Item = (&'a str, &'a Tensor)>) -> Self {
        let (mut places, mut factors, mut start) = (Vec::new(), Vec::new(), 0);
        let mut options = (Kind::Float, Device::Cpu);
        for (name, tensor) in parameters {
            let count = tensor.numel() as i64;
            factors.extend(vec![settings.rate_factor(name); count as usize]);
            places.push(Place { name: name.to_owned(), shape: tensor.size(), start, count });
            start += count;
            options = (tensor.kind(), tensor.device());
        }
        let rate_factors = factors.iter().any(|factor| (factor - 1.0).abs() > 0.0);
        let rate_factors = rate_factors.then(|| Tensor::from_slice(&factors).to_kind(options.0).to_device(options.1));
        let [mean, square] = [(); 2].map(|()| Tensor::zeros([start], options));
        Self { settings, places, mean, square, rate_factors, steps: 0 }
    }

    /// Moves `parameters` against `gradients`, both in the order given to [`Adam::new`].
    pub fn step(&mut self, parameters: &[Tensor], gradients: &[Tensor], rate: f64) {
        self.step_flat(parameters, &flat(gradients), rate);
    }

    /// As [`Adam::step`], with the gradients one behind the other.
    fn step_flat(&mut self, parameters: &[Tensor], gradient: &Tensor, rate: f64) {
        let AdamSettings { beta1, beta2, epsilon, weight_decay, .. } = self.settings;
        self.steps += 1;
        let steps = self.steps as f64;
        let mean_correction = 1.0 - beta1.powf(steps);
        let square_correction = (1.0 - beta2.powf(steps)).sqrt();
        no_grad(|| {
            let gradient =
                if weight_decay == 0.0 { gradient.shallow_clone() } else { gradient + flat(parameters) * weight_decay };
            let _ = self.mean.lerp_(&gradient, 1.0 - beta1);
            let _ = self.square.lerp_(&gradient.square(), 1.0 - beta2);
            let root = self.square.sqrt().g_mul_scalar_(1.0 / square_correction).g_add_scalar_(epsilon);
            let mut update = (&self.mean / root).g_mul_scalar_(rate / mean_correction);
            if let Some(factors) = &self.rate_factors {
                let _ = update.g_mul_(factors);
            }
            for (parameter, place) in parameters.iter().zip(&self.places) {
                let _ = parameter.shallow_clone().g_sub_(&place.of(&update));
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
        let gradients = Tensor::run_backward(&[objective], &parameters, false, false);
        let mut gradient = no_grad(|| flat(&gradients));
        let norm = gradient.norm().double_value(&[]);
        if !norm.is_finite() {
            let norms = gradients.iter().map(|gradient| gradient.norm().double_value(&[]));
            let mut named = network.trainable_parameters().map(|(name, _)| name).zip(norms);
            let first = named.find(|(_, norm)| !norm.is_finite());
            let (parameter, norm) = first.unwrap_or(("all parameters", norm));
            return Err(BadGradient { parameter: parameter.to_owned(), norm });
        }
        if clip_norm > 0.0 && norm > clip_norm {
            let _ = gradient.g_mul_scalar_(clip_norm / norm);
        }
        self.step_flat(&parameters, &gradient, rate);
        Ok(norm)
    }

    /// Counts a step without a gradient.
    pub fn rest(&mut self) {
        self.steps += 1;
    }

    /// Adds the state to `weights`, beside the parameters.
    pub fn store(&self, weights: &mut Weights) {
        for (prefix, flat) in [(MEAN_PREFIX, &self.mean), (SQUARE_PREFIX, &self.square)] {
            let named = |place: &Place| (format!("{prefix}{}", place.name), weight_from_tensor(&place.of(flat)));
            weights.tensors.extend(self.places.iter().map(named));
        }
    }

    /// Takes the state out of `weights`, as [`Adam::store`] put it there after `steps` steps.
    ///
    /// # Errors
    /// The name of a tensor that is missing or has another shape.
    pub fn restore(&mut self, weights: &Weights, steps: u64) -> Result<(), String> {
        self.steps = steps;
        for place in &self.places {
            for (prefix, flat) in [(MEAN_PREFIX, &self.mean), (SQUARE_PREFIX, &self.square)] {
                fill(&mut place.of(flat), weights, &format!("{prefix}{}", place.name))?;
            }
        }
        Ok(())
    }
}

/// The numbers of all these tensors, one behind the other, each tensor's last axis fastest.
fn flat(tensors: &[Tensor]) -> Tensor {
    Tensor::cat(&tensors.iter().map(|tensor| tensor.reshape([-1])).collect::<Vec<_>>(), 0)
}
