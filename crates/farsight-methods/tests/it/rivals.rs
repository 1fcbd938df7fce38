//! The paper's rivals: sizes beside the published ones, and detections that say what the targets say.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::samplers::FeatureMap;
use farsight_core::{Box3d, Camera, Detection, Dimensions, Label, ObjectClass};
use farsight_graph::count::{StageCount, count};
use farsight_graph::graph::{Graph, Op};
use farsight_graph::layers::{Builder, NormKind, Resnet};
use farsight_graph::model::NetworkConfig;
use farsight_graph::transform::Network;
use farsight_graph::weights::Weights;
use farsight_methods::center_map::{CenterMethod, HEADING_BINS, raw_depth};
use farsight_methods::gs3d::Gs3dConfig;
use farsight_methods::gs3d::decode::{candidates, refined};
use farsight_methods::gs3d::targets::targets as targets_of_gs3d;
use farsight_methods::monodle::MonoDleConfig;
use farsight_methods::monodle::network::REGRESSION_HEADS;
use farsight_methods::monodle::targets::targets;
use farsight_methods::monogrnet::MonoGrNetConfig;
use farsight_methods::monogrnet::codec::{CORNER_REACH_M, START_DEPTH_M, local_corners};
use farsight_methods::monogrnet::decode::{cell_boxes, detection as monogrnet_detection, placed, shown};
use farsight_methods::monogrnet::targets::{CellClass, targets as targets_of_monogrnet};
use farsight_methods::oftnet::OftNetConfig;
use farsight_methods::oftnet::grid::Grid;
use farsight_methods::oftnet::network::ANSWERS;
use farsight_methods::oftnet::sampler::sample;
use farsight_onnx::{Facts, INPUT, OnnxModel, Target, key, write};
use farsight_runtime::{RtenRunner, Runner, TensorView};
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// Single precision of locations up to 60 m.
const LOCATION_M: f64 = 1e-3;

/// Parameters and multiply-accumulates of the stages that `of` picks.
fn cost(graph: &Graph, [width, height]: [usize; 2], of: impl Fn(&StageCount) -> bool) -> (usize, f64) {
    let stages = count(graph, width, height).unwrap();
    let picked = stages.iter().filter(|stage| of(stage));
    picked.fold((0, 0.0), |(parameters, gmacs), stage| (parameters + stage.parameters, gmacs + stage.macs as f64 / 1e9))
}

/// Neck 3.98 M parameters and 16.99 GMAC, heads 32.0 GMAC at 1280x384 (flagship spec 0.1 and 1.1, from the authors'
/// code).
#[test]
fn monodle_is_as_large_as_its_authors() {
    let config = MonoDleConfig::default();
    let graph = config.graph();
    let (neck, neck_gmacs) = cost(&graph, config.input, |stage| stage.stage == "dla_up");
    // Twelve 3x3 convolutions; norms; learnt enlargements.
    assert_eq!(neck, 3_981_312 + 2 * (2 * 256 + 4 * 128 + 6 * 64) + 16 * (256 + 2 * 128 + 3 * 64));
    // 0.03 of them are of the enlargements.
    assert!((neck_gmacs - 0.03 - 16.99).abs() < 0.01, "{neck_gmacs}");
    let (_, heads) = cost(&graph, config.input, |stage| MonoDleConfig::OUTPUTS.contains(&stage.stage));
    assert!((heads - 32.0).abs() < 0.1, "{heads}");
    assert!(!graph.parameters.iter().any(|parameter| parameter.name.contains("ida_up.")), "DLAUp alone");
}

