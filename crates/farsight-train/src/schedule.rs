//! The learning rate over a run.

use serde::{Deserialize, Serialize};

/// How the learning rate changes; progress counts optimiser steps.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Schedule {
    /// From the initial rate down to zero along half a cosine (the paper).
    #[default]
    Cosine,
    /// The initial rate, divided by ten at each of these shares of the run (official SMOKE: 0.4 and 0.72).
    Steps {
        /// Shares of the run, 0 to 1.
        at: Vec<f64>,
    },
    /// Always the initial rate.
    Constant,
}

impl Schedule {
    /// Factor on the initial rate for step `step` of `steps`, after `warm_up` steps of linear rise.
    pub fn factor(&self, step: u64, steps: u64, warm_up: u64) -> f64 {
        if step < warm_up {
            return (step + 1) as f64 / warm_up as f64;
        }
        let progress = (step - warm_up) as f64 / (steps.saturating_sub(warm_up)).max(1) as f64;
        match self {
            Self::Cosine => 0.5 * (1.0 + (std::f64::consts::PI * progress.min(1.0)).cos()),
            Self::Steps { at } => 0.1_f64.powi(at.iter().filter(|&&share| progress >= share).count() as i32),
            Self::Constant => 1.0,
        }
    }
}
