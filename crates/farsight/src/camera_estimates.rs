//! Cameras that are estimated from the images that they took, by the network that comes with the library.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use farsight_methods::camera_estimator::{CameraEstimate, CameraEstimator, CameraEstimatorModel};
use image::RgbImage;

use crate::{EngineOptions, Error, second_stage, shipped};

/// Estimates cameras. It is opened with the first image, on the engine that needs nothing; a clone is the same.
#[derive(Clone, Default)]
pub struct CameraEstimates {
    /// Estimators that no thread uses now.
    idle: Arc<Mutex<Vec<CameraEstimator>>>,
    /// Other weights than the shipped ones.
    model: Option<Arc<CameraEstimatorModel>>,
}

impl fmt::Debug for CameraEstimates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CameraEstimates").finish_non_exhaustive()
    }
}

impl CameraEstimates {
    /// With other weights than the shipped ones.
    pub fn with_model(model: CameraEstimatorModel) -> Self {
        Self { model: Some(Arc::new(model)), ..Self::default() }
    }

    /// What `image` says of its camera.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn estimate(&self, image: &RgbImage) -> Result<CameraEstimate, Error> {
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let taken = idle().pop();
        let mut estimator = taken.map_or_else(|| self.open(), Ok)?;
        let estimate = estimator.estimate(image)?;
        idle().push(estimator);
        Ok(estimate)
    }

    fn open(&self) -> Result<CameraEstimator, Error> {
        let engine = EngineOptions::default();
        match &self.model {
            Some(model) => second_stage::camera_estimator(model, &engine),
            None => second_stage::camera_estimator(&shipped::camera_estimator()?, &engine),
        }
    }
}
