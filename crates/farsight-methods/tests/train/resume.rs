//! A run killed with SIGKILL at any moment, resumed until it is done, ends in the same bytes as a run left alone.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::tiny::{Silent, data_set, run_config};
use farsight_methods::smoke::train::{SmokeRun, SmokeTask};
use farsight_train::task::Task;
use farsight_train::training::Job;
use farsight_train::training::fit;

/// Where the child finds its data; its presence makes [`child_process`] do something.
const DATA_VARIABLE: &str = "FARSIGHT_TEST_RESUME_DATA";

/// How often the run is killed.
const KILLS: usize = 4;

fn job(data: &Path, out: &str, resume: bool) -> Job<SmokeRun> {
    let mut run = run_config(data);
    run.train.epochs = 8;
    run.train.checkpoint_steps = 3;
    Job { run, out: data.join(out), resume }
}

/// Not a test: the process that the test below starts and kills.
#[test]
fn child_process() {
    if let Some(data) = std::env::var_os(DATA_VARIABLE) {
        fit::<SmokeTask>(&job(data.as_ref(), "killed", true), &mut Silent::default()).unwrap();
    }
}

fn start_child(data: &Path) -> Child {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command
        .args(["resume::child_process", "--exact"])
        .env(DATA_VARIABLE, data)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command.spawn().unwrap()
}

fn lines(path: &Path) -> usize {
    fs::read_to_string(path).map_or(0, |text| text.lines().count())
}

#[test]
fn a_killed_run_ends_in_the_same_bytes() {
    let folder = data_set(6);
    let data = folder.path();
    fit::<SmokeTask>(&job(data, "whole", false), &mut Silent::default()).unwrap();

    let killed = data.join("killed");
    let mut kills = 0;
    while kills < KILLS {
        let before = lines(&killed.join("metrics.jsonl"));
        let mut child = start_child(data);
        // Let it get a few steps further, not always the same number, then pull the plug.
        while lines(&killed.join("metrics.jsonl")) < before + 2 + kills && child.try_wait().unwrap().is_none() {
            sleep(Duration::from_millis(5));
        }
        if child.try_wait().unwrap().is_some() {
            break;
        }
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
    }
    assert!(kills >= 2, "the run was too short to be killed twice");
    assert!(start_child(data).wait().unwrap().success());

    let read = |run: &str, file: &str| fs::read(data.join(run).join(file)).unwrap();
    assert!(read("whole", SmokeTask::MODEL_FILE) == read("killed", SmokeTask::MODEL_FILE), "the models differ");
    // Nothing is missing from the metrics and nothing is there twice; only the speeds differ.
    let losses = |run: &str| {
        let text = String::from_utf8(read(run, "metrics.jsonl")).unwrap();
        let value = |line: &str| serde_json::from_str::<serde_json::Value>(line).unwrap();
        text.lines().map(|line| (value(line)["step"].clone(), value(line)["loss"].clone())).collect::<Vec<_>>()
    };
    assert_eq!(losses("whole"), losses("killed"));
}

#[test]
fn a_run_that_ends_early_can_go_on_to_the_same_bytes() {
    let folder = data_set(6);
    let data = folder.path();
    let model = |out: &str| fs::read(data.join(out).join(SmokeTask::MODEL_FILE)).unwrap();
    let train = |job: &Job<SmokeRun>| fit::<SmokeTask>(job, &mut Silent::default()).unwrap();
    train(&job(data, "whole", false));

    let mut first = job(data, "short", false);
    first.run.train.max_steps = Some(5);
    train(&first);
    assert_eq!(lines(&data.join("short/metrics.jsonl")), 5);
    let early = model("short");
    // What is done stays done.
    train(&Job { resume: true, ..first });
    assert!(early == model("short") && early != model("whole"));
    train(&job(data, "short", true));
    assert!(model("short") == model("whole"), "the models differ");
}

#[test]
fn numbers_of_a_config_are_those_of_its_checkpoint_to_the_last_bit() {
    let folder = data_set(6);
    let data = folder.path();
    for learning_rate in [1e-30, 1.0 / 3.0e10, 5e-324] {
        let mut job = job(data, &format!("rate-{learning_rate:e}"), false);
        (job.run.train.epochs, job.run.train.learning_rate) = (1, learning_rate);
        fit::<SmokeTask>(&job, &mut Silent::default()).unwrap();
        fit::<SmokeTask>(&Job { resume: true, ..job }, &mut Silent::default()).unwrap();
    }
}
