//! Whole runs of a very small network on a very small data set.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::tiny::{Silent, data_set, run_config};
use farsight_data::{Dataset, Frame, MemoryDataset, open_labelled};
use farsight_graph::graph::Role;
use farsight_graph::layers::NormKind;
use farsight_graph::weights::Weights;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::corner_loss::corner_loss;
use farsight_methods::smoke::train::loss::{BatchTargets, CornerWeights, loss, surface_loss};
use farsight_methods::smoke::train::{SmokeRun, SmokeTask};
use farsight_methods::training::train_on;
use farsight_train::config::{PrecisionChoice, RenderedConfig, ValidateConfig};
use farsight_train::executor::{has_bf16, values_from_tensor};
use farsight_train::metrics::{Metrics, StepSummary};
use farsight_train::training::{CHECKPOINT_FILE, CONFIG_FILE, Callback, Job, Start, TrainError};
use farsight_train::training::{FileOptions, fit, fit_on};
use tch::{Device, Kind, Tensor};

#[test]
fn the_same_seed_gives_the_same_weights_for_any_number_of_workers() {
    let folder = data_set(5);
    let model = |name: &str, workers: usize| {
        let mut run = run_config(folder.path());
        run.data.workers = workers;
        let out = folder.path().join(name);
        SmokeModel::read(&fit::<SmokeTask>(&Job { run, out, resume: false }, &mut Silent::default()).unwrap())
            .unwrap()
            .weights
            .tensors
    };
    assert!(model("one", 1) == model("three", 3));
}

#[test]
fn a_small_network_learns_a_small_set() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.train.epochs = 60;
    run.train.checkpoint_steps = 1000;
    run.train.learning_rate = 3e-3;
    let mut observer = Silent::default();
    fit::<SmokeTask>(&Job { run, out: folder.path().join("run"), resume: false }, &mut observer).unwrap();
    let (first, last) = (observer.losses[0], observer.losses[observer.losses.len() - 1]);
    assert!(last < 0.3 * first, "{first} to {last}");
}

#[test]
fn a_loss_that_is_not_finite_stops_the_run_and_leaves_the_last_checkpoint() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.train.epochs = 50;
    run.train.learning_rate = 1e20;
    let out = folder.path().join("run");
    let error = fit::<SmokeTask>(&Job { run: run.clone(), out: out.clone(), resume: false }, &mut Silent::default())
        .unwrap_err();
    let TrainError::NotFinite { step, what, frames, .. } = &error else { panic!("{error}") };
    assert!(what.contains("loss term") || what.contains("gradient"), "{what}");
    assert_eq!(frames.len(), 2);
    assert!(*step >= 1);
    let (weights, progress) = farsight_train::checkpoint::read(&out.join(CHECKPOINT_FILE), &run.identity()).unwrap();
    assert!(progress.steps <= *step);
    assert!(!weights.tensors.is_empty());
}

#[test]
fn a_folder_with_a_run_is_not_overwritten_and_another_config_does_not_resume_it() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.train.epochs = 1;
    let out = folder.path().join("run");
    let job = |run: &SmokeRun, resume| Job { run: run.clone(), out: out.clone(), resume };
    fit::<SmokeTask>(&job(&run, false), &mut Silent::default()).unwrap();
    let again = fit::<SmokeTask>(&job(&run, false), &mut Silent::default()).unwrap_err().to_string();
    assert!(again.contains("there is a run here already"), "{again}");
    run.train.seed += 1;
    let other = fit::<SmokeTask>(&job(&run, true), &mut Silent::default()).unwrap_err().to_string();
    assert!(other.contains("another config"), "{other}");
}

#[test]
fn metrics_are_one_json_line_a_record_and_tensorboard_events() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.train.epochs = 2;
    let out = folder.path().join("run");
    fit::<SmokeTask>(&Job { run, out: out.clone(), resume: false }, &mut Silent::default()).unwrap();
    let text = fs::read_to_string(out.join("metrics.jsonl")).unwrap();
    let steps: Vec<u64> = text
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["step"].as_u64().unwrap())
        .collect();
    assert_eq!(steps, [1, 2, 3, 4]);
    let events = fs::read_dir(&out)
        .unwrap()
        .flatten()
        .find(|e| e.file_name().to_string_lossy().starts_with("events.out.tfevents"));
    assert!(events.unwrap().metadata().unwrap().len() > 200);
}