/// Maps whose every cell is background, but for the cells of objects that say exactly what their targets are.
fn monodle_maps(config: &MonoDleConfig, labels: &[Label], camera: &Camera, log_variance: f64) -> Vec<Vec<f32>> {
    let targets = targets(labels, &config.classes, &config.heatmap, &config.codec(), camera, config.input);
    let [width, height] = targets.map_size;
    let area = width * height;
    // A target of 1 as a sure logit; the Gaussian around it stays below.
    let heatmap = targets.heatmap.iter().map(|value| 8.0 * value - 6.0).collect();
    let mut maps = vec![heatmap];
    maps.extend(REGRESSION_HEADS.map(|(_, channels)| vec![0.0; channels * area]));
    for object in &targets.objects {
        let cell = object.cell[1] * width + object.cell[0];
        let mut heading = [0.0; 2 * HEADING_BINS];
        (heading[object.heading.bin], heading[HEADING_BINS + object.heading.bin]) = (3.0, object.heading.residual);
        let said: [&[f64]; 6] = [
            &object.box_offset,
            &object.box_size,
            &[raw_depth(object.depth_m), log_variance],
            &object.center_offset,
            &object.dimensions_hwl,
            &heading,
        ];
        for (map, values) in maps[1..].iter_mut().zip(said) {
            values.iter().enumerate().for_each(|(channel, value)| map[channel * area + cell] = *value as f32);
        }
    }
    maps
}

fn label(location: [f64; 3], yaw: f64, camera: &Camera) -> Label {
    let box3d = Box3d { dimensions: Dimensions { height: 1.5, width: 1.7, length: 4.1 }, location, yaw };
    let box2d = box3d.projected(camera).unwrap().clamped(639.0, 191.0);
    Label { class: ObjectClass::Car, truncation: 0.0, occlusion: 0, alpha: box3d.alpha(), box2d, box3d }
}

#[test]
fn monodle_finds_what_its_targets_say_with_its_error_bar() {
    let config = MonoDleConfig { input: [640, 192], depth_focal_px: Some(371.8), ..MonoDleConfig::default() };
    // The network's input is the image at half its size.
    let camera = Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap();
    let view = config.input_spec().view([1280, 384], &camera);
    let input_camera = view.input_camera;
    let labels = [([-6.0, 1.7, 14.0], -1.2), ([2.0, 1.6, 27.0], 3.0), ([9.0, 1.8, 48.0], 0.4)]
        .map(|(l, y)| label(l, y, &input_camera));
    for certainty_in_score in [false, true] {
        let config = MonoDleConfig { certainty_in_score, ..config.clone() };
        let maps = monodle_maps(&config, &labels, &input_camera, 1.0);
        let channels = config.output_channels();
        let shapes: Vec<[usize; 3]> = channels.iter().map(|channels| [*channels, 48, 160]).collect();
        let views: Vec<TensorView<'_>> =
            maps.iter().zip(&shapes).map(|(values, shape)| TensorView { shape, values }).collect();
        let options = DecodeOptions { min_score: Some(0.05), ..DecodeOptions::default() };
        let found = config.detections(&views, &view, &options);
        assert_eq!(found.len(), labels.len(), "{found:?}");
        for label in &labels {
            let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < LOCATION_M);
            let twin = found.iter().find(|one| near(one.box3d.location, label.box3d.location)).unwrap();
            assert!((twin.box3d.yaw - label.box3d.yaw).abs() < 1e-4);
            assert!((twin.box3d.dimensions.length - 4.1).abs() < 1e-4);
            let box2d = View::input_height_px(&view, &twin.box2d);
            assert!((box2d - label.box2d.height()).abs() < 0.01, "{box2d}");
            // The variance e is of the virtual depth.
            let sigma_m = 0.5_f64.exp() * input_camera.focal_y() / 371.8;
            assert!((twin.range_sigma_m.unwrap() - sigma_m).abs() < 1e-5);
            let peak = 1.0 / (1.0 + (-2.0_f64).exp());
            let expected = if certainty_in_score {
                let tolerance_m = twin.box3d.depth_tolerance_m(0.7);
                peak * (1.0 - (-tolerance_m * std::f64::consts::SQRT_2 / sigma_m).exp())
            } else {
                peak
            };
            assert!((twin.score - expected).abs() < 1e-6, "{} and {expected}", twin.score);
        }
    }
}

