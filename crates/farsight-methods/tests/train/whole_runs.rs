//! What every detector that is trained here must do: learn, go on where it was killed, bear frames without objects, and
//! answer alike on the built-in engine and on libtorch.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use crate::tiny::{Silent, run_config};
use farsight_data::AugmentationConfig;
use farsight_graph::init::initial_weights;
use farsight_graph::model::{Model, NetworkConfig};
use farsight_onnx::{Facts, INPUT, OnnxModel, Target};
use farsight_runtime::{RtenRunner, Runner, TensorView};
use farsight_train::config::{RunConfig, TaskConfig, TrainConfig, ValidateConfig};
use farsight_train::metrics::StepSummary;
use farsight_train::runner::TorchRunner;
use farsight_train::task::{RunOf, Task};
use farsight_train::training::{Callback, Job, Start, fit};

/// Rounding in another order of sums.
const TOLERANCE: f32 = 1e-4;

/// What makes a config one that cannot be, and what is told then.
pub(crate) type Changes<T> = &'static [(fn(&mut T), &'static str)];

/// A run of a few steps on the data set in `root`.
pub(crate) fn run_of<M: NetworkConfig, C: TaskConfig>(model: M, task: C, root: &Path) -> RunConfig<M, C> {
    let smoke = run_config(root);
    RunConfig {
        method: M::METHOD.to_owned(),
        model,
        data: smoke.data,
        augmentation: AugmentationConfig::none(),
        train: TrainConfig { learning_rate: 1e-3, ..smoke.train },
        task,
        validate: None,
    }
}

/// Trains so many epochs on the data set in `folder`; the losses of the first and of the last step, and the model.
pub(crate) fn learnt<T: Task>(run: RunOf<T>, epochs: u64, folder: &Path) -> ([f64; 2], Model<T::Model>) {
    let mut run = run;
    (run.train.epochs, run.train.checkpoint_steps) = (epochs, 1000);
    let mut callback = Silent::default();
    let job = Job { run, out: folder.join("run"), resume: false };
    let model = Model::read(&fit::<T>(&job, &mut callback).unwrap()).unwrap();
    ([callback.losses[0], callback.losses[callback.losses.len() - 1]], model)
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

/// A run that was killed and goes on ends in the same bytes as one left alone.
pub(crate) fn goes_on<T: Task>(run: RunOf<T>, folder: &Path) {
    let mut run = run;
    run.augmentation = AugmentationConfig::default();
    let job = |out: &str, resume| Job { run: run.clone(), out: folder.join(out), resume };
    let whole = fs::read(fit::<T>(&job("whole", false), &mut Silent::default()).unwrap()).unwrap();
    let first = catch_unwind(AssertUnwindSafe(|| fit::<T>(&job("parts", false), &mut Stopper)));
    assert!(first.is_err() && !folder.join("parts").join(T::MODEL_FILE).exists());
    let parts = fs::read(fit::<T>(&job("parts", true), &mut Silent::default()).unwrap()).unwrap();
    assert!(whole == parts, "the models differ");
}

/// Frames without objects are learnt from.
pub(crate) fn bears_empty_frames<T: Task>(run: RunOf<T>, folder: &Path) {
    for entry in fs::read_dir(folder.join("training/label_2")).unwrap() {
        fs::write(entry.unwrap().path(), "").unwrap();
    }
    let mut callback = Silent::default();
    fit::<T>(&Job { run, out: folder.join("run"), resume: false }, &mut callback).unwrap();
    assert!(!callback.losses.is_empty() && callback.losses.iter().all(|loss| loss.is_finite()));
}

/// The built-in engine answers as libtorch does, for an input of this width and height.
pub(crate) fn engines_agree<C: NetworkConfig>(config: &C, [width, height]: [usize; 2]) {
    let model = Model::new(config.clone(), initial_weights(&config.graph(), 3)).unwrap();
    let onnx = OnnxModel::from_model(&model, &Facts::new(&model, Target::Portable), Target::Portable, "x".as_ref());
    let mut rten = RtenRunner::new(onnx.unwrap(), Some(1)).unwrap();
    let mut torch = TorchRunner::on_cpu(&model).unwrap();
    assert!(rten.outputs().iter().map(|output| output.name.as_str()).eq(C::OUTPUTS.iter().copied()));
    let values: Vec<f32> = (0..3 * width * height).map(|i| (i as f32 * 0.37).sin()).collect();
    let inputs = [(INPUT, TensorView { shape: &[1, 3, height, width], values: &values })];
    let [found, expected] = [rten.run(&inputs), torch.run(&inputs)].map(Result::unwrap);
    assert_eq!(found.len(), C::OUTPUTS.len());
    for ((found, expected), name) in found.iter().zip(&expected).zip(C::OUTPUTS) {
        assert_eq!(found.shape, expected.shape, "{name}");
        let largest = expected.values.iter().fold(1.0, |largest: f32, value| largest.max(value.abs()));
        let pairs = found.values.iter().zip(&expected.values);
        let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off <= TOLERANCE * largest, "{config:?} {name}: {off} of {largest}");
    }
}
