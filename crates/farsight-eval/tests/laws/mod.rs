//! What must hold for any bytes in a file: nothing panics, and the readers agree. The fuzz targets and the replay of
//! their saved inputs share these.
#![allow(dead_code, unreachable_pub)] // Each user takes a part.
#![allow(clippy::expect_used)] // A broken law is a finding.

use std::path::Path;

use farsight_data::kitti::rows::{rows_from_text, rows_from_text_lenient};
use farsight_data::kitti::{Calibration, DevkitRow, RowKind, rows_as_devkit};
use farsight_eval::ap::{Metric, OverlapSet};
use farsight_eval::explain::{ExplainOptions, explain};
use farsight_eval::ranging::RangingOptions;
use farsight_eval::{Bootstrap, Evaluation, Frame, Prediction};

const LABELS: &str = "\
Car 0.00 0 1.55 608.40 182.50 719.60 281.90 1.52 1.66 4.07 0.80 1.71 13.60 1.62
Van 0.10 1 1.55 400.00 150.00 500.00 250.00 2.10 1.90 5.00 -3.00 1.75 15.00 0.10
DontCare -1 -1 -10 498.20 171.30 585.40 189.60 -1 -1 -1 -1000 -1000 -1000 -10
";

const RESULTS: &str = "\
Car -1 -1 1.5500 614.0000 181.0000 727.0000 284.0000 1.5700 1.7300 4.1500 1.0000 1.7500 13.3000 1.6200 0.9000
Pedestrian -1 -1 0.1000 10.0000 20.0000 30.0000 44.0000 1.7000 0.6000 0.8000 -9.0000 1.7000 20.0000 0.3000 0.5000 1.2000
";

/// Any bytes as a label file.
pub fn labels(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let rows = readers_agree(&text, RowKind::Label);
    evaluate(rows, rows_as_devkit(RESULTS, RowKind::Result).rows);
}

/// Any bytes as a result file.
pub fn results(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let rows = readers_agree(&text, RowKind::Result);
    evaluate(rows_as_devkit(LABELS, RowKind::Label).rows, rows);
}

/// Any bytes as a calibration file; what is accepted survives being written and read again.
pub fn calibration(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let Ok(calibration) = Calibration::from_text(&text, Path::new("input")) else { return };
    let written = calibration.to_text();
    let again = Calibration::from_text(&written, Path::new("written")).expect("a written calibration can be read");
    assert_eq!(again.to_text(), written);
}

/// What the strict reader accepts, the devkit's reading and the lenient one see the same way.
fn readers_agree(text: &str, kind: RowKind) -> Vec<DevkitRow> {
    let path = Path::new("input");
    let devkit = rows_as_devkit(text, kind);
    let (lenient, skipped) = rows_from_text_lenient(text, path, kind);
    if let Ok(strict) = rows_from_text(text, path, kind) {
        assert_eq!(skipped.count, 0);
        assert_eq!(strict, lenient);
        assert!(devkit.rows.iter().map(|read| &read.row).eq(&strict));
        assert!(devkit.diagnostics.iter().all(|(_, diagnostic)| !diagnostic.is_fatal()));
    }
    devkit.rows
}

fn evaluate(labels: Vec<DevkitRow>, predictions: Vec<DevkitRow>) {
    let frame = Frame {
        id: String::new(),
        labels: labels.into_iter().map(|read| read.row.label).collect(),
        predictions: predictions.into_iter().map(Prediction::from).collect(),
    };
    let bootstrap = Some(Bootstrap { resamples: 2, seed: 0 });
    let mut evaluation = Evaluation::new(RangingOptions { bootstrap, ..RangingOptions::default() });
    evaluation.add(&frame);
    let report = evaluation.report();
    drop(farsight_eval::text::lines(&report));
    for metric in Metric::ALL {
        let told = explain(&frame, &ExplainOptions { metric, overlaps: OverlapSet::Strict, min_score: None });
        assert_eq!((told.objects.len(), told.predictions.len()), (frame.labels.len(), frame.predictions.len()));
    }
}