/// The parts of other-systems spec 1 in millions of parameters (their sum is 22.27; the "about 22.6" beside them is
/// not), and 242 GMAC of the top-down network.
#[test]
fn oftnet_is_as_large_as_its_authors() {
    let config = OftNetConfig::default();
    let graph = config.graph();
    let (top_down, gmacs) = cost(&graph, config.input, |stage| stage.stage == "topdown");
    assert!((9_430_000..9_450_000).contains(&top_down), "{top_down}");
    assert!((gmacs - 242.0).abs() < 0.5, "{gmacs}");
    for (stage, millions) in
        [("base", 11.2), ("laterals", 0.23), ("transform", 1.38), ("topdown", 9.44), ("head", 0.02)]
    {
        let (found, _) = cost(&graph, config.input, |other| other.stage == stage);
        assert!((found as f64 / 1e6 - millions).abs() < 0.03, "{stage}: {found}");
    }
    // torchvision's without their classifiers of 513,000.
    let front = |backbone| {
        let graph = OftNetConfig { backbone, ..config.clone() }.graph();
        cost(&graph, config.input, |stage| stage.stage == "base").0
    };
    assert_eq!([front(Resnet::Resnet18), front(Resnet::Resnet34)], [11_689_512 - 513_000, 21_797_672 - 513_000]);
}

/// Maxima over windows that overlap and reach over the border, and some of the channels, on the built-in engine.
#[test]
fn windows_and_channels_are_those_that_were_asked_for() {
    let [channels, height, width] = [3, 7, 10];
    let mut b = Builder::new(NormKind::Batch);
    let input = b.input(channels);
    let pooled = b.map(Op::MaxPool { kernel: 3, stride: 2, padding: 1 }, input);
    b.tap("pooled", pooled);
    let some = b.narrow(input, 1, 2);
    b.tap("some", some);
    let graph = b.finish();
    assert_eq!(graph.shapes(width, height).unwrap()[1..], [[3, 4, 5], [2, 7, 10]]);
    let mut facts = Facts::default();
    for key in [key::MODEL, key::WEIGHTS_SHA256] {
        facts.set(key, "{}".to_owned());
    }
    let network = Network { graph, weights: Weights::default(), local_head: None };
    let bytes = write(&network, &facts, Target::Portable).unwrap();
    let mut runner = RtenRunner::new(OnnxModel::from_bytes(bytes, "x".as_ref()).unwrap(), Some(1)).unwrap();
    // All below zero, so that zeros beyond the border would show.
    let values: Vec<f32> = (0..channels * height * width).map(|k| (0.7 * k as f32).sin() - 2.0).collect();
    let shape = [1, channels, height, width];
    let found = runner.run(&[(INPUT, TensorView { shape: &shape, values: &values })]).unwrap();
    let at = |channel: usize, row: usize, column: usize| values[(channel * height + row) * width + column];
    let largest = |channel: usize, row: usize, column: usize| {
        let rows = (2 * row).saturating_sub(1)..(2 * row + 2).min(height);
        let columns = (2 * column).saturating_sub(1)..(2 * column + 2).min(width);
        let of_row = |row: usize| columns.clone().map(move |column| (row, column));
        rows.flat_map(of_row).map(|(row, column)| at(channel, row, column)).fold(f32::NEG_INFINITY, f32::max)
    };
    let expected: Vec<f32> = (0..60).map(|k| largest(k / 20, k / 5 % 4, k % 5)).collect();
    assert_eq!(found[0].values, expected);
    assert_eq!(found[1].values, values[height * width..]);
}

/// The constants are what `scripts/make_rival_goldens.py` prints: means over the box around the projected corners of a
/// voxel, cell by cell.
#[test]
fn voxels_hold_the_means_of_what_they_are_seen_as() {
    let grid = Grid { cell_m: 2.0, columns: 4, rows: 5, plane_m: 1.7, slabs: 2, slab_m: 1.0, top_m: 2.0 };
    let camera = Camera::from_intrinsics(12.0, 12.0, 4.0, 1.5).unwrap();
    let values: Vec<f32> = (0..45).map(|k| (0.61 * f64::from(k)).sin() as f32).collect();
    let negative: Vec<f32> = values.iter().map(|value| -value).collect();
    let two = [values, negative].concat();
    let map = || FeatureMap::new(&two, [2, 5, 9]).unwrap();
    let boxes = [grid.voxel_boxes(&camera), grid.voxel_boxes(&camera), grid.voxel_boxes(&camera)];
    let mut features = vec![7.0];
    sample(&mut features, [map(), map(), map()], &boxes, grid.slabs);
    assert_eq!(features.len(), 1 + 3 * 2 * 2 * grid.cells());
    let golden = [
        ([0, 0, 1], 0.0),
        ([0, 1, 0], 0.0),
        ([0, 1, 2], 0.296_960_452_347),
        ([0, 4, 3], -0.012_748_007_163),
        ([1, 1, 1], -0.611_649_695_526),
        ([1, 2, 3], 0.843_483_268_414),
        ([1, 4, 0], -0.667_065_172_311),
    ];
    for ([slab, row, column], expected) in golden {
        for of_map in 0..3 {
            for (channel, sign) in [(0, 1.0), (1, -1.0)] {
                let plane = (of_map * grid.slabs + slab) * 2 + channel;
                let found = f64::from(features[1 + plane * grid.cells() + row * grid.columns + column]);
                assert!((found - sign * expected).abs() < 1e-6, "{slab} {row} {column}: {found}, not {expected}");
            }
        }
    }
}

