//! What must hold for any bytes in a file: nothing panics, and the readers agree. The fuzz targets and the replay of
//! their saved inputs share these.
#![allow(dead_code, unreachable_pub)] // Each user takes a part.
#![allow(clippy::expect_used)] // A broken law is a finding.

use std::path::Path;

use farsight_data::kitti::rows::{rows_from_text, rows_from_text_lenient};
use farsight_data::kitti::{Calibration, DevkitRow, Row, RowKind, rows_as_devkit, text_from_labels, text_from_results};
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

/// What errors call an input.
const NAME: &str = "input";

/// Any bytes as a label file; what is accepted says the same when it is written and read again, as exactly as files
/// say it.
pub fn labels(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let (rows, accepted) = readers_agree(&text, RowKind::Label);
    if accepted.is_some() {
        let written = |rows: &[DevkitRow]| {
            let labels: Vec<_> = rows.iter().map(|read| read.row.label.clone()).collect();
            text_from_labels(&labels)
        };
        let again = rows_as_devkit(&written(&rows), RowKind::Label).rows;
        assert_eq!(again.len(), rows.len());
        // Numbers are rounded once.
        let text = written(&again);
        assert_eq!(written(&rows_as_devkit(&text, RowKind::Label).rows), text);
    }
    evaluate(rows, rows_as_devkit(RESULTS, RowKind::Result).rows);
    accepted.is_some()
}

/// Any bytes as a result file; as [`labels`].
pub fn results(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let (rows, accepted) = readers_agree(&text, RowKind::Result);
    if accepted.is_some() {
        let written = |rows: &[DevkitRow]| {
            let found: Vec<_> = rows.iter().cloned().map(|row| Prediction::from(row).detection).collect();
            text_from_results(&found)
        };
        let again = rows_as_devkit(&written(&rows), RowKind::Result).rows;
        assert_eq!(again.len(), rows.len());
        // Numbers are rounded once, and the observation angle follows from them.
        let text = written(&again);
        assert_eq!(written(&rows_as_devkit(&text, RowKind::Result).rows), text);
    }
    evaluate(rows_as_devkit(LABELS, RowKind::Label).rows, rows);
    accepted.is_some()
}

/// Any bytes as a calibration file; what is accepted survives being written and read again.
pub fn calibration(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let calibration = match Calibration::from_text(&text, Path::new(NAME)) {
        Ok(calibration) => calibration,
        Err(error) => {
            assert!(error.to_string().starts_with(NAME), "no file in: {error}");
            return false;
        }
    };
    let written = calibration.to_text();
    let again = Calibration::from_text(&written, Path::new("written")).expect("a written calibration can be read");
    assert_eq!(again.to_text(), written);
    true
}

/// What the strict reader accepts, the devkit's reading and the lenient one see the same way: the devkit's rows, and
/// those of the strict reader if it accepts the text.
fn readers_agree(text: &str, kind: RowKind) -> (Vec<DevkitRow>, Option<Vec<Row>>) {
    let path = Path::new(NAME);
    let devkit = rows_as_devkit(text, kind);
    let (lenient, skipped) = rows_from_text_lenient(text, path, kind);
    let accepted = match rows_from_text(text, path, kind) {
        Ok(strict) => {
            assert_eq!(skipped.count, 0);
            assert_eq!(strict, lenient);
            assert!(devkit.rows.iter().map(|read| &read.row).eq(&strict));
            assert!(devkit.diagnostics.iter().all(|(_, diagnostic)| !diagnostic.is_fatal()));
            Some(strict)
        }
        Err(error) => {
            assert!(error.to_string().starts_with(NAME), "no file in: {error}");
            None
        }
    };
    (devkit.rows, accepted)
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
