//! A run that is measured while it goes.

use std::fs;
use std::path::Path;

use crate::tiny::{Silent, data_set, run_config};
use farsight_methods::smoke::train::SmokeTask;
use farsight_train::config::ValidateConfig;
use farsight_train::metrics::StepSummary;
use farsight_train::training::{Callback, Job, Start, TrainError, VALIDATED_FILE, fit};
use serde_json::{Value, json};

/// Measures by counting; cannot after so many times.
struct Counter {
    steps: Vec<u64>,
    most: usize,
    trained: usize,
}

impl Counter {
    fn new(most: usize) -> Self {
        Self { steps: Vec::new(), most, trained: 0 }
    }
}

impl Callback for Counter {
    fn on_start(&mut self, _: Start) {}

    fn on_step(&mut self, _: &StepSummary) {
        self.trained += 1;
    }

    fn validate(&mut self, step: u64, model: &Path, config: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        assert!(model.is_file() && config.limit == 3);
        if self.steps.len() == self.most {
            return Err("no more of it".to_owned());
        }
        self.steps.push(step);
        Ok(vec![("mae_m".to_owned(), step as f64 / 8.0)])
    }
}

fn validate(root: &Path, every_steps: u64) -> ValidateConfig {
    ValidateConfig { root: root.to_owned(), split: "train".into(), every_steps, limit: 3 }
}

#[test]
fn what_is_measured_is_the_model_so_far_and_measuring_changes_nothing() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    (run.train.epochs, run.train.ema_decay) = (3, Some(0.9));
    let out = |name: &str| folder.path().join(name);
    let alone = Job { run: run.clone(), out: out("alone"), resume: false };
    let alone = fs::read(fit::<SmokeTask>(&alone, &mut Silent::default()).unwrap()).unwrap();

    run.validate = Some(validate(folder.path(), 4));
    let mut counter = Counter::new(9);
    let model = fit::<SmokeTask>(&Job { run, out: out("measured"), resume: false }, &mut counter).unwrap();
    assert_eq!(counter.steps, [4, 6], "every four steps, and after the last one");
    assert!(fs::read(model).unwrap() == alone, "measuring changed the weights");
    // What was measured after the last step is what the run leaves behind, running means and all.
    assert!(fs::read(out("measured").join(VALIDATED_FILE)).unwrap() == alone);

    let lines = fs::read_to_string(out("measured").join("metrics.jsonl")).unwrap();
    let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let measured: Vec<&Value> = lines.iter().filter(|line| line.get("validation").is_some()).collect();
    let expected = [4, 6].map(|step| json!({ "step": step, "validation": { "mae_m": f64::from(step) / 8.0 } }));
    assert_eq!(measured, expected.iter().collect::<Vec<_>>());
    assert_eq!(lines.len(), 6 + 2);
}

#[test]
fn frames_that_are_not_there_are_told_before_the_first_step() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.validate = Some(validate(&folder.path().join("nowhere"), 1));
    let mut counter = Counter::new(9);
    let job = Job { run, out: folder.path().join("run"), resume: false };
    let error = fit::<SmokeTask>(&job, &mut counter).unwrap_err().to_string();
    assert!(error.contains("nowhere"), "{error}");
    assert_eq!(counter.trained, 0);
}

#[test]
fn a_measurement_that_fails_ends_the_run_with_its_reason() {
    let folder = data_set(4);
    let mut run = run_config(folder.path());
    run.validate = Some(validate(folder.path(), 2));
    let mut counter = Counter::new(1);
    let job = Job { run, out: folder.path().join("run"), resume: false };
    let error = fit::<SmokeTask>(&job, &mut counter).unwrap_err();
    assert!(matches!(&error, TrainError::Validate(reason) if reason == "no more of it"), "{error}");
    assert_eq!((counter.steps, counter.trained), (vec![2], 4));
}
