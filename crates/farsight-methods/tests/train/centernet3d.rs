//! Whole runs of a small CenterNet for 3D boxes, and the built-in engine's answers against libtorch's.

use std::fs;
use std::path::Path;

use crate::tiny::{Silent, data_set, run_config};
use farsight_data::AugmentationConfig;
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_graph::model::NetworkConfig;
use farsight_methods::centernet3d::train::{CenterNet3dRun, CenterNet3dTask, CenterNet3dTaskConfig};
use farsight_methods::centernet3d::{CenterNet3dConfig, CenterNet3dModel};
use farsight_onnx::{Facts, INPUT, OnnxModel, Target};
use farsight_runtime::{RtenRunner, Runner, TensorView};
use farsight_train::config::{TrainConfig, ValidateConfig};
use farsight_train::metrics::StepSummary;
use farsight_train::runner::TorchRunner;
use farsight_train::training::{Callback, Job, Start, fit};

/// Rounding in another order of sums.
const TOLERANCE: f32 = 1e-4;

fn small() -> CenterNet3dConfig {
    CenterNet3dConfig {
        input: [192, 64],
        width: 0.25,
        norm: NormKind::Batch,
        neck: NeckKind::Plain,
        ..CenterNet3dConfig::default()
    }
}

fn run(data: &Path) -> CenterNet3dRun {
    let smoke = run_config(data);
    CenterNet3dRun {
        method: CenterNet3dConfig::METHOD.to_owned(),
        model: small(),
        data: smoke.data,
        augmentation: AugmentationConfig::none(),
        train: TrainConfig { learning_rate: 1e-3, ..smoke.train },
        task: CenterNet3dTaskConfig::default(),
        validate: None,
    }
}

#[test]
fn a_small_network_learns_a_small_set() {
    let folder = data_set(4);
    let mut run = run(folder.path());
    (run.train.epochs, run.train.checkpoint_steps) = (60, 1000);
    let mut callback = Silent::default();
    let job = Job { run, out: folder.path().join("run"), resume: false };
    let model = CenterNet3dModel::read(&fit::<CenterNet3dTask>(&job, &mut callback).unwrap()).unwrap();
    let (first, last) = (callback.losses[0], callback.losses[callback.losses.len() - 1]);
    assert!(last < 0.3 * first, "{first} to {last}");
    assert_eq!(model.config, small());
}

/// Stands for a process that is killed after its third step.
struct Stopper;

impl Callback for Stopper {
    fn on_start(&mut self, _: Start) {}

    fn on_step(&mut self, step: &StepSummary) {
        assert!(step.step < 3, "stopped");
    }

    fn validate(&mut self, _: u64, _: &Path, _: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }
}

#[test]
fn a_run_that_goes_on_ends_in_the_same_bytes() {
    let folder = data_set(4);
    let mut run = run(folder.path());
    run.augmentation = AugmentationConfig::default();
    let job = |out: &str, resume| Job { run: run.clone(), out: folder.path().join(out), resume };
    let whole = fs::read(fit::<CenterNet3dTask>(&job("whole", false), &mut Silent::default()).unwrap()).unwrap();
    let first = std::panic::catch_unwind(|| fit::<CenterNet3dTask>(&job("parts", false), &mut Stopper));
    assert!(first.is_err() && !folder.path().join("parts/model.safetensors").exists());
    let parts = fs::read(fit::<CenterNet3dTask>(&job("parts", true), &mut Silent::default()).unwrap()).unwrap();
    assert!(whole == parts, "the models differ");
}

#[test]
fn frames_without_objects_are_learnt_from() {
    let folder = data_set(2);
    for frame in 0..2 {
        fs::write(folder.path().join(format!("training/label_2/{frame:06}.txt")), "").unwrap();
    }
    let mut callback = Silent::default();
    let job = Job { run: run(folder.path()), out: folder.path().join("run"), resume: false };
    fit::<CenterNet3dTask>(&job, &mut callback).unwrap();
    assert!(!callback.losses.is_empty() && callback.losses.iter().all(|loss| loss.is_finite()));
}

#[test]
fn weights_that_cannot_be_are_told() {
    let mut run = run("unused".as_ref());
    run.task.depth_weight = -1.0;
    assert_eq!(run.problem().unwrap(), "task.depth_weight is -1; expected 0 or a positive number");
}

#[test]
fn the_built_in_engine_answers_as_libtorch_does() {
    for neck in [NeckKind::Plain, NeckKind::Deformable] {
        let config = CenterNet3dConfig { neck, ..small() };
        let model = CenterNet3dModel::new(config.clone(), initial_weights(&config.graph(), 3)).unwrap();
        let onnx = OnnxModel::from_model(&model, &Facts::new(&model, Target::Portable), Target::Portable, "x".as_ref());
        let mut rten = RtenRunner::new(onnx.unwrap(), Some(1)).unwrap();
        let mut torch = TorchRunner::on_cpu(&model).unwrap();
        assert!(
            rten.outputs().iter().map(|output| output.name.as_str()).eq(CenterNet3dConfig::OUTPUTS.iter().copied())
        );
        let [width, height] = config.input;
        let values: Vec<f32> = (0..3 * width * height).map(|i| (i as f32 * 0.37).sin()).collect();
        let inputs = [(INPUT, TensorView { shape: &[1, 3, height, width], values: &values })];
        let [found, expected] = [rten.run(&inputs), torch.run(&inputs)].map(Result::unwrap);
        assert_eq!(found.len(), CenterNet3dConfig::OUTPUTS.len());
        for ((found, expected), name) in found.iter().zip(&expected).zip(CenterNet3dConfig::OUTPUTS) {
            assert_eq!(found.shape, expected.shape, "{name}");
            let largest = expected.values.iter().fold(1.0, |largest: f32, value| largest.max(value.abs()));
            let pairs = found.values.iter().zip(&expected.values);
            let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off <= TOLERANCE * largest, "{neck:?} {name}: {off} of {largest}");
        }
    }
}
