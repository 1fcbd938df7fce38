//! Whole runs of a small `OFTNet`; its losses and its sampler against numbers computed independently; its two parts
//! against the whole.

use std::path::Path;

use crate::tiny::{camera, data_set};
use crate::whole_runs::{Changes, bears_empty_frames, goes_on, learnt, run_of};
use farsight_core::samplers::FeatureMap;
use farsight_graph::init::initial_weights;
use farsight_graph::model::{Model, NetworkConfig};
use farsight_graph::transform;
use farsight_methods::oftnet::grid::Grid;
use farsight_methods::oftnet::sampler::{STRIDES, boxes, sample};
use farsight_methods::oftnet::train::{OftNetRun, OftNetTask, OftNetTaskConfig, losses, sampled};
use farsight_methods::oftnet::{OftNetConfig, OftNetModel};
use farsight_onnx::{Facts, INPUT, OnnxModel, Target, write};
use farsight_runtime::{RtenRunner, Runner, Tensor as Map, TensorView};
use farsight_train::executor::{Mode, Network, Precision, values_from_tensor};
use tch::{Device, Kind, Tensor, no_grad};

/// Rounding in another order of sums.
const TOLERANCE: f32 = 1e-4;

fn small() -> OftNetConfig {
    OftNetConfig {
        input: [192, 64],
        width: 0.0625,
        blocks: 2,
        grid: Grid { cell_m: 2.0, columns: 14, rows: 12, plane_m: 1.6, slabs: 3, slab_m: 1.0, top_m: 2.0 },
        ..OftNetConfig::default()
    }
}

fn run(data: &Path) -> OftNetRun {
    run_of(small(), OftNetTaskConfig::default(), data)
}

#[test]
fn a_small_network_learns_a_small_set() {
    let folder = data_set(4);
    let ([first, last], model) = learnt::<OftNetTask>(run(folder.path()), 150, folder.path());
    assert!(last < 0.3 * first, "{first} to {last}");
    assert_eq!(model.config, small());
}

#[test]
fn a_run_that_goes_on_ends_in_the_same_bytes() {
    let folder = data_set(4);
    goes_on::<OftNetTask>(run(folder.path()), folder.path());
}

#[test]
fn frames_without_objects_are_learnt_from() {
    let folder = data_set(2);
    bears_empty_frames::<OftNetTask>(run(folder.path()), folder.path());
}

#[test]
fn what_cannot_be_is_told() {
    let table: Changes<OftNetRun> = &[
        (|run| run.task.near_factor = -1.0, "task.near_factor is -1; expected 0 or a positive number"),
        (|run| run.model.blocks = 0, "model.blocks is 0; expected 1 to 64"),
        (|run| run.model.grid.rows = 5000, "model.grid has 14 x 5000 cells; expected 1 to 1024 a side"),
        (|run| run.model.grid.cell_m = 0.0, "model.grid has cell_m 0; expected a positive number below 1000"),
    ];
    for (change, expected) in table {
        let mut run = run("unused".as_ref());
        change(&mut run);
        assert_eq!(run.problem().unwrap(), *expected);
    }
}

/// What `network` answers on the built-in engine.
fn on_rten(network: &transform::Network, model: &OftNetModel, input: &Map) -> Vec<Map> {
    let bytes = write(network, &Facts::new(model, Target::Portable), Target::Portable).unwrap();
    let mut runner = RtenRunner::new(OnnxModel::from_bytes(bytes, "x".as_ref()).unwrap(), Some(1)).unwrap();
    runner.run(&[(INPUT, TensorView { shape: &input.shape, values: &input.values })]).unwrap()
}