#[test]
fn the_loss_does_not_depend_on_how_often_an_image_is_in_the_batch() {
    let config = run_config("unused".as_ref()).model;
    let image = crate::tiny::targets(&config);
    let codec = config.codec();
    let [width, height] = image.map_size.map(|s| s as i64);
    let maps = |batch: i64, channels: i64| {
        let one =
            Tensor::arange(channels * height * width, (Kind::Float, Device::Cpu)).view([1, channels, height, width]);
        (one * 0.37).sin().repeat([batch, 1, 1, 1])
    };
    let terms = |batch: i64| {
        let targets = BatchTargets::new(&vec![image.clone(); batch as usize], &vec![true; batch as usize], Device::Cpu);
        loss(&codec, &maps(batch, 3), &maps(batch, 8), &targets, CornerWeights::uniform(37.5 * batch as f64)).1
    };
    let (one, eight) = (terms(1), terms(8));
    for ((name, a), (_, b)) in one.named().iter().zip(eight.named()) {
        assert!((a - b).abs() <= 1e-5 * a.abs(), "{name}: {a} and {b}");
    }
    // And by hand: the corner terms are the sum over the objects, over 37.5.
    let raw = std::array::from_fn(|channel| {
        let cell = image.objects[0].cell;
        maps(1, 8).double_value(&[0, channel as i64, cell[1] as i64, cell[0] as i64])
    });
    let by_hand = corner_loss(&codec, raw, &image.objects[0], &image.camera);
    assert!((one.location - by_hand.location.value / 37.5).abs() < 1e-5 * one.location);
}

#[test]
fn the_factor_on_a_part_reaches_its_channels_and_nothing_else() {
    let config = run_config("unused".as_ref()).model;
    let image = crate::tiny::targets(&config);
    let [width, height] = image.map_size.map(|s| s as i64);
    let codec = config.codec();
    let targets = BatchTargets::new(std::slice::from_ref(&image), &[true], Device::Cpu);
    let learn = |weights: CornerWeights| {
        let maps = |channels: i64| {
            let values = Tensor::arange(channels * height * width, (Kind::Float, Device::Cpu)) * 0.37;
            values.sin().view([1, channels, height, width])
        };
        let regression = maps(8).set_requires_grad(true);
        let (objective, terms) = loss(&codec, &maps(3), &regression, &targets, weights);
        (terms, Tensor::run_backward(&[objective], &[regression], false, false).remove(0))
    };
    let uniform = CornerWeights { image: 1.0, ..CornerWeights::uniform(37.5) };
    let (once, gradient) = learn(uniform);

    // What a factor of 0 takes away, a factor of 3 adds twice, in the part's own channels and nowhere else.
    let check = |own: Range<i64>, weights: [CornerWeights; 2]| {
        let [(none, without), (thrice, stronger)] = weights.map(learn);
        assert!(once.total() > none.total());
        assert!((thrice.total() - once.total() - 2.0 * (once.total() - none.total())).abs() < 1e-9 * once.total());
        assert_eq!((none.heatmap, none.location), (once.heatmap, once.location));

        let (added, share) = (&stronger - &gradient, &gradient - &without);
        assert!(added.allclose(&(&share * 2.0), 1e-5, 1e-7, false));
        // Not always all of its own: where the length's error decides the signs of all differences, the width has no
        // derivative.
        let moves = |channel: &i64| share.select(1, *channel).abs().max().double_value(&[]) > 0.0;
        let moved: Vec<_> = (0..8).filter(moves).collect();
        assert!(moved.len() > 1 && moved.iter().all(|channel| own.contains(channel)), "{own:?}: {moved:?}");
    };
    check(6..8, [0.0, 3.0].map(|orientation| CornerWeights { orientation, ..uniform }));
    check(3..6, [0.0, 3.0].map(|dimensions| CornerWeights { dimensions, ..uniform }));
    check(0..8, [0.0, 3.0].map(|image| CornerWeights { image, ..uniform }));
}

#[test]
fn neighbours_share_the_weight_of_an_object_and_leave_other_objects_their_cells() {
    let image = crate::tiny::targets(&run_config("unused".as_ref()).model);
    let mut beside = image.objects[0].clone();
    beside.cell[0] += 1;
    let mut corner = beside.clone();
    corner.cell = [0, 0];
    let objects = vec![image.objects[0].clone(), beside, corner];
    let batch = || {
        BatchTargets::new(
            &[farsight_methods::smoke::targets::Targets { objects: objects.clone(), ..image.clone() }],
            &[true],
            Device::Cpu,
        )
    };
    assert_eq!(batch().with_neighbours(0).cells, batch().cells);
    let cells = batch().with_neighbours(1).cells;
    // Eight of nine for the two side by side, a quarter of the square for the one in the corner.
    assert_eq!(cells.len(), 8 + 8 + 4);
    assert!((cells.iter().map(|cell| cell.share).sum::<f64>() - 3.0).abs() < 1e-12);
    for object in &objects {
        let own: Vec<_> = cells.iter().filter(|cell| cell.object.cell == object.cell).collect();
        assert!(own.iter().any(|cell| cell.object == *object));
    }
    let [first, second] = [0, 1].map(|i| objects[i].cell);
    assert_eq!(cells.iter().filter(|cell| cell.object.cell == first || cell.object.cell == second).count(), 2);
}

