//! Figures of a model on several data sets: the JSON file that `farsight measure` writes and documents quote.

pub(crate) mod documents;
mod tables;

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use farsight_files::write_atomically;
use serde::{Deserialize, Serialize};

use crate::layout::laid_out;

/// What `farsight measure` writes. Data sets come in the order of the config.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Figures {
    pub(crate) sets: Vec<SetFigures>,
}

/// Figures on one data set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SetFigures {
    /// Name in the config.
    pub(crate) name: String,
    /// What tables call it.
    pub(crate) title: String,
    /// Images that were evaluated.
    pub(crate) frames: usize,
    pub(crate) source: Source,
    /// By the evaluator's name of the class; only classes with objects.
    pub(crate) classes: BTreeMap<String, ClassFigures>,
}

/// Where figures come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Source {
    /// The command that gives the same figures.
    pub(crate) command: String,
    /// Name and version of the program.
    pub(crate) program: String,
    pub(crate) engine: String,
    /// SHA-256 of the detector's weights.
    pub(crate) weights_sha256: String,
    /// Year, month and day, UTC.
    pub(crate) date: String,
}

/// Figures of one class. Distances are z; objects are those that count at Moderate; all scores from 0.05 unless a field
/// says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ClassFigures {
    pub(crate) all_scores: Errors,
    /// How often the truth lies within the error bars; none for a model without.
    pub(crate) error_bars: Option<ErrorBars>,
    /// By true z, as the evaluator names the bins, metres.
    pub(crate) by_distance: Vec<DistanceErrors>,
    /// With detections from a score on, lowest score first.
    pub(crate) operating: Vec<Operating>,
    /// Ranked by the scores of the detections.
    pub(crate) ap: AveragePrecision,
    /// Ranked by place scores; none for a model without error bars.
    #[serde(default)]
    pub(crate) ap_by_place: Option<AveragePrecision>,
    /// The same detections with the distances of geometric rangers, by the ranger's name.
    pub(crate) baselines: BTreeMap<String, Errors>,
}

/// Errors of distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Errors {
    pub(crate) objects: usize,
    pub(crate) found: usize,
    /// Mean absolute error, metres.
    pub(crate) mae_m: Option<f64>,
    /// Mean error, metres; positive when objects seem farther than they are.
    pub(crate) bias_m: Option<f64>,
    /// Mean of absolute error over true distance.
    pub(crate) relative: Option<f64>,
    /// Mean of the error over the true distance; positive when objects seem farther than they are.
    #[serde(default)]
    pub(crate) signed_relative: Option<f64>,
}

/// [`Errors`] in one range of distances.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DistanceErrors {
    /// Metres of true z, as in `10-20`.
    pub(crate) metres: String,
    pub(crate) errors: Errors,
    /// Share of those with an error bar whose true z lies within it.
    pub(crate) within_1_sigma: Option<f64>,
}

/// How often the truth lies within the error bars.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ErrorBars {
    pub(crate) count: usize,
    pub(crate) within_1_sigma: f64,
    pub(crate) within_2_sigma: f64,
    pub(crate) mean_sigma_m: f64,
    /// In the intervals that are said to hold 50, 68 and 90%: the share, and the ends of its 95% interval. Files of
    /// before do not have it.
    #[serde(default)]
    pub(crate) within_intervals: Option<[[f64; 3]; 3]>,
}

/// What is found with detections from one score on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Operating {
    pub(crate) score: f64,
    pub(crate) objects: usize,
    pub(crate) found: usize,
    pub(crate) false_alarms_per_frame: f64,
    pub(crate) mae_m: Option<f64>,
    /// Frames with objects of the class, whatever their difficulty.
    #[serde(default)]
    pub(crate) frames_with_objects: usize,
    /// Frames in which the nearest of them was not found.
    #[serde(default)]
    pub(crate) nearest_missed: usize,
    /// Median of absolute error over true distance.
    pub(crate) relative_median: Option<f64>,
}

/// Average precision over 40 recall points: easy, moderate, hard; percent. Strict overlaps are KITTI's (cars 0.7,
/// others 0.5), loose ones 0.5 and 0.25.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AveragePrecision {
    /// Objects that count at each difficulty.
    pub(crate) objects: [usize; 3],
    pub(crate) image: Option<[f64; 3]>,
    pub(crate) orientation: Option<[f64; 3]>,
    pub(crate) bev_strict: Option<[f64; 3]>,
    pub(crate) bev_loose: Option<[f64; 3]>,
    pub(crate) box3d_strict: Option<[f64; 3]>,
    pub(crate) box3d_loose: Option<[f64; 3]>,
}

impl Figures {
    /// The figures in the file at `path`.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = farsight_files::read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        serde_json::from_str(&text).with_context(|| format!("{}: not what `farsight measure` writes", path.display()))
    }

    /// Writes them to `path`, as a whole or not at all.
    pub(crate) fn write(&self, path: &Path) -> Result<()> {
        let text = laid_out(&serde_json::to_value(self)?, OPEN_LEVELS);
        Ok(write_atomically(path, |file| file.write_all(text.as_bytes()))?)
    }

    /// The figures on the data set `name`.
    pub(crate) fn set(&self, name: &str) -> Option<&SetFigures> {
        self.sets.iter().find(|set| set.name == name)
    }
}

/// Levels of the file that have a line for each of their values: file, data sets, data set, classes, class.
const OPEN_LEVELS: usize = 5;
