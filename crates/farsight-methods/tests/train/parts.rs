//! Parts of a network that stay as they are, start anew, or learn at another rate.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::tiny::{Silent, data_set, run_config};
use farsight_graph::weights::Weights;
use farsight_methods::smoke::network::Backbone;
use farsight_methods::smoke::train::{SmokeRun, SmokeTask};
use farsight_methods::smoke::{SmokeConfig, SmokeModel};
use farsight_train::config::ValidateConfig;
use farsight_train::metrics::StepSummary;
use farsight_train::training::fit;
use farsight_train::training::{Callback, Job, Start};

/// The features, without the pyramid and the heads.
const BODY: &str = "backbone.body.";

/// A run of the smallest `MobileNetV2`.
fn run(root: &Path) -> SmokeRun {
    let mut run = run_config(root);
    run.model = SmokeConfig {
        backbone: Backbone::MobilenetV2,
        width: 0.1,
        level_channels: None,
        neck_channels: Some(16),
        ..run.model
    };
    run
}

fn trained(run: &SmokeRun, out: &Path) -> Result<PathBuf, String> {
    let job = Job { run: run.clone(), out: out.to_path_buf(), resume: false };
    fit::<SmokeTask>(&job, &mut Silent::default()).map_err(|error| error.to_string())
}

fn tensors(path: &Path) -> Weights {
    SmokeModel::read(path).unwrap().weights
}

/// The names of the tensors that differ.
fn moved(before: &Weights, after: &Weights) -> Vec<String> {
    let names = before.tensors.keys().filter(|name| before.tensors[*name] != after.tensors[*name]);
    names.cloned().collect()
}

#[test]
fn what_is_frozen_keeps_its_bytes_and_all_else_learns() {
    let folder = data_set(4);
    let root = folder.path();
    let mut first = run(root);
    first.train.epochs = 1;
    let start = trained(&first, &root.join("start")).unwrap();
    let mut run = run(root);
    (run.train.start_from, run.train.freeze) = (Some(start.clone()), vec![BODY.to_owned()]);
    // Neither running means of the weights nor statistics taken anew move what is frozen.
    (run.train.ema_decay, run.train.statistics_batches) = (Some(0.5), Some(2));
    let end = trained(&run, &root.join("frozen")).unwrap();
    let (before, after) = (tensors(&start), tensors(&end));
    let moved = moved(&before, &after);
    assert!(moved.iter().all(|name| !name.starts_with(BODY)), "{moved:?}");
    assert_eq!(moved.len(), before.tensors.keys().filter(|name| !name.starts_with(BODY)).count());

    // Its moments are not kept, either.
    let checkpoint = Weights::read(&root.join("frozen/checkpoint.safetensors")).unwrap();
    assert!(!checkpoint.tensors.keys().any(|name| name.starts_with("adam.mean.backbone.body.")));
    assert!(checkpoint.tensors.keys().any(|name| name.starts_with("adam.mean.backbone.fpn.")));
}

/// Stops a run in the middle.
struct Stop;

impl Callback for Stop {
    fn on_start(&mut self, _: Start) {}

    fn validate(&mut self, _: u64, _: &Path, _: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }

    fn on_step(&mut self, record: &StepSummary) {
        assert!(record.step < 5, "stopped on purpose");
    }
}

#[test]
fn a_frozen_run_that_stops_and_goes_on_ends_in_the_same_bytes() {
    let folder = data_set(6);
    let root = folder.path();
    let mut whole = run(root);
    (whole.train.freeze, whole.train.epochs) = (vec![BODY.to_owned()], 3);
    whole.train.rate_factors = BTreeMap::from([("heads.".to_owned(), 0.5)]);
    let end = trained(&whole, &root.join("whole")).unwrap();

    // The checkpoint of the step before is there.
    let job = |resume| Job { run: whole.clone(), out: root.join("stopped"), resume };
    let stopped = std::panic::catch_unwind(|| fit::<SmokeTask>(&job(false), &mut Stop));
    assert!(stopped.is_err());
    let resumed = fit::<SmokeTask>(&job(true), &mut Silent::default()).unwrap();
    assert!(std::fs::read(end).unwrap() == std::fs::read(resumed).unwrap(), "the models differ");
}