#[test]
fn the_surface_loss_is_a_relative_error_and_leaves_the_sky_out() {
    let map = |values: &[f32]| Tensor::from_slice(values).view([1, 1, 1, values.len() as i64]);
    let known = map(&[20.0, 40.0, f32::INFINITY, f32::INFINITY]);
    let predicted = map(&[0.0, 0.0, 7.0, -7.0]).set_requires_grad(true);
    let loss = surface_loss(&predicted, &known, 20.0);
    assert!((loss.double_value(&[]) - 2.0_f64.ln() / 2.0).abs() < 1e-6);
    let gradient = Tensor::run_backward(&[loss], &[&predicted], false, false).remove(0);
    assert_eq!(values_from_tensor(&gradient), [0.0, -0.5, 0.0, 0.0]);
    let sky = map(&[f32::INFINITY; 4]);
    assert!(surface_loss(&predicted, &sky, 20.0).double_value(&[]).abs() < 1e-12);
}

#[test]
fn the_surface_is_learnt_and_its_head_left_out_of_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let mut run = run_config("unused".as_ref());
    run.data.root = None;
    run.data.rendered = Some(RenderedConfig { frames_per_epoch: 2, ..RenderedConfig::default() });
    run.train.epochs = 1;
    let model = |name: &str, surface_weight: f64| {
        let mut run = run.clone();
        run.task.surface_weight = surface_weight;
        let mut observer = Silent::default();
        let path = fit::<SmokeTask>(&Job { run, out: folder.path().join(name), resume: false }, &mut observer).unwrap();
        (SmokeModel::read(&path).unwrap(), observer.losses)
    };
    let ((without, less), (with, more)) = (model("without", 0.0), model("with", 1.0));
    assert!(more[0] > less[0], "{more:?} {less:?}");
    assert_eq!(with.graph, without.graph);
    assert!(with.weights.tensors != without.weights.tensors);

    run.data.rendered = None;
    run.task.surface_weight = 1.0;
    assert!(run.problem().unwrap().contains("task.surface_weight needs data.rendered"));
}

#[test]
fn statistics_are_taken_anew_after_the_last_step_and_nothing_else_changes() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.model.norm = NormKind::Batch;
    run.train.epochs = 2;
    let mut tensors = |statistics_batches, resume| {
        run.train.statistics_batches = statistics_batches;
        let job = Job { run: run.clone(), out: folder.path().join("run"), resume };
        SmokeModel::read(&fit::<SmokeTask>(&job, &mut Silent::default()).unwrap()).unwrap()
    };
    let during = tensors(None, false);
    // The run is over, so that only the statistics are left to be taken.
    let anew = tensors(Some(3), true);
    for parameter in &during.graph.parameters {
        let [before, after] = [&during, &anew].map(|model| &model.weights.tensors[&parameter.name]);
        assert_eq!(before != after, parameter.role == Role::Statistic, "{}", parameter.name);
    }
}

/// Keeps the weights after each step, which it finds in the checkpoint.
struct Course {
    checkpoint: PathBuf,
    steps: Vec<Weights>,
}

impl Callback for Course {
    fn on_start(&mut self, _: Start) {}

    fn validate(&mut self, _: u64, _: &Path, _: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }

    fn on_step(&mut self, record: &StepSummary) {
        // Told before the step's own checkpoint is written, so the one that is there is of the step before.
        if record.step > 1 {
            self.steps.push(Weights::read(&self.checkpoint).unwrap());
        }
    }
}

#[test]
fn a_model_of_running_means_is_the_mean_of_its_steps_the_later_the_heavier() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    (run.train.epochs, run.train.checkpoint_steps, run.train.ema_decay) = (5, 1, Some(0.6));
    run.model.norm = NormKind::Batch;
    let out = folder.path().join("run");
    let mut course = Course { checkpoint: out.join(CHECKPOINT_FILE), steps: Vec::new() };
    let path = fit::<SmokeTask>(&Job { run: run.clone(), out: out.clone(), resume: false }, &mut course).unwrap();
    let model = SmokeModel::read(&path).unwrap();
    course.steps.push(Weights::read(&course.checkpoint).unwrap());
    assert!(course.steps.len() >= 5, "{} steps", course.steps.len());

    let shares: Vec<f64> = (0..course.steps.len()).rev().map(|age| 0.6_f64.powi(age as i32)).collect();
    let sum: f64 = shares.iter().sum();
    for (name, mean) in &model.weights.tensors {
        for (place, mean) in mean.values.iter().enumerate() {
            let each = course.steps.iter().map(|weights| f64::from(weights.tensors[name].values[place]));
            let expected = each.zip(&shares).map(|(value, share)| value * share).sum::<f64>() / sum;
            assert!(
                (f64::from(*mean) - expected).abs() < 1e-5 * (1.0 + expected.abs()),
                "{name}: {mean}, not {expected}"
            );
        }
    }
    let last = &course.steps[course.steps.len() - 1];
    assert!(
        model.weights.tensors.iter().any(|(name, tensor)| last.tensors[name] != *tensor),
        "the last step's weights"
    );
}

