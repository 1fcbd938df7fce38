//! What 8 bits do to distances and AP on labelled frames.

use std::path::Path;

use anyhow::{Context, Result};
use farsight_core::detection::DecodeOptions;
use farsight_data::KittiDataset;
use farsight_eval::ap::{Metric, OverlapSet};
use farsight_eval::ranging::{Figure, Group, RangingOptions};
use farsight_eval::{Difficulty, EvaluatedClass, FrameFiles, Report};
use farsight_net::onnx::OnnxModel;
use serde_json::{Map, Value, json};

use super::super::ExportArgs;
use crate::commands::eval::{MIN_SCORE, write_results_of};
use crate::engines::detector_of;
use crate::printer::Printer;

/// Figures of Moderate cars, by the network in float and by it in 8 bits.
pub(super) struct Metres {
    frames: usize,
    engine: String,
    float: Vec<Option<f64>>,
    int8: Vec<Option<f64>>,
}

/// Keys in the metadata and names on the screen; AP over 40 points of recall.
const FIGURES: [(&str, &str); 7] = [
    ("objects", "objects"),
    ("found", "found"),
    ("mae_z", "MAE of z, m"),
    ("rmse_z", "RMSE of z, m"),
    ("ap_3d", "AP 3D"),
    ("ap_bev", "AP BEV"),
    ("ap_loose_3d", "AP 3D at 0.5"),
];

impl Metres {
    /// Runs both networks over the frames of `data`.
    pub(super) fn measure(
        float: &OnnxModel,
        int8: &OnnxModel,
        data: &Path,
        args: &ExportArgs,
        printer: &mut Printer,
    ) -> Result<Self> {
        let dataset = KittiDataset::open(data, args.int8.split.as_deref())?;
        let judged = |model: &OnnxModel| -> Result<_> {
            let folder = tempfile::tempdir().context("no folder for the results")?;
            let options = DecodeOptions { min_score: MIN_SCORE, ..DecodeOptions::default() };
            let mut detector = detector_of(&args.int8.engine, model.clone(), &args.model, options)?;
            write_results_of(&mut detector, &dataset, folder.path())?;
            let files = FrameFiles::open(&dataset.label_folder(), folder.path(), Some(dataset.ids().to_vec()))?;
            let options = RangingOptions { bootstrap: None, ..RangingOptions::default() };
            Ok((moderate_cars(&files.evaluate(&options)?.0.report()), detector.engine_name().to_owned()))
        };
        let (float, engine) = judged(float)?;
        let (int8, _) = judged(int8)?;
        printer.status(&format!("{} frames looked at twice by {engine}", dataset.len()));
        Ok(Self { frames: dataset.len(), engine, float, int8 })
    }

    /// A table.
    pub(super) fn lines(&self) -> Vec<String> {
        let row = |name: &str, cells: [String; 3]| {
            let [float, int8, difference] = cells;
            format!("{name:<20}{float:>12}{int8:>12}{difference:>12}")
        };
        let shown = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.3}"));
        let heading = row("Moderate cars", ["float", "8 bits", "difference"].map(str::to_owned));
        let rows = FIGURES.iter().zip(self.float.iter().zip(&self.int8)).map(|((_, name), (float, int8))| {
            let difference = float.zip(*int8).map(|(float, int8)| int8 - float);
            row(name, [*float, *int8, difference].map(shown))
        });
        [heading].into_iter().chain(rows).collect()
    }

    /// For the file's metadata.
    pub(super) fn to_json(&self) -> Value {
        let named = |values: &[Option<f64>]| -> Map<String, Value> {
            FIGURES.iter().zip(values).map(|((key, _), value)| ((*key).to_owned(), json!(value))).collect()
        };
        json!({"frames": self.frames, "engine": self.engine, "float": named(&self.float), "int8": named(&self.int8)})
    }
}

/// In the order of [`FIGURES`].
fn moderate_cars(report: &Report) -> Vec<Option<f64>> {
    let car = EvaluatedClass::Car;
    let whole = report.ranging.group(car, Group::Level(Difficulty::Moderate)).map(|group| &group.whole);
    let figure = |figure| whole.and_then(|whole| whole.figures.get(figure));
    let ap = |set, metric| report.ap.ap(set, metric, car).map(|ap| ap.r40[Difficulty::Moderate as usize]);
    vec![
        whole.map(|whole| whole.objects as f64),
        whole.map(|whole| whole.found as f64),
        figure(Figure::MaeZ),
        figure(Figure::RmseZ),
        ap(OverlapSet::Strict, Metric::Space),
        ap(OverlapSet::Strict, Metric::Bev),
        ap(OverlapSet::Loose, Metric::Space),
    ]
}
