//! Whole runs of a small GS3D; its loss against an independent computation; its samples on tensors against the core's.

use std::path::Path;

use crate::tiny::{camera, car, data_set};
use crate::whole_runs::{Changes, bears_empty_frames, goes_on, learnt, run_of};
use farsight_core::samplers::FeatureMap;
use farsight_graph::layers::Backbone;
use farsight_methods::gs3d::Gs3dConfig;
use farsight_methods::gs3d::surfaces::{SAMPLES, SURFACES, nothing, points, sample};
use farsight_methods::gs3d::train::{Gs3dRun, Gs3dTask, Gs3dTaskConfig, refinement_loss, sampled};
use farsight_train::executor::values_from_tensor;
use tch::{Device, Kind, Tensor};

fn small() -> Gs3dConfig {
    Gs3dConfig {
        input: [192, 64],
        width: 0.25,
        backbone: Backbone::Dla34,
        surface_channels: 8,
        hidden: 32,
        ..Gs3dConfig::default()
    }
}

fn run(data: &Path) -> Gs3dRun {
    run_of(small(), Gs3dTaskConfig::default(), data)
}

#[test]
fn a_small_network_learns_a_small_set() {
    let folder = data_set(4);
    let ([first, last], model) = learnt::<Gs3dTask>(run(folder.path()), 60, folder.path());
    // What is neither right nor wrong, such as a box that is half as good as can be, always costs something.
    assert!(last < 0.4 * first, "{first} to {last}");
    assert_eq!(model.config, small());
}

#[test]
fn a_run_that_goes_on_ends_in_the_same_bytes() {
    let folder = data_set(4);
    goes_on::<Gs3dTask>(run(folder.path()), folder.path());
}

#[test]
fn frames_without_objects_are_learnt_from() {
    let folder = data_set(2);
    bears_empty_frames::<Gs3dTask>(run(folder.path()), folder.path());
}

/// Stages one after the other: the first alone, then the refinement on it as it is.
#[test]
fn the_second_stage_learns_on_a_first_one_that_stays() {
    let folder = data_set(4);
    let mut first = run(folder.path());
    first.task.refinement_weight = 0.0;
    let (_, model) = learnt::<Gs3dTask>(first, 2, folder.path());
    let path = folder.path().join("run/model.safetensors");
    let mut second = run(folder.path());
    second.train.start_from = Some(path);
    second.train.start_without = Some(vec!["refine.".to_owned(), "surfaces.".to_owned()]);
    second.train.freeze = vec!["backbone.".to_owned(), "heads.".to_owned()];
    let other = tempfile::tempdir().unwrap();
    let ([begun, ended], refined) = learnt::<Gs3dTask>(second.clone(), 30, other.path());
    assert!(ended < begun, "{begun} to {ended}");
    for (name, tensor) in &model.weights.tensors {
        let is_second = name.starts_with("refine.") || name.starts_with("surfaces.");
        assert!(is_second || refined.weights.tensors[name] == *tensor, "{name} moved");
    }
    // Without its first stage there is no second.
    second.train.start_from = Some(folder.path().join("nothing.safetensors"));
    let job = farsight_train::training::Job { run: second, out: other.path().join("none"), resume: false };
    let error = farsight_train::training::fit::<Gs3dTask>(&job, &mut crate::tiny::Silent::default()).unwrap_err();
    assert!(error.to_string().contains("nothing.safetensors"), "{error}");
}

#[test]
fn what_cannot_be_is_told() {
    let table: Changes<Gs3dRun> = &[
        (|run| run.task.size_weight = -1.0, "task.size_weight is -1; expected 0 or a positive number"),
        (|run| run.model.hidden = 0, "model.hidden is 0; expected 1 to 4096"),
        (|run| run.model.bin_widths[2] = 0.0, "model.bin_widths has 0; expected positive numbers below 100"),
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
    let camera = camera().transformed(&farsight_core::Affine2::scaling(0.25));
    let of = |frame: usize| {
        let label = car(frame);
        points(&label.box3d.projected(&camera).unwrap(), &label.box3d, &camera)
    };
    // Two objects, and one that is nowhere, in the second image; none in the first.
    let objects = [of(1), nothing(SURFACES * SAMPLES), of(3)];
    let found = sampled(&map, &[Vec::new(), objects.concat()]);
    let second = &values[channels * height * width..];
    let expected = sample(FeatureMap::new(second, [channels, height, width]).unwrap(), &objects);
    assert_eq!(found.size(), [3, (SURFACES * channels) as i64, 5, 5]);
    let found = values_from_tensor(&found);
    assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-5));
    assert!(found.iter().any(|value| value.abs() > 0.3), "zeros prove little");
}

/// The constants are what `scripts/make_rival_goldens.py` prints, which has the formula in numpy.
#[test]
fn the_loss_of_bins_is_that_of_an_independent_computation() {
    let waves =
        |step: f64, scale: f64| (Tensor::arange(147, (Kind::Double, Device::Cpu)) * step).sin().view([3, 49]) * scale;
    let logits = waves(0.37, 5.0).set_requires_grad(true);
    let target = waves(0.23, 1.0).clamp(0.0, 1.0);
    let loss = refinement_loss(&logits, &target, 3);
    loss.backward();
    let along = Tensor::arange(147, (Kind::Double, Device::Cpu)).cos().view([3, 49]);
    let slope = (logits.grad() * along).sum(Kind::Double).double_value(&[]);
    let value = loss.double_value(&[]);
    assert!((value - 81.157_079_104_823).abs() < 1e-9, "{value}");
    assert!((slope - 0.081_367_737).abs() < 1e-6, "{slope}");
    assert!(refinement_loss(&logits, &target, 0).double_value(&[]).abs() < 1e-12);
}
