//! Whole runs of a small `MonoDLE`, and its losses against numbers computed independently.

use std::path::Path;

use crate::tiny::data_set;
use crate::whole_runs::{Changes, bears_empty_frames, engines_agree, goes_on, learnt, run_of};
use farsight_methods::center_map::train::heading_loss;
use farsight_methods::monodle::MonoDleConfig;
use farsight_methods::monodle::train::{MonoDleRun, MonoDleTask, MonoDleTaskConfig, depth_loss, dimensions_loss};
use tch::{Kind, Tensor};

/// Double precision, and central differences of it.
const VALUES: f64 = 1e-9;
const SLOPES: f64 = 1e-6;

fn small() -> MonoDleConfig {
    MonoDleConfig { input: [192, 64], width: 0.25, ..MonoDleConfig::default() }
}

fn run(data: &Path) -> MonoDleRun {
    // Cars of the small set are as low as 12 pixels.
    run_of(small(), MonoDleTaskConfig { min_height_px: 8.0, ..MonoDleTaskConfig::default() }, data)
}

#[test]
fn a_small_network_learns_a_small_set() {
    let folder = data_set(4);
    let ([first, last], model) = learnt::<MonoDleTask>(run(folder.path()), 60, folder.path());
    assert!(last < 0.3 * first, "{first} to {last}");
    assert_eq!(model.config, small());
}

#[test]
fn a_run_that_goes_on_ends_in_the_same_bytes() {
    let folder = data_set(4);
    goes_on::<MonoDleTask>(run(folder.path()), folder.path());
}

#[test]
fn frames_without_objects_are_learnt_from() {
    let folder = data_set(2);
    bears_empty_frames::<MonoDleTask>(run(folder.path()), folder.path());
}

#[test]
fn objects_that_do_not_count_are_background() {
    // None of the cars is that high, so that a run from the same weights sees only background.
    let folder = data_set(2);
    let mut run = run(folder.path());
    run.task.min_height_px = 64.0;
    let ([first, _], _) = learnt::<MonoDleTask>(run.clone(), 1, folder.path());
    let empty = data_set(2);
    run.data.root = Some(empty.path().to_path_buf());
    for frame in 0..2 {
        std::fs::write(empty.path().join(format!("training/label_2/{frame:06}.txt")), "").unwrap();
    }
    let ([expected, _], _) = learnt::<MonoDleTask>(run, 1, empty.path());
    assert!((first - expected).abs() < 1e-9, "{first}, not {expected}");
}

#[test]
fn what_cannot_be_is_told() {
    let table: Changes<MonoDleTaskConfig> = &[
        (|task| task.heading_weight = -1.0, "task.heading_weight is -1; expected 0 or a positive number"),
        (|task| task.depth_range_m = [9.0, 2.0], "task.depth_range_m is 9 to 2; expected 0 <= least < most"),
    ];
    for (change, expected) in table {
        let mut run = run("unused".as_ref());
        change(&mut run.task);
        assert_eq!(run.problem().unwrap(), *expected);
    }
}

#[test]
fn the_built_in_engine_answers_as_libtorch_does() {
    engines_agree(&small(), small().input);
}

/// `scale sin(step k + shift)` for `k` from 0.
fn waves(shape: &[i64], scale: f64, step: f64, shift: f64) -> Tensor {
    let count: i64 = shape.iter().product();
    (Tensor::arange(count, (Kind::Double, tch::Device::Cpu)) * step + shift).sin().view(shape) * scale
}

/// Value of a loss, and its gradient at `found` along the cosines of the indices.
fn value_and_slope(found: &Tensor, loss: impl Fn(&Tensor) -> Tensor) -> [f64; 2] {
    let found = found.detach().set_requires_grad(true);
    let value = loss(&found);
    value.backward();
    let along = waves(&found.size(), 1.0, 1.0, std::f64::consts::FRAC_PI_2);
    [value.double_value(&[]), (found.grad() * along).sum(Kind::Double).double_value(&[])]
}

fn assert_golden(name: &str, [value, slope]: [f64; 2], [expected, expected_slope]: [f64; 2]) {
    assert!((value - expected).abs() < VALUES, "{name}: {value}, not {expected}");
    assert!((slope - expected_slope).abs() < SLOPES, "{name}: slope {slope}, not {expected_slope}");
}

/// The constants are what `scripts/make_rival_goldens.py` prints, which has the formulas in numpy.
#[test]
fn losses_are_those_of_an_independent_computation() {
    let objects = || Tensor::arange(5, (Kind::Double, tch::Device::Cpu));
    let raw = (objects() * 0.7 + 0.3).sin() * 2.0 - 3.0;
    let log_variance = (objects() * 1.1).cos() * 1.5;
    let depth_m = (objects() * 7.0 + 5.0).view([5, 1]);
    let found = Tensor::stack(&[raw, log_variance], 1);
    let depth = value_and_slope(&found, |found| depth_loss(found, &depth_m));
    assert_golden("depth", depth, [27.065_402_467_983, -3.325_151_680]);

    let sizes = waves(&[5, 3], 1.0, 0.9, 0.0).abs() * 3.0 + 1.0;
    let found = &sizes + waves(&[5, 3], 0.4, 2.3, 1.0);
    let dimensions = value_and_slope(&found, |found| dimensions_loss(found, &sizes));
    assert_golden("dimensions", dimensions, [0.255_838_298_892, 0.003_297_658]);

    let found = waves(&[5, 24], 1.0, 0.37, 0.0);
    let bins = Tensor::from_slice(&[2_i64, 7, 0, 5, 10]);
    let residual = (objects().sin() * 0.2).view([5, 1]);
    let heading = value_and_slope(&found, |found| heading_loss(found, &bins, &residual));
    assert_golden("heading", heading, [3.320_340_468_949, 0.010_272_468]);
}

#[test]
fn sizes_that_are_right_have_no_loss_and_a_finite_gradient() {
    let sizes = Tensor::from_slice(&[1.5, 1.6, 3.9]).view([1, 3]);
    let [value, slope] = value_and_slope(&sizes, |found| dimensions_loss(found, &sizes));
    assert!(value.abs() < 1e-12 && slope.abs() < 1e-12, "{value} {slope}");
}
