//! KITTI's evaluation of result files.

use std::collections::BTreeMap;
use std::path::PathBuf;

use farsight_data::kitti::write_results as write_rows;
use farsight_eval::ranging::RangingOptions;
use farsight_eval::{Bootstrap, Findings, FrameFiles, Report, Scores};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use serde::Serialize;

use crate::picture::{detection, parsed};

/// What `farsight eval --json` writes.
#[derive(Serialize)]
struct Answer<'a> {
    #[serde(flatten)]
    report: BTreeMap<String, serde_json::Value>,
    scores: Scores,
    findings: &'a Findings,
}

/// Judges a folder of result files against a folder of label files; the report as JSON.
#[pyfunction]
pub(crate) fn evaluate(
    py: Python<'_>,
    labels: PathBuf,
    results: PathBuf,
    resamples: usize,
    seed: u64,
) -> PyResult<String> {
    let bootstrap = (resamples > 0).then_some(Bootstrap { resamples, seed });
    let options = RangingOptions { bootstrap, ..RangingOptions::default() };
    py.detach(|| {
        let evaluated = FrameFiles::open(&labels, &results, None).and_then(|files| files.evaluate(&options));
        let (evaluation, findings) = evaluated.map_err(|error| PyValueError::new_err(error.to_string()))?;
        text(&evaluation.report(), &findings).map_err(|error| PyValueError::new_err(error.to_string()))
    })
}

fn text(report: &Report, findings: &Findings) -> serde_json::Result<String> {
    let report = serde_json::from_value(serde_json::to_value(report)?)?;
    serde_json::to_string(&Answer { report, scores: Scores::AsGiven, findings })
}

/// Writes the detections of an answer as KITTI rows.
#[pyfunction]
pub(crate) fn write_results(path: PathBuf, record: &str) -> PyResult<()> {
    let detections: Vec<_> = parsed(record)?.detections.iter().map(detection).collect();
    write_rows(&path, &detections).map_err(|error| PyOSError::new_err(error.to_string()))
}