#[test]
fn oftnet_finds_what_its_targets_say() {
    use farsight_methods::oftnet::{decode::detections, targets::targets};
    let config =
        OftNetConfig { input: [640, 192], classes: farsight_core::ClassReference::smoke(), ..OftNetConfig::default() };
    let camera = Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap();
    let view = config.input_spec().view([1280, 384], &camera);
    let labels = [([-6.1, 1.7, 14.2], -1.2), ([2.3, 1.6, 27.9], 3.0), ([9.0, 1.8, 48.4], 0.4)]
        .map(|(location, yaw)| label(location, yaw, &view.input_camera));
    let grid = &config.grid;
    let targets = targets(&labels, &config.codec());
    let mut answer = vec![0.0; config.classes.len() * ANSWERS * grid.cells()];
    for (class, heat) in targets.heatmap.chunks_exact(grid.cells()).enumerate() {
        answer[class * ANSWERS * grid.cells()..][..grid.cells()].copy_from_slice(heat);
    }
    for (class, [column, row], encoded) in &targets.cells {
        let values = encoded.place.iter().chain(&encoded.size).chain(&encoded.cos_sin);
        for (channel, value) in values.enumerate() {
            let plane = class * ANSWERS + 1 + channel;
            answer[plane * grid.cells() + row * grid.columns + column] = *value as f32;
        }
    }
    let shape = [config.classes.len() * ANSWERS, grid.rows, grid.columns];
    let answer = TensorView { shape: &shape, values: &answer };
    let found =
        detections(&config, &answer, &view, &DecodeOptions { min_score: Some(0.05), ..DecodeOptions::default() });
    assert_eq!(found.len(), labels.len(), "{found:?}");
    for label in &labels {
        let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < LOCATION_M);
        let twin = found.iter().find(|one| near(one.box3d.location, label.box3d.location)).unwrap();
        assert!((twin.box3d.yaw - label.box3d.yaw).abs() < 1e-4 && twin.class == ObjectClass::Car);
        assert!((twin.box3d.dimensions.length - 4.1).abs() < 1e-4);
        // Within a cell's half diagonal of the place, the Gaussian is above this.
        assert!(twin.score > (-0.125_f64).exp() - 1e-3, "{}", twin.score);
    }
}

/// torchvision's `vgg16_bn` without its classifier: 14,723,136 parameters.
#[test]
fn vgg_is_as_large_as_torchvisions() {
    let config = Gs3dConfig::default();
    let (found, _) = cost(&config.graph(), config.input, |stage| stage.stage == "base");
    assert_eq!(found, 14_723_136);
}

