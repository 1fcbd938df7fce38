//! What 8 bits do to distances and AP on labelled frames.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use farsight::{ModelSource, Pipeline, Road, StageSource};
use farsight_data::open_labelled;
use farsight_eval::ap::{Metric, OverlapSet};
use farsight_eval::ranging::{Difference, Group, RangingComparison, RangingMetric, RangingOptions};
use farsight_eval::{Bootstrap, Difficulty, EvaluatedClass, Evaluation, FrameFiles, Report};
use farsight_files::Scratch;
use farsight_methods::smoke::DetectorFile;
use serde_json::{Map, Value, json};

use super::super::ExportArgs;
use crate::commands::eval::{MIN_SCORE, write_results_of};
use crate::pipeline_args;
use crate::printer::{Printer, counted};

/// Figures of Moderate cars, by the network in float and by it in 8 bits.
pub(super) struct Metres {
    frames: usize,
    engine: String,
    objects: usize,
    found_by_both: usize,
    /// In the order of [`FIGURES`].
    float: Vec<Option<f64>>,
    int8: Vec<Option<f64>>,
    /// 95% interval of the difference of the MAE, metres.
    interval: Option<[f64; 2]>,
}

/// Keys in the metadata and names on the screen. Distances are compared on the objects that both found, AP is over 40
/// points of recall.
const FIGURES: [(&str, &str); 6] = [
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
        float: &DetectorFile,
        int8: &DetectorFile,
        data: &Path,
        args: &ExportArgs,
        printer: &mut Printer,
    ) -> Result<Self> {
        let dataset = open_labelled(data, args.int8.split.as_deref())?;
        let mut judged = |file: &DetectorFile| -> Result<_> {
            let folder = Scratch::temporary_folder().context("no folder for the results")?;
            let source =
                ModelSource::Memory { onnx: Box::new(file.onnx.clone()), later: Vec::new(), name: args.model.clone() };
            let builder = Pipeline::builder().model(source).engine_options(args.int8.engine.options()?);
            // The network alone.
            let builder = builder.refiner(StageSource::Off).plates(StageSource::Off).road(Road::Ignored);
            let pipeline = pipeline_args::open(&builder.min_score(MIN_SCORE).images(dataset.len()))?;
            let done = write_results_of(&pipeline, &*dataset, 0..dataset.len(), folder.path(), printer)?;
            ensure!(done.len() == dataset.len(), "{}: not all frames could be looked at", data.display());
            let files = FrameFiles::open(&dataset, folder.path(), Some(dataset.ids()))?;
            let options = RangingOptions { bootstrap: None, ..RangingOptions::default() };
            Ok((files.evaluate(&options)?.0, pipeline.engine().to_owned()))
        };
        let (float, engine) = judged(float)?;
        let (int8, _) = judged(int8)?;
        printer.status(&format!("{} looked at twice by {engine}", counted(dataset.len(), "frame")));
        let paired = RangingComparison::new(int8.targets(), float.targets(), dataset.len(), &Bootstrap::default())
            .with_context(|| format!("{}: the labels changed while they were read", data.display()))?;
        let row = paired.rows.iter().find(|row| {
            row.class == EvaluatedClass::Car
                && row.group == Group::Level(Difficulty::Moderate).name()
                && row.distance == "all"
        });
        let row = row.with_context(|| format!("{}: no car in the labels of these frames", data.display()))?;
        let difference = |figure| row.metrics.get(figure);
        let side = |evaluation: &Evaluation, of: fn(&Difference) -> f64| {
            let report = evaluation.report();
            let mut figures = vec![found(&report)];
            figures
                .extend([RangingMetric::MaeZ, RangingMetric::RmseZ].map(|figure| difference(figure).as_ref().map(of)));
            figures.extend(average_precisions(&report));
            figures
        };
        Ok(Self {
            frames: dataset.len(),
            engine,
            objects: row.objects,
            found_by_both: row.found_by_both,
            float: side(&float, |difference| difference.against),
            int8: side(&int8, |difference| difference.value),
            interval: difference(RangingMetric::MaeZ).and_then(|difference| difference.interval).map(Into::into),
        })
    }

    /// A table.
    pub(super) fn lines(&self) -> Vec<String> {
        let row = |name: &str, cells: [String; 3]| {
            let [float, int8, difference] = cells;
            format!("{name:<20}{float:>12}{int8:>12}{difference:>12}")
        };
        let shown = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.3}"));
        let heading = row("Moderate cars", ["float", "8 bits", "difference"].map(str::to_owned));
        let interval = self.interval.map_or_else(String::new, |[low, high]| {
            format!("; 95% interval of the difference of the MAE {low:.3} to {high:.3} m")
        });
        let note = format!("{} cars, distances of the {} that both found{interval}", self.objects, self.found_by_both);
        let rows = FIGURES.iter().zip(self.float.iter().zip(&self.int8)).map(|((_, name), (float, int8))| {
            let difference = float.zip(*int8).map(|(float, int8)| int8 - float);
            row(name, [*float, *int8, difference].map(shown))
        });
        [heading].into_iter().chain(rows).chain([note]).collect()
    }

    /// For the file's metadata.
    pub(super) fn to_json(&self) -> Value {
        let named = |values: &[Option<f64>]| -> Map<String, Value> {
            FIGURES.iter().zip(values).map(|((key, _), value)| ((*key).to_owned(), json!(value))).collect()
        };
        json!({
            "frames": self.frames, "engine": self.engine, "objects": self.objects, "found_by_both": self.found_by_both,
            "float": named(&self.float), "int8": named(&self.int8), "mae_z_difference_95": self.interval,
        })
    }
}

/// How many Moderate cars were found.
fn found(report: &Report) -> Option<f64> {
    let group = report.ranging.group(EvaluatedClass::Car, Group::Level(Difficulty::Moderate))?;
    Some(group.whole.found as f64)
}

/// AP of Moderate cars: 3D, BEV, 3D with the loose overlap.
fn average_precisions(report: &Report) -> [Option<f64>; 3] {
    let sets =
        [(OverlapSet::Strict, Metric::Box3d), (OverlapSet::Strict, Metric::Bev), (OverlapSet::Loose, Metric::Box3d)];
    sets.map(|(set, metric)| {
        report.ap.ap(set, metric, EvaluatedClass::Car).map(|ap| ap.r40[Difficulty::Moderate as usize])
    })
}
