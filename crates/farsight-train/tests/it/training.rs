//! Whole runs of a very small network on a very small data set.

use std::fs;

use crate::tiny::{Silent, data_set, run_config};
use farsight_core::corner_loss::corner_loss;
use farsight_net::model::Model;
use farsight_train::executor::Precision;
use farsight_train::loss::{BatchTargets, CornerWeights, loss};
use farsight_train::trainer::{CHECKPOINT_FILE, Job, TrainError, train};
use tch::{Device, Kind, Tensor};

#[test]
fn the_same_seed_gives_the_same_weights_for_any_number_of_workers() {
    let folder = data_set(5);
    let model = |name: &str, workers: usize| {
        let mut run = run_config(folder.path());
        run.data.workers = workers;
        let out = folder.path().join(name);
        Model::read(&train(&Job { run, out, resume: false }, &mut Silent::default()).unwrap()).unwrap().weights.tensors
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
    train(&Job { run, out: folder.path().join("run"), resume: false }, &mut observer).unwrap();
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
    let error = train(&Job { run: run.clone(), out: out.clone(), resume: false }, &mut Silent::default()).unwrap_err();
    let TrainError::NotFinite { step, what, frames, .. } = &error else { panic!("{error}") };
    assert!(what.contains("loss term") || what.contains("gradient"), "{what}");
    assert_eq!(frames.len(), 2);
    assert!(*step >= 1);
    let (weights, progress) = farsight_train::checkpoint::read(&out.join(CHECKPOINT_FILE), &run).unwrap();
    assert!(progress.steps <= *step);
    assert!(!weights.tensors.is_empty());
}

#[test]
fn a_folder_with_a_run_is_not_overwritten_and_another_config_does_not_resume_it() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.train.epochs = 1;
    let out = folder.path().join("run");
    let job = |run: &farsight_train::config::RunConfig, resume| Job { run: run.clone(), out: out.clone(), resume };
    train(&job(&run, false), &mut Silent::default()).unwrap();
    let again = train(&job(&run, false), &mut Silent::default()).unwrap_err().to_string();
    assert!(again.contains("there is a run here already"), "{again}");
    run.train.seed += 1;
    let other = train(&job(&run, true), &mut Silent::default()).unwrap_err().to_string();
    assert!(other.contains("another config"), "{other}");
}

#[test]
fn metrics_are_one_json_line_a_record_and_tensorboard_events() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.train.epochs = 2;
    let out = folder.path().join("run");
    train(&Job { run, out: out.clone(), resume: false }, &mut Silent::default()).unwrap();
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
        loss(&codec, &maps(batch, 3), &maps(batch, 8), &targets, CornerWeights::alike(37.5 * batch as f64)).1
    };
    let (one, eight) = (terms(1), terms(8));
    for ((name, a), (_, b)) in one.named().iter().zip(eight.named()) {
        assert!((a - b).abs() < 1e-5 * a.abs(), "{name}: {a} and {b}");
    }
    // And by hand: the corner terms are the sum over the objects, over 37.5.
    let raw = std::array::from_fn(|channel| {
        let cell = image.objects[0].cell;
        maps(1, 8).double_value(&[0, channel as i64, cell[1] as i64, cell[0] as i64])
    });
    let by_hand = corner_loss(&codec, raw, &image.objects[0], &image.camera);
    assert!((one.location - by_hand.location / 37.5).abs() < 1e-5 * one.location);
}

#[test]
fn mixed_precision_and_clipping_train_too() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.train.precision = Precision::Bf16;
    run.train.clip_norm = 1.0;
    let mut observer = Silent::default();
    train(&Job { run, out: folder.path().join("run"), resume: false }, &mut observer).unwrap();
    assert!(observer.losses.iter().all(|loss| loss.is_finite()));
}