#[test]
fn gs3d_refines_its_guidances_to_what_its_targets_say() {
    let config = Gs3dConfig { input: [640, 192], ..Gs3dConfig::default() };
    let camera = Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap();
    let view = config.input_spec().view([1280, 384], &camera);
    let labels = [([-6.1, 1.7, 14.2], -1.2), ([2.3, 1.6, 27.9], 3.0), ([9.0, 1.8, 48.4], 0.4)]
        .map(|(location, yaw)| label(location, yaw, &view.input_camera));
    let targets = targets_of_gs3d(&labels, &config, &view.input_camera, config.input, &mut Pcg64::seed_from_u64(3));
    assert_eq!(targets.candidates.len(), 3 * labels.len());
    let ([width, height], area) = (targets.map_size, targets.map_size[0] * targets.map_size[1]);
    let heatmap: Vec<f32> = targets.heatmap.iter().map(|value| 8.0 * value - 6.0).collect();
    let mut maps = [2, 2, 2 * HEADING_BINS].map(|channels| vec![0.0_f32; channels * area]);
    for object in &targets.objects {
        let cell = object.cell[1] * width + object.cell[0];
        let mut heading = [0.0; 2 * HEADING_BINS];
        (heading[object.heading.bin], heading[HEADING_BINS + object.heading.bin]) = (3.0, object.heading.residual);
        let said: [&[f64]; 3] = [&object.offset, &object.size, &heading];
        for (map, values) in maps.iter_mut().zip(said) {
            values.iter().enumerate().for_each(|(channel, value)| map[channel * area + cell] = *value as f32);
        }
    }
    let shapes = [config.classes.len(), 2, 2, 2 * HEADING_BINS].map(|channels| [channels, height, width]);
    let views: Vec<TensorView<'_>> =
        [&heatmap].into_iter().chain(&maps).zip(&shapes).map(|(values, shape)| TensorView { shape, values }).collect();
    let options = DecodeOptions { min_score: Some(0.05), ..DecodeOptions::default() };
    let found = candidates(&config, [&views[0], &views[1], &views[2], &views[3]], &view, &options);
    assert_eq!(found.len(), labels.len(), "{found:?}");
    for label in &labels {
        let near = |one: &&(Detection, _)| (one.0.box3d.depth_m() - label.box3d.depth_m()).abs() < 5.0;
        let (guidance, _) = found.iter().find(near).unwrap();
        // As many pixels as the labelled box has.
        assert!((view.input_height_px(&guidance.box2d) - label.box2d.height()).abs() < 0.01);
        let refinement = config.refinement();
        let bins = refinement.encode(&guidance.box3d, &label.box3d);
        let mut logits = [-4.0_f32; 49];
        for (number, bin) in bins.iter().enumerate() {
            logits[7 * number + bin.unwrap()] = 4.0;
        }
        let found = refined(&config, guidance, &logits).unwrap();
        let off = |axis: usize| (found.box3d.location[axis] - label.box3d.location[axis]).abs();
        for axis in 0..3 {
            assert!(off(axis) <= config.bin_widths[axis] / 2.0 + 1e-6, "{axis}: {}", off(axis));
        }
        let probability = 1.0 / (1.0 + (-4.0_f64).exp());
        assert!((found.score - guidance.score * probability).abs() < 1e-6);
    }
    // Of the three candidates of an object the first is its own box, the last is background or nearly so.
    let best = |candidate: usize| targets.candidates[candidate].target.iter().copied().fold(0.0, f32::max);
    assert!((0..3).all(|object| best(3 * object) >= best(3 * object + 2)));
}

