//! Whole runs of a small CenterNet for 3D boxes.

use std::path::Path;

use crate::tiny::data_set;
use crate::whole_runs::{bears_empty_frames, engines_agree, goes_on, learnt, run_of};
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_methods::centernet3d::CenterNet3dConfig;
use farsight_methods::centernet3d::train::{CenterNet3dRun, CenterNet3dTask, CenterNet3dTaskConfig};

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
    run_of(small(), CenterNet3dTaskConfig::default(), data)
}

#[test]
fn a_small_network_learns_a_small_set() {
    let folder = data_set(4);
    let ([first, last], model) = learnt::<CenterNet3dTask>(run(folder.path()), 60, folder.path());
    assert!(last < 0.3 * first, "{first} to {last}");
    assert_eq!(model.config, small());
}

#[test]
fn a_run_that_goes_on_ends_in_the_same_bytes() {
    let folder = data_set(4);
    goes_on::<CenterNet3dTask>(run(folder.path()), folder.path());
}

#[test]
fn frames_without_objects_are_learnt_from() {
    let folder = data_set(2);
    bears_empty_frames::<CenterNet3dTask>(run(folder.path()), folder.path());
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
        engines_agree(&CenterNet3dConfig { neck, ..small() }, small().input);
    }
}
