//! Opening what runs beside the detector: refiner, plate reader, camera estimator.

use std::path::Path;

use farsight_graph::model::{Model, ModelError, NetworkConfig};
use farsight_methods::camera_estimator::{CameraEstimator, CameraEstimatorModel};
use farsight_methods::plate_reader::{PlateReader, PlateReaderModel};
use farsight_methods::refiner::{Refiner, RefinerModel};
use farsight_onnx::OnnxModel;

use crate::source::StageSource;
use crate::{EngineOptions, Error, model_file};

/// The model of a second stage, if there is to be one: `shipped` where that is the default.
pub(crate) fn model<C: NetworkConfig>(
    source: &StageSource,
    is_default: bool,
    shipped: impl FnOnce() -> Result<Model<C>, ModelError>,
) -> Result<Option<Model<C>>, Error> {
    match source {
        StageSource::Default if is_default => Ok(Some(shipped()?)),
        StageSource::Default | StageSource::Off => Ok(None),
        StageSource::Shipped => Ok(Some(shipped()?)),
        StageSource::File(path) => read(path).map(Some),
    }
}

fn read<C: NetworkConfig>(path: &Path) -> Result<Model<C>, Error> {
    model_file::check(path, &format!("{} that `farsight train` wrote, or none", C::NAME))?;
    Model::read(path).map_err(|error| match OnnxModel::read(path) {
        Ok(_) => {
            model_file::kind_error(path, "an ONNX file", format!("{} (.safetensors) that it was made from", C::NAME))
        }
        Err(_) => error.into(),
    })
}

/// A refiner on `engine`.
///
/// # Errors
/// When the engine cannot run it.
pub fn refiner(model: &RefinerModel, engine: &EngineOptions) -> Result<Refiner, Error> {
    Ok(Refiner::new(engine.start_second_stage(model)?, model.config.clone()))
}

/// A plate reader on `engine`.
///
/// # Errors
/// When the engine cannot run it.
pub fn plate_reader(model: &PlateReaderModel, engine: &EngineOptions) -> Result<PlateReader, Error> {
    Ok(PlateReader::new(engine.start_second_stage(model)?, model.config.clone()))
}

/// A camera estimator on `engine`.
///
/// # Errors
/// When the engine cannot run it.
pub fn camera_estimator(model: &CameraEstimatorModel, engine: &EngineOptions) -> Result<CameraEstimator, Error> {
    Ok(CameraEstimator::new(engine.start_small(model)?, model.config.clone()))
}
