//! Whole runs of a camera estimator.

use std::path::Path;

use farsight_core::Camera;
use farsight_data::AugmentationConfig;
use farsight_data::kitti::Calibration;
use farsight_methods::camera_estimator::train::{CameraEstimatorRun, CameraEstimatorTask, CameraEstimatorTaskConfig};
use farsight_methods::camera_estimator::{CameraEstimatorConfig, CameraEstimatorModel};
use farsight_train::config::{DataConfig, TrainConfig, ValidateConfig};
use farsight_train::metrics::StepSummary;
use farsight_train::training::{Callback, Job, Start, fit};

use crate::tiny::data_set;

/// Focal errors of the steps.
#[derive(Default)]
struct FocalErrors(Vec<f64>);

impl Callback for FocalErrors {
    fn on_start(&mut self, _: Start) {}

    fn on_step(&mut self, record: &StepSummary) {
        self.0.extend(record.metrics.iter().filter(|(name, _)| *name == "focal_error").map(|(_, error)| *error));
    }

    fn validate(&mut self, _: u64, _: &Path, _: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }
}

/// Four images of noise by cameras of four focal lengths, told apart by what a backbone that stays as it is makes of
/// them.
#[test]
fn focal_lengths_of_a_small_set_are_learnt() {
    let folder = data_set(4);
    for (frame, focal_px) in [70.0, 100.0, 150.0, 220.0].into_iter().enumerate() {
        let camera = Camera::from_intrinsics(focal_px, focal_px, 100.0, 32.0).unwrap();
        let file = folder.path().join(format!("training/calib/{frame:06}.txt"));
        Calibration::from_camera(&camera).write(&file).unwrap();
    }
    let run = CameraEstimatorRun {
        method: "camera_estimator".to_owned(),
        model: CameraEstimatorConfig { channels: 16, ..CameraEstimatorConfig::default() },
        data: DataConfig { root: Some(folder.path().to_owned()), ..DataConfig::default() },
        augmentation: AugmentationConfig::none(),
        train: TrainConfig {
            epochs: 100,
            batch_size: 4,
            learning_rate: 3e-3,
            warm_up_steps: 2,
            clip_norm: 10.0,
            log_steps: 1,
            threads: 1,
            freeze: vec!["backbone.body.".to_owned()],
            ..TrainConfig::default()
        },
        task: CameraEstimatorTaskConfig::default(),
        validate: None,
    };
    let mut errors = FocalErrors::default();
    let job = Job { run, out: folder.path().join("run"), resume: false };
    let path = fit::<CameraEstimatorTask>(&job, &mut errors).unwrap();
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
    let (first, last) = (mean(&errors.0[..2]), mean(&errors.0[errors.0.len() - 5..]));
    assert!(last < 0.5 * first, "logarithms off by {first}, then {last}");
    assert_eq!(CameraEstimatorModel::read(&path).unwrap().config.channels, 16);
}