#[test]
fn mixed_precision_and_clipping_train_too() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.train.precision = PrecisionChoice::Bf16;
    run.train.clip_norm = 1.0;
    let mut observer = Silent::default();
    fit::<SmokeTask>(&Job { run, out: folder.path().join("run"), resume: false }, &mut observer).unwrap();
    assert!(observer.losses.iter().all(|loss| loss.is_finite()));
}

/// Stops after its second step.
#[derive(Default)]
struct Stops {
    steps: usize,
}

impl Callback for Stops {
    fn on_start(&mut self, _: Start) {}

    fn validate(&mut self, _: u64, _: &Path, _: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }

    fn on_step(&mut self, _: &StepSummary) {
        self.steps += 1;
    }

    fn stops(&mut self) -> bool {
        self.steps == 2
    }
}

#[test]
fn the_faster_numbers_are_taken_once_and_a_run_goes_on_in_them() {
    let folder = data_set(4);
    let job = |out: &str, precision, resume| {
        let mut run = run_config(folder.path());
        run.train.precision = precision;
        Job { run, out: folder.path().join(out), resume }
    };
    let config = |out: &str| SmokeRun::read(&folder.path().join(out).join(CONFIG_FILE)).unwrap().train.precision;
    for (name, precision) in [("f32", PrecisionChoice::F32), ("bf16", PrecisionChoice::Bf16)] {
        let whole = fit::<SmokeTask>(&job(&format!("{name}-whole"), precision, false), &mut Silent::default()).unwrap();
        let stopped = fit::<SmokeTask>(&job(name, precision, false), &mut Stops::default());
        assert!(matches!(stopped, Err(TrainError::Stopped { step: 2 })), "{stopped:?}");
        // Whatever is faster here, the run goes on as it began.
        let resumed = fit::<SmokeTask>(&job(name, PrecisionChoice::Auto, true), &mut Silent::default()).unwrap();
        assert!(fs::read(whole).unwrap() == fs::read(resumed).unwrap(), "{name}: the models differ");
        assert_eq!(config(name), precision);
    }
    fit::<SmokeTask>(&job("fresh", PrecisionChoice::Auto, false), &mut Silent::default()).unwrap();
    let taken = config("fresh");
    assert!(taken != PrecisionChoice::Auto && (has_bf16(Device::Cpu) || taken == PrecisionChoice::F32), "{taken:?}");
}

/// Frames of a program's own are learnt from as those of files are.
#[test]
fn a_training_on_frames_in_memory_is_that_on_their_files() {
    let folder = data_set(4);
    let run = run_config(folder.path());
    let job = |name: &str, run: &SmokeRun| Job { run: run.clone(), out: folder.path().join(name), resume: false };
    let files = fs::read(fit::<SmokeTask>(&job("files", &run), &mut Silent::default()).unwrap()).unwrap();

    let stored = open_labelled(folder.path(), Some("train".as_ref())).unwrap();
    let frames = (0..stored.len()).map(|index| Frame::clone(&stored.frame(index).unwrap()));
    let memory: Arc<dyn Dataset> = Arc::new(MemoryDataset::new("mine", frames));
    let mut alone = run;
    alone.data.root = None;
    let trained = fit_on::<SmokeTask>(&job("memory", &alone), Arc::clone(&memory), &mut Silent::default()).unwrap();
    assert!(fs::read(trained).unwrap() == files, "the weights differ");

    // The same through the table of methods.
    let table = toml::Table::try_from(&alone).unwrap();
    let options = FileOptions { out: folder.path().join("table"), ..FileOptions::default() };
    let trained = train_on(table, "in memory".as_ref(), memory, &options, &mut Silent::default()).unwrap();
    assert!(fs::read(trained).unwrap() == files, "the weights differ");

    let nothing: Arc<dyn Dataset> = Arc::new(MemoryDataset::new("nothing", []));
    let error = fit_on::<SmokeTask>(&job("nothing", &alone), nothing, &mut Silent::default()).unwrap_err();
    assert!(error.to_string().contains("nothing has no frames"), "{error}");
}