#[test]
fn two_parts_on_the_built_in_engine_answer_as_the_whole_on_libtorch() {
    let (config, [width, height]) = (small(), small().input);
    let model: OftNetModel = Model::new(config.clone(), initial_weights(&config.graph(), 3)).unwrap();
    let values: Vec<f32> = (0..3 * width * height).map(|i| (i as f32 * 0.37).sin()).collect();
    let boxes = boxes(&config.grid, &camera());

    let network = Network::new(model.graph.clone(), &model.weights, Device::Cpu, Precision::F32).unwrap();
    let input = Tensor::from_slice(&values).view([1, 3, height as i64, width as i64]);
    let wanted = [model.graph.tap("answer").unwrap()];
    let expected = no_grad(|| {
        let all = [boxes.clone()];
        let sampler = |_, maps: &[Tensor]| sampled(maps, &all, &config.grid);
        network.forward_through(&[input], &sampler, Mode::Evaluate, &wanted).remove(0)
    });

    let mut parts = transform::Network::new(&model).parts(OftNetConfig::OUTPUTS).into_iter();
    let (first, second) = (parts.next().unwrap(), parts.next().unwrap());
    assert!(parts.next().is_none());
    let maps = on_rten(&first, &model, &Map { shape: vec![1, 3, height, width], values });
    let views = [0, 1, 2].map(|place: usize| {
        let shape = [config.channels(), height / STRIDES[place], width / STRIDES[place]];
        assert_eq!(maps[place].shape[1..], shape);
        FeatureMap::new(&maps[place].values, shape).unwrap()
    });
    let mut features = Vec::new();
    sample(&mut features, views, &boxes, config.grid.slabs);
    let channels = 3 * config.grid.slabs * config.channels();
    let input = Map { shape: vec![1, channels, config.grid.rows, config.grid.columns], values: features };
    let found = on_rten(&second, &model, &input).remove(0);

    let expected_values = values_from_tensor(&expected);
    assert_eq!(found.shape, [1, 9, config.grid.rows, config.grid.columns]);
    let largest = expected_values.iter().fold(1.0, |largest: f32, value| largest.max(value.abs()));
    let off = found.values.iter().zip(&expected_values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(off <= TOLERANCE * largest, "{off} of {largest}");
    let spread = expected_values.iter().fold(f32::INFINITY, |least, value| least.min(*value));
    assert!(largest > 0.05 && spread < -0.05, "{spread} to {largest} prove little");
}

/// `scale sin(step k)` for `k` from 0.
fn waves(shape: &[i64], scale: f64, step: f64) -> Tensor {
    let count: i64 = shape.iter().product();
    (Tensor::arange(count, (Kind::Double, Device::Cpu)) * step).sin().view(shape) * scale
}

/// The constants are what `scripts/make_rival_goldens.py` prints, which has the formulas in numpy.
#[test]
fn losses_are_those_of_an_independent_computation() {
    let answer = waves(&[2, 18, 3, 4], 0.8, 0.53).set_requires_grad(true);
    let heatmap = waves(&[2, 2, 3, 4], 1.0, 0.91).abs().pow_tensor_scalar(4);
    let index = |[b, c, r, k]: [i64; 4]| ((b * 2 + c) * 3 + r) * 4 + k;
    let cells = Tensor::from_slice(&[[0, 1, 2, 3], [1, 0, 0, 0], [1, 1, 1, 2]].map(index));
    let expected = (Tensor::arange(24, (Kind::Double, Device::Cpu)) * 0.3).cos().view([3, 8]);
    let parts = losses(&answer, &heatmap, &cells, &expected, 100.0);
    let golden = [91.505_664_585_250, 0.409_621_064_229, 0.414_549_134_423, 0.272_566_624_372];
    for (part, golden) in parts.iter().zip(golden) {
        let found = part.double_value(&[]);
        assert!((found - golden).abs() < 1e-9, "{found}, not {golden}");
    }
    (&parts[0] + &parts[1] + &parts[2] + &parts[3]).backward();
    let along = (Tensor::arange(432, (Kind::Double, Device::Cpu))).cos().view([2, 18, 3, 4]);
    let slope = (answer.grad() * along).sum(Kind::Double).double_value(&[]);
    assert!((slope + 1.998_558_625).abs() < 1e-6, "{slope}");
}
