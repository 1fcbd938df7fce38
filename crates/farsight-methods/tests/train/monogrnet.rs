//! Whole runs of a small `MonoGRNet`; its loss against an independent computation; its samples on tensors against the
//! core's.

use std::path::Path;

use crate::tiny::data_set;
use crate::whole_runs::{Changes, bears_empty_frames, goes_on, learnt, run_of};
use farsight_core::Box2d;
use farsight_core::samplers::FeatureMap;
use farsight_graph::layers::Backbone;
use farsight_methods::detector_task::DetectorLoss;
use farsight_methods::monogrnet::MonoGrNetConfig;
use farsight_methods::monogrnet::sampler::{on_map, sample};
use farsight_methods::monogrnet::targets::{BoxObject, BoxTarget, CellClass, CellTarget, CornerTarget, Targets};
use farsight_methods::monogrnet::train::sampled;
use farsight_methods::monogrnet::train::{Expected, MonoGrNetLoss, MonoGrNetRun, MonoGrNetTask, MonoGrNetTaskConfig};
use farsight_train::executor::values_from_tensor;
use farsight_train::metrics::Metrics;
use tch::{Device, Kind, Tensor};

fn small() -> MonoGrNetConfig {
    MonoGrNetConfig { input: [192, 64], width: 0.125, backbone: Backbone::Resnet18, ..MonoGrNetConfig::default() }
}

fn run(data: &Path) -> MonoGrNetRun {
    run_of(small(), MonoGrNetTaskConfig::default(), data)
}

#[test]
fn a_small_network_learns_a_small_set() {
    let folder = data_set(4);
    let ([first, last], model) = learnt::<MonoGrNetTask>(run(folder.path()), 60, folder.path());
    assert!(last < 0.4 * first, "{first} to {last}");
    assert_eq!(model.config, small());
}

#[test]
fn a_run_that_goes_on_ends_in_the_same_bytes() {
    let folder = data_set(4);
    goes_on::<MonoGrNetTask>(run(folder.path()), folder.path());
}

#[test]
fn frames_without_objects_are_learnt_from() {
    let folder = data_set(2);
    bears_empty_frames::<MonoGrNetTask>(run(folder.path()), folder.path());
}

/// Parts one after the other, as the authors train: cells alone, then the rest on them as they are.
#[test]
fn later_parts_learn_on_a_first_one_that_stays() {
    let folder = data_set(4);
    let mut first = run(folder.path());
    (first.task.depth_weight, first.task.center_weight) = (0.0, 0.0);
    (first.task.corner_weight, first.task.refinement_weight) = (0.0, 0.0);
    let (_, model) = learnt::<MonoGrNetTask>(first, 2, folder.path());
    let mut second = run(folder.path());
    second.train.start_from = Some(folder.path().join("run/model.safetensors"));
    let anew =
        ["depth.", "center.", "corners.", "boxes.depth_step.", "boxes.center_step.", "boxes.corners.", "refine."];
    second.train.start_without = Some(anew.map(str::to_owned).to_vec());
    second.train.freeze = vec!["backbone.".to_owned(), "cells.".to_owned()];
    let other = tempfile::tempdir().unwrap();
    let ([begun, ended], later) = learnt::<MonoGrNetTask>(second, 20, other.path());
    assert!(ended < begun, "{begun} to {ended}");
    for (name, tensor) in &model.weights.tensors {
        let stays = name.starts_with("backbone.") || name.starts_with("cells.");
        assert_eq!(stays, later.weights.tensors[name] == *tensor, "{name}");
    }
}

#[test]
fn what_cannot_be_is_told() {
    let table: Changes<MonoGrNetRun> = &[
        (|run| run.task.corner_weight = -1.0, "task.corner_weight is -1; expected 0 or a positive number"),
        (|run| run.model.depth_focal_px = Some(0.0), "model.depth_focal_px is 0; expected a positive number of pixels"),
        (|run| run.model.input = [200, 64], "model.input is 200x64; expected multiples of 32 pixels, at most 8192"),
    ];
    for (change, expected) in table {
        let mut run = run("unused".as_ref());
        change(&mut run);
        assert_eq!(run.problem().unwrap(), *expected);
    }
}