/// Cells that say what their targets say, boxes that need no step, and corners that need none either.
#[test]
fn monogrnet_finds_what_its_targets_say() {
    let config = MonoGrNetConfig { input: [640, 192], depth_focal_px: Some(500.0), ..MonoGrNetConfig::default() };
    let camera = Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap();
    let view = config.input_spec().view([1280, 384], &camera);
    let labels = [([-6.1, 1.7, 14.2], -1.2), ([2.3, 1.6, 27.9], 3.0), ([12.0, 1.8, 48.4], 0.4)]
        .map(|(location, yaw)| label(location, yaw, &view.input_camera));
    let targets =
        targets_of_monogrnet(&labels, &config, &view.input_camera, config.input, &mut Pcg64::seed_from_u64(3));
    let ([columns, rows], area) = (targets.grid, targets.grid[0] * targets.grid[1]);
    let mut maps = [6, 1, 2].map(|channels| vec![0.0_f32; channels * area]);
    for (at, class) in targets.cells.iter().enumerate() {
        maps[0][at] = if matches!(class, CellClass::Object(_)) { -4.0 } else { 4.0 };
    }
    for object in &targets.objects {
        let at = object.cell[1] * columns + object.cell[0];
        let numbers = [(0, 2, &object.box2d[..]), (1, 0, &[object.depth_m - START_DEPTH_M]), (2, 0, &object.center)];
        for (map, first, values) in numbers {
            values.iter().enumerate().for_each(|(k, value)| maps[map][(first + k) * area + at] = *value as f32);
        }
    }
    let shapes = [6, 1, 2].map(|channels| [channels, rows, columns]);
    let [cells, depth, center] = [0, 1, 2].map(|map| TensorView { shape: &shapes[map], values: &maps[map] });
    let options = DecodeOptions { min_score: Some(0.3), ..DecodeOptions::default() };
    let found = cell_boxes(&config, [&cells, &depth, &center], &options);
    assert_eq!(found.len(), targets.objects.len(), "{found:?}");
    let mut all = Vec::new();
    for one in &found {
        let label = labels.iter().find(|label| {
            let scale = config.codec().virtual_depth(1.0, &view.input_camera);
            (one.depth_m - scale * label.box3d.depth_m()).abs() < 1e-3
        });
        let corners = local_corners(&label.unwrap().box3d);
        let raw: Vec<f32> =
            corners.as_flattened().iter().map(|value| (value / CORNER_REACH_M).atanh() as f32).collect();
        let rezoom = [-3.0, 3.0, 0.0, 0.0, 0.0, 0.0];
        let placed = placed(&config, one, [&rezoom, &[0.0], &[0.0; 2], &raw], &view.input_camera).unwrap();
        all.extend(monogrnet_detection(&config, &placed, &[0.0; 24], &view));
    }
    let all = shown(&config, all, &options);
    assert_eq!(all.len(), labels.len(), "several cells find one object: {all:?}");
    for label in &labels {
        let near = |one: &&Detection| (one.box3d.depth_m() - label.box3d.depth_m()).abs() < 1.0;
        let one = all.iter().find(near).unwrap();
        let off = one.box3d.location.iter().zip(label.box3d.location).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < LOCATION_M, "{off} m");
        let (size, truth) = (one.box3d.dimensions, label.box3d.dimensions);
        assert!((size.length - truth.length).abs() + (size.height - truth.height).abs() < LOCATION_M);
        assert!(farsight_core::wrapped_angle(one.box3d.yaw - label.box3d.yaw).abs() < 1e-4);
        assert!((one.score - 1.0 / (1.0 + (-6.0_f64).exp())).abs() < 1e-6);
        assert!((view.input_height_px(&one.box2d) - label.box2d.height()).abs() < 0.01);
    }
}

/// The authors' heads on VGG-16: 39x12 cells of 32 pixels.
#[test]
fn monogrnet_has_its_authors_grid_and_backbone() {
    let config = MonoGrNetConfig::default();
    let graph = config.graph();
    let (base, _) = cost(&graph, config.input, |stage| stage.stage == "base");
    assert_eq!(base, 14_723_136, "torchvision's vgg16_bn without its classifier");
    let shapes = graph.shapes(config.input[0], config.input[1]).unwrap();
    assert_eq!(shapes[graph.tap("cells").unwrap()], [6, 12, 39]);
    assert_eq!(shapes[graph.tap("box_map").unwrap()], [512, 48, 156]);
    assert_eq!(shapes[graph.tap("corners").unwrap()], [24, 1, 1]);
    let parts = Network { weights: Weights::default(), graph, local_head: None }.parts(MonoGrNetConfig::OUTPUTS);
    let taps = |part: &Network| part.graph.taps.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    assert_eq!(parts.len(), 3);
    assert_eq!(taps(&parts[0]), ["cells", "depth", "center", "box_map", "corner_map"]);
    assert_eq!(taps(&parts[1]), ["rezoom", "depth_step", "center_step", "corners"]);
    assert_eq!(taps(&parts[2]), ["corner_steps"]);
    for part in &parts {
        assert!(part.graph.nodes.iter().all(|node| !matches!(node.op, Op::Sampler { .. })));
        assert!(part.graph.nodes.iter().skip(1).all(|node| node.op != Op::Input), "one input each");
    }
}