#[test]
fn a_part_learns_at_its_own_rate_and_the_longest_name_counts() {
    let folder = data_set(2);
    let root = folder.path();
    let start = {
        let mut run = run(root);
        (run.train.epochs, run.train.learning_rate) = (1, 1e-12);
        trained(&run, &root.join("start")).unwrap()
    };
    let step = |name: &str, factors: &[(&str, f64)]| {
        let mut run = run(root);
        (run.train.epochs, run.train.weight_decay) = (1, 0.0);
        run.train.start_from = Some(start.clone());
        run.train.rate_factors = factors.iter().map(|(prefix, factor)| ((*prefix).to_owned(), *factor)).collect();
        tensors(&trained(&run, &root.join(name)).unwrap())
    };
    let before = tensors(&start);
    let alike = step("alike", &[]);
    let slower = step("slower", &[("backbone.", 0.5), (BODY, 0.1)]);
    let far = |after: &Weights, name: &str| {
        let pairs = after.tensors[name].values.iter().zip(&before.tensors[name].values);
        pairs.map(|(a, b)| f64::from(a - b).abs()).sum::<f64>()
    };
    let rows = [
        ("backbone.body.features.3.conv.0.0.weight", 0.1),
        ("backbone.fpn.layer_blocks.0.conv.weight", 0.5),
        ("heads.predictor.class_head.0.weight", 1.0),
    ];
    for (name, factor) in rows {
        let share = far(&slower, name) / far(&alike, name);
        // A step is a few units in the last place of the weights, so shares are rounded.
        assert!((share - factor).abs() < 0.02, "{name}: {share}, not {factor}");
    }
}

#[test]
fn a_start_without_a_part_has_all_else_or_is_an_error() {
    let folder = data_set(2);
    let root = folder.path();
    let mut first = run(root);
    first.train.epochs = 1;
    let start = trained(&first, &root.join("start")).unwrap();
    let mut run = run(root);
    (run.train.epochs, run.train.learning_rate, run.train.seed) = (1, 1e-12, 7);
    run.train.start_from = Some(start.clone());
    let before = tensors(&start);

    let weight = |weights: &Weights, name: &str| weights.tensors[name].values.clone();
    let close = |a: Vec<f32>, b: Vec<f32>| a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6);
    run.train.start_without = Some(vec!["heads.".to_owned()]);
    let after = tensors(&trained(&run, &root.join("without")).unwrap());
    for (name, taken) in [("heads.predictor.class_head.0.weight", false), ("backbone.body.features.0.0.weight", true)] {
        assert_eq!(close(weight(&before, name), weight(&after, name)), taken, "{name}");
    }

    // A file of the features alone.
    let body = root.join("body.safetensors");
    let mut features = before.clone();
    features.tensors.retain(|name, _| name.starts_with(BODY));
    features.metadata.clear();
    features.write(&body).unwrap();
    run.train.start_from = Some(body);
    let missing = trained(&run, &root.join("missing")).unwrap_err();
    assert!(missing.contains("body.safetensors: tensor \"backbone.fpn."), "{missing}");
    assert!(missing.contains("is missing") && missing.contains("train.start_without"), "{missing}");
    run.train.start_without = Some(vec!["heads.".to_owned(), "backbone.fpn.".to_owned()]);
    trained(&run, &root.join("all")).unwrap();
}

#[test]
fn parts_that_are_not_there_are_told() {
    let folder = data_set(2);
    let root = folder.path();
    let with = |change: fn(&mut SmokeRun)| {
        let mut run = run(root);
        change(&mut run);
        trained(&run, &root.join("none")).unwrap_err()
    };
    let freeze = with(|run| run.train.freeze = vec!["backbone.boby.".to_owned()]);
    assert!(freeze.contains("train.freeze names \"backbone.boby.\""), "{freeze}");
    let all = with(|run| run.train.freeze = vec!["backbone.".to_owned(), "heads.".to_owned()]);
    assert!(all.contains("train.freeze names the whole network"), "{all}");
    let rates = with(|run| run.train.rate_factors = BTreeMap::from([("head.".to_owned(), 0.1)]));
    assert!(rates.contains("train.rate_factors names \"head.\""), "{rates}");

    let mut zero = run(root);
    zero.train.rate_factors = BTreeMap::from([("heads.".to_owned(), 0.0)]);
    assert!(zero.problem().unwrap().contains("train.rate_factors has 0 for \"heads.\""));
    let mut nothing = run(root);
    nothing.train.start_without = Some(Vec::new());
    assert!(nothing.problem().unwrap().contains("train.start_without needs train.start_from"));
}
