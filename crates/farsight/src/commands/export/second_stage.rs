//! `farsight export` of what is no detector: an ONNX file, or a model file that is fitted on labelled frames.

use std::path::Path;

use anyhow::{Result, bail};
use farsight::model_file::{SHIPPED_CAMERA, SHIPPED_PLATES, shipped_refiner};
use farsight::shipped;
use farsight_graph::model::{Model, NetworkConfig};
use farsight_graph::transform::Network;
use farsight_methods::camera_estimator::geometry::{INPUT_CHANNELS, INPUT_SIZE};
use farsight_methods::camera_estimator::{CameraEstimatorConfig, CameraEstimatorModel};
use farsight_methods::plate_reader::{self, PlateReaderConfig, PlateReaderModel};
use farsight_methods::refiner::{self, RefinerConfig, RefinerModel};
use farsight_methods::roi::runner;
use farsight_onnx::{Facts, OnnxModel, Target};
use farsight_runtime::probe;

use super::{ExportArgs, Outcome, answer, keep, reference_engine};
use crate::printer::Printer;

/// A model of a stage after the detector, or of what estimates cameras.
pub(super) enum SecondStageModel {
    Refiner(RefinerModel),
    PlateReader(PlateReaderModel),
    CameraEstimator(CameraEstimatorModel),
}

impl SecondStageModel {
    /// The model at `path`, or the shipped one by its word; none of anything else.
    pub(super) fn read(path: &Path) -> Result<Option<Self>> {
        Ok(if let Some(family) = shipped_refiner(path) {
            Some(Self::Refiner(shipped::refiner(family)?))
        } else if path == Path::new(SHIPPED_PLATES) {
            Some(Self::PlateReader(shipped::plates()?))
        } else if path == Path::new(SHIPPED_CAMERA) {
            Some(Self::CameraEstimator(shipped::camera_estimator()?))
        } else if RefinerModel::is_one(path) {
            Some(Self::Refiner(RefinerModel::read(path)?))
        } else if PlateReaderModel::is_one(path) {
            Some(Self::PlateReader(PlateReaderModel::read(path)?))
        } else if CameraEstimatorModel::is_one(path) {
            Some(Self::CameraEstimator(CameraEstimatorModel::read(path)?))
        } else {
            None
        })
    }

    /// Writes it in the form that is asked for.
    pub(super) fn export(self, args: &ExportArgs, target: Target, printer: &mut Printer) -> Result<Outcome> {
        if let Some(folder) = &args.cascade_on {
            let Self::Refiner(model) = self else { bail!("{}: --cascade-on is of refiners", args.model.display()) };
            return super::cascade::run(model, args, folder, printer);
        }
        match self {
            Self::Refiner(model) => match args.second_stage_data(RefinerConfig::NAME)? {
                Some(data) => super::refiner::run(model, args, data, printer),
                None => onnx(&model, refiner::geometry::INPUT_CHANNELS, [model.config.side; 2], target, args, printer),
            },
            Self::PlateReader(model) => match args.second_stage_data(PlateReaderConfig::NAME)? {
                Some(data) => super::plates::run(model, args, data, printer),
                None => {
                    onnx(&model, plate_reader::geometry::INPUT_CHANNELS, [model.config.side; 2], target, args, printer)
                }
            },
            Self::CameraEstimator(model) => match args.second_stage_data(CameraEstimatorConfig::NAME)? {
                Some(data) => super::camera::run(model, args, data, printer),
                None => onnx(&model, INPUT_CHANNELS, INPUT_SIZE, target, args, printer),
            },
        }
    }
}

/// Checks the ONNX form of `model` against its network before any transform, and writes it.
fn onnx<C: NetworkConfig>(
    model: &Model<C>,
    channels: usize,
    size: [usize; 2],
    target: Target,
    args: &ExportArgs,
    printer: &mut Printer,
) -> Result<Outcome> {
    let file = runner::onnx(model, target, &args.out)?;
    let input = probe::tensor(channels, size);
    let engine = reference_engine(&file);
    let source = Path::new("the untransformed network");
    let (whole, target) = (Network::new(model).with_outputs(C::OUTPUTS), engine.target());
    let whole = OnnxModel::from_network(&whole, &Facts::new(model, target), target, source)?;
    let (expected, reference) = answer(engine, whole, source, &input)?;
    keep(&file, &input, &expected, &reference, &args.out, printer)
}
