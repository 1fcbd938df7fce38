//! How long the arms of an experiment take for an image: the JSON file that documents and plots quote.

use std::path::Path;

use anyhow::{Context, Result};
use farsight_files::{read_text, write_atomically};
use serde::{Deserialize, Serialize};

use super::Experiment;
use crate::layout::{laid_out, table};

/// The times of all arms on several engines, measured in turns in one run.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Times {
    /// Width and height of the image, pixels.
    pub(crate) image: [usize; 2],
    /// Cores of the machine.
    pub(crate) cores: usize,
    /// Threads of the networks; none is the engine's own choice.
    pub(crate) threads: Option<usize>,
    pub(crate) arms: Vec<ArmTime>,
}

/// One arm on one engine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ArmTime {
    pub(crate) arm: String,
    pub(crate) engine: String,
    /// From the image file to the detections: the median of the rounds, and the least and the most of them,
    /// milliseconds.
    pub(crate) ms: f64,
    pub(crate) range_ms: [f64; 2],
    /// Objects that were found in the image; later networks of a method look at each of them.
    pub(crate) objects: usize,
    /// Whether the weights are those of a cell; else they are random.
    pub(crate) trained: bool,
}

impl Times {
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("{}: no times of an experiment", path.display()))
    }

    pub(crate) fn write(&self, path: &Path) -> Result<()> {
        let text = laid_out(&serde_json::to_value(self)?, 2);
        Ok(write_atomically(path, |file| file.write_all(text.as_bytes()))?)
    }

    /// Milliseconds of an arm on an engine.
    pub(crate) fn of(&self, arm: &str, engine: &str) -> Option<f64> {
        self.arms.iter().find(|time| time.arm == arm && time.engine == engine).map(|time| time.ms)
    }

    /// The engines, in the order in which they come.
    pub(crate) fn engines(&self) -> Vec<&str> {
        let mut engines: Vec<&str> = Vec::new();
        for time in &self.arms {
            if !engines.contains(&time.engine.as_str()) {
                engines.push(&time.engine);
            }
        }
        engines
    }

    /// A table with a row for each arm that has times, and a column for each engine.
    pub(crate) fn rows(&self, plan: &Experiment) -> Vec<String> {
        let engines = self.engines();
        let timed = plan.arms().into_iter().filter(|arm| self.arms.iter().any(|time| time.arm == *arm));
        let row = |arm: String| {
            let cell = |engine: &&str| self.of(&arm, engine).map_or_else(|| "-".to_owned(), |ms| format!("{ms:.1}"));
            let times = engines.iter().map(cell);
            std::iter::once(plan.title(&arm).to_owned()).chain(times).collect()
        };
        let heading: Vec<String> =
            std::iter::once("arm".to_owned()).chain(engines.iter().map(|engine| format!("{engine}, ms"))).collect();
        table(&heading, &timed.map(row).collect::<Vec<_>>())
    }
}
