//! What came out of an experiment: the JSON file that documents quote.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use farsight_files::{read_text, write_atomically};
use serde::{Deserialize, Serialize};

use super::Metric;
use crate::layout::laid_out;

/// All cells that are done, in the order of the plan, and what their comparison says so far.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Results {
    pub(crate) cells: Vec<CellResult>,
    /// What each arm gave over its seeds.
    #[serde(default)]
    pub(crate) arms: Vec<ArmResult>,
    pub(crate) comparisons: Vec<Comparison>,
}

/// What one arm gave with one seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct CellResult {
    pub(crate) arm: String,
    pub(crate) seed: u64,
    /// Steps of the training.
    pub(crate) steps: u64,
    /// Figures of cars; one that does not exist (the error of no car) is left out.
    #[serde(flatten)]
    pub(crate) metrics: BTreeMap<Metric, f64>,
}

/// One arm by one metric.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ArmResult {
    pub(crate) arm: String,
    pub(crate) metric: Metric,
    pub(crate) seeds: usize,
    /// Mean over the seeds.
    pub(crate) value: f64,
    /// 95%, over seeds and frames.
    pub(crate) interval: Option<[f64; 2]>,
}

/// One arm against another by one metric.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Comparison {
    pub(crate) arm: String,
    pub(crate) against: String,
    pub(crate) metric: Metric,
    /// Seeds that both arms have.
    pub(crate) seeds: usize,
    /// Mean over the seeds of `arm` minus `against`. Errors are of the cars that both found.
    pub(crate) difference: f64,
    /// 95%, over seeds and frames.
    pub(crate) interval: Option<[f64; 2]>,
    /// The paper's, in the same units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) claim: Option<f64>,
    pub(crate) verdict: Verdict,
    /// Whether an effect as large as claimed is ruled out: with `Supported`, it is smaller or larger.
    #[serde(default, skip_serializing_if = "is_false")]
    pub(crate) excludes_claim: bool,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands out references")]
fn is_false(value: &bool) -> bool {
    !value
}

/// What an interval says, corrected for the number of metrics in a comparison (Holm).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Verdict {
    /// Of a claim: there is an effect in its direction.
    Supported,
    /// Of a claim: its effect is ruled out and none in its direction is shown, or one in the other direction is.
    Refuted,
    /// Without a claim: there is an effect for the better.
    Better,
    /// Without a claim: there is one for the worse.
    Worse,
    /// Neither, or there are too few seeds.
    Undecided,
}

impl Verdict {
    /// Its word.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Supported => "supported",
            Self::Refuted => "refuted",
            Self::Better => "better",
            Self::Worse => "worse",
            Self::Undecided => "undecided",
        }
    }
}

/// Levels that have a line for each of their values: file, lists.
const OPEN_LEVELS: usize = 2;

impl Results {
    /// The results in the file at `path`.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        let shown = || format!("{}: not what `farsight experiment run` writes", path.display());
        serde_json::from_str(&text).with_context(shown)
    }

    /// Writes them to `path`, as a whole or not at all.
    pub(crate) fn write(&self, path: &Path) -> Result<()> {
        let text = laid_out(&serde_json::to_value(self)?, OPEN_LEVELS);
        Ok(write_atomically(path, |file| file.write_all(text.as_bytes()))?)
    }

    /// The values of a metric that an arm has, by seed.
    pub(crate) fn values(&self, arm: &str, metric: Metric) -> Vec<f64> {
        self.cells.iter().filter(|cell| cell.arm == arm).filter_map(|cell| cell.metrics.get(&metric).copied()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_comes_back_and_has_a_line_for_each_cell() {
        let cell = |seed| CellResult {
            arm: "smoke".to_owned(),
            seed,
            steps: 1856,
            metrics: BTreeMap::from([(Metric::Ap3d, 3.5), (Metric::Ap3d05, 21.0), (Metric::Mae, 1.5)]),
        };
        let comparison = Comparison {
            arm: "both".to_owned(),
            against: "smoke".to_owned(),
            metric: Metric::Mae,
            seeds: 2,
            difference: -0.1,
            interval: Some([-0.2, 0.0]),
            claim: Some(-0.2),
            verdict: Verdict::Undecided,
            excludes_claim: false,
        };
        let arm = ArmResult {
            arm: "smoke".to_owned(),
            metric: Metric::Mae,
            seeds: 2,
            value: 1.5,
            interval: Some([1.4, 1.6]),
        };
        let results = Results { cells: vec![cell(1), cell(2)], arms: vec![arm], comparisons: vec![comparison] };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.json");
        results.write(&path).unwrap();
        assert_eq!(Results::read(&path).unwrap(), results);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("\"ap3d_05\":21.0") && text.contains("\"verdict\":\"undecided\""), "{text}");
        assert_eq!(text.lines().filter(|line| line.contains("\"steps\"")).count(), 2);
    }
}