#[test]
fn samples_on_tensors_are_those_of_the_core() {
    let (channels, height, width) = (3, 16, 48);
    let values: Vec<f32> = (0..2 * channels * height * width).map(|k| (0.37 * k as f32).sin()).collect();
    let map = Tensor::from_slice(&values).view([2, channels as i64, height as i64, width as i64]);
    // One reaches beyond the map; none in the first image.
    let boxes = [Box2d::new(1.2, 0.4, 5.9, 3.1), Box2d::new(9.0, 1.0, 14.0, 5.0)];
    let found = sampled(&map, &[Vec::new(), boxes.iter().map(on_map).collect()]);
    let second = &values[channels * height * width..];
    let expected = sample(FeatureMap::new(second, [channels, height, width]).unwrap(), &boxes);
    assert_eq!(found.size(), [2, channels as i64, 16, 16]);
    let found = values_from_tensor(&found);
    assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-5));
    assert!(found.iter().any(|value| value.abs() > 0.3), "zeros prove little");
}

/// Two cells with objects, one that may say anything; three boxes of which one is background.
fn by_hand() -> Targets {
    let wave = |step: f64| move |k: usize| (step * k as f64).sin();
    let object = |seed: f64| BoxObject {
        class: 0,
        step: std::array::from_fn(wave(0.3 + seed)),
        depth_m: 30.0 + seed,
        center: std::array::from_fn(wave(0.5 + seed)),
        corners: std::array::from_fn(wave(0.7 + seed)),
    };
    let cell = |cell, seed: f64| CellTarget {
        cell,
        box2d: std::array::from_fn(wave(1.1 + seed)),
        depth_m: 20.0 + 5.0 * seed,
        center: std::array::from_fn(wave(1.3 + seed)),
    };
    let area = Box2d::new(0.0, 0.0, 1.0, 1.0);
    let mut cells = vec![CellClass::Background; 6];
    (cells[1], cells[3], cells[5]) = (CellClass::Object(0), CellClass::Ignored, CellClass::Object(0));
    Targets {
        grid: [3, 2],
        cells,
        objects: vec![cell([1, 0], 0.1), cell([2, 1], 0.2)],
        boxes: vec![
            BoxTarget { cell: [1, 0], box2d: area, object: Some(object(0.01)) },
            BoxTarget { cell: [1, 0], box2d: area, object: None },
            BoxTarget { cell: [2, 1], box2d: area, object: Some(object(0.02)) },
        ],
        corners: vec![CornerTarget { seen: area, steps: std::array::from_fn(wave(0.9)) }; 2],
    }
}

/// The constants are what `scripts/make_rival_goldens.py` prints, which has the formulas in numpy.
#[test]
fn the_loss_is_that_of_an_independent_computation() {
    let loss = MonoGrNetLoss::new(&run("unused".as_ref()));
    let expected = Expected::new(&[&by_hand()], Device::Cpu);
    let wave = |step: f64, shape: &[i64]| {
        let count = shape.iter().product::<i64>();
        (Tensor::arange(count, (Kind::Double, Device::Cpu)) * step).sin().view(shape).to_kind(Kind::Float)
    };
    let outputs = [
        wave(0.37, &[1, 6, 2, 3]),
        wave(0.41, &[1, 1, 2, 3]),
        wave(0.43, &[1, 2, 2, 3]),
        wave(0.47, &[3, 6, 1, 1]),
        wave(0.53, &[3, 1, 1, 1]),
        wave(0.59, &[3, 2, 1, 1]),
        wave(0.61, &[3, 24, 1, 1]),
        wave(0.67, &[2, 24, 1, 1]),
    ];
    let (objective, terms) = loss.loss(&outputs, &expected);
    let values =
        [0.875_520_108, 0.061_462_829, 8.828_822_259, 1.892_306_449, 0.088_679_329, 0.883_516_505, 0.563_321_387];
    for ((name, found), expected) in terms.named().into_iter().zip(values) {
        assert!((found - expected).abs() < 1e-5 * expected.abs().max(1.0), "{name}: {found}, not {expected}");
    }
    let sum: f64 = values.iter().sum();
    assert!((objective.double_value(&[]) - sum).abs() < 1e-4, "{sum}");
}
