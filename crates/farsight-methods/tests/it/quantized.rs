//! Networks in 8 bits on rten: against whole numbers computed here, and against the same networks in float.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use farsight_core::Camera;
use farsight_graph::graph::{Graph, Init, Node, NodeId, Op, Parameter, ParameterId, Role, Window};
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{Msfe, NeckKind, NormKind};
use farsight_graph::model::NetworkConfig;
use farsight_graph::quantize::{Observer, Quantization, QuantizedWeights, Range, WeightRange, layers, maps};
use farsight_graph::transform::Network;
use farsight_graph::weights::{WeightTensor, Weights};
use farsight_methods::smoke::SmokeConfig;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::network::Backbone;
use farsight_methods::smoke::sensitivity::Answers;
use farsight_methods::smoke::{DetectorFile, HeadMaps, LOGITS, REGRESSION, SparseHead};
use farsight_onnx::{Facts, LocalHeadFile, OnnxModel, Target, write, write_quantized};
use farsight_runtime::{Calibration, RtenRunner, TensorView, probe};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::support::head_maps;

const OBSERVERS: [Observer; 3] = [Observer::MinMax, Observer::Percentile(99.99), Observer::MeanSquare];

fn small(norm: NormKind, neck: NeckKind, msfe: Msfe) -> SmokeModel {
    small_on(Backbone::Dla34, norm, neck, msfe)
}

fn small_on(backbone: Backbone, norm: NormKind, neck: NeckKind, msfe: Msfe) -> SmokeModel {
    let config = SmokeConfig { input: [128, 64], width: 0.25, backbone, norm, neck, msfe, ..SmokeConfig::default() };
    let weights = initial_weights(&config.graph(), 5);
    SmokeModel::new(config, weights).unwrap()
}

fn facts() -> Facts {
    DetectorFile::facts(&small(NormKind::Batch, NeckKind::Plain, Msfe::None), Target::Portable)
}

fn file(network: &Network, quantization: Option<&Quantization>, facts: &Facts) -> OnnxModel {
    file_for(Target::Portable, network, quantization, facts)
}

fn file_for(target: Target, network: &Network, quantization: Option<&Quantization>, facts: &Facts) -> OnnxModel {
    let bytes = match quantization {
        Some(quantization) => write_quantized(network, quantization, facts, target),
        None => write(network, facts, target),
    };
    OnnxModel::from_bytes(bytes.unwrap(), Path::new("in memory")).unwrap()
}

fn detector_file(file: OnnxModel) -> DetectorFile {
    DetectorFile::from_onnx(file, Path::new("in memory")).unwrap()
}

fn answer(file: OnnxModel, input: &[f32], size: [usize; 2]) -> HeadMaps {
    head_maps(&mut RtenRunner::new(file, Some(1)).unwrap(), input, size)
}

/// A graph in the making.
#[derive(Default)]
struct Sketch {
    graph: Graph,
    weights: Weights,
}

impl Sketch {
    fn node(&mut self, op: Op, inputs: &[NodeId], channels: usize) -> NodeId {
        self.graph.nodes.push(Node { op, inputs: inputs.to_vec(), channels, stage: "test" });
        self.graph.nodes.len() - 1
    }

    fn parameter(&mut self, name: &str, shape: &[usize], rng: &mut Pcg64Mcg) -> ParameterId {
        let values = (0..shape.iter().product()).map(|_| rng.random_range(-0.5..0.5)).collect();
        self.weights.tensors.insert(name.to_owned(), WeightTensor::new(shape.to_vec(), values).unwrap());
        let (name, shape) = (name.to_owned(), shape.to_vec());
        self.graph.parameters.push(Parameter {
            name,
            shape,
            init: Init::Constant(0.0),
            role: Role::Learnt,
            stage: "test",
        });
        self.graph.parameters.len() - 1
    }

    fn conv(&mut self, x: NodeId, name: &str, channels: usize, kernel: usize, rng: &mut Pcg64Mcg) -> NodeId {
        let shape = [channels, self.graph.nodes[x].channels, kernel, kernel];
        let weight = self.parameter(&format!("{name}.weight"), &shape, rng);
        let bias = Some(self.parameter(&format!("{name}.bias"), &[channels], rng));
        self.node(Op::Conv { weight, bias, window: Window::same(kernel, 1), groups: 1 }, &[x], channels)
    }

    fn finish(mut self, logits: NodeId, regression: NodeId) -> Network {
        self.graph.taps = vec![(LOGITS.to_owned(), logits), (REGRESSION.to_owned(), regression)];
        Network { graph: self.graph, weights: self.weights, local_head: Some(REGRESSION) }
    }
}

/// The steps of a convolution of 8-bit `x` with zero point `zero`, in whole numbers; outside the map is zero.
fn whole_conv(x: &[u8], zero: u8, [width, height]: [usize; 2], weights: &QuantizedWeights, kernel: usize) -> Vec<i32> {
    let channels = x.len() / width / height;
    let rows = weights.values.chunks_exact(channels * kernel * kernel);
    let mut sums = Vec::new();
    for (row, bias) in rows.zip(&weights.bias) {
        for at in 0..width * height {
            let mut sum = *bias;
            for (tap, weight) in row.iter().enumerate() {
                let (channel, ky, kx) = (tap / kernel / kernel, tap / kernel % kernel, tap % kernel);
                let y = (at / width + ky).checked_sub(kernel / 2).filter(|y| *y < height);
                let x_ = (at % width + kx).checked_sub(kernel / 2).filter(|x| *x < width);
                if let (Some(y), Some(x_)) = (y, x_) {
                    let value = i32::from(x[(channel * height + y) * width + x_]) - i32::from(zero);
                    sum += value * i32::from(*weight);
                }
            }
            sums.push(sum);
        }
    }
    sums
}

#[test]
fn a_small_network_in_whole_numbers() {
    [WeightRange::Full, WeightRange::Reduced].into_iter().for_each(small_network_in_whole_numbers);
}

fn small_network_in_whole_numbers(weight_range: WeightRange) {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut sketch = Sketch::default();
    let image = sketch.node(Op::Input, &[], 3);
    // Convolutions that read the image itself stay in float.
    let twice = sketch.node(Op::Add, &[image, image], 3);
    let first = sketch.conv(twice, "first", 6, 3, &mut rng);
    let relu = sketch.node(Op::Relu, &[first], 6);
    let logits = sketch.conv(relu, "logits", 3, 1, &mut rng);
    let regression = sketch.conv(relu, "regression", 8, 1, &mut rng);
    let network = sketch.finish(logits, regression);
    assert_eq!(layers(&network.graph, LOGITS), BTreeSet::from([first]), "the last layers stay");
    assert_eq!(maps(&network.graph, &BTreeSet::from([first])), BTreeSet::from([image, twice, relu]));

    let [single, seen, made] = [Range::new(-1.0, 1.25), Range::new(-2.0, 2.5), Range::new(0.0, 3.0)];
    let observed = BTreeMap::from([(image, single), (twice, seen), (relu, made)]);
    let quantization =
        Quantization::new(&network.graph, &BTreeSet::from([first]), &observed).with_weights(weight_range);
    let size = [32, 32];
    let input: Vec<f32> = (0..3 * 32 * 32).map(|_| rng.random_range(-1.2..1.5)).collect();
    let found = answer(file(&network, Some(&quantization), &facts()), &input, size);

    let tensor = |name: &str| &network.weights.tensors[name].values;
    let weights = QuantizedWeights::new(tensor("first.weight"), tensor("first.bias"), 6, seen.scale(), weight_range);
    let zero = seen.zero_point();
    let steps = |x: &f32| {
        ((2.0 * single.rounded(*x) / seen.scale()).round_ties_even() + f32::from(zero)).clamp(0.0, 255.0) as u8
    };
    let x: Vec<u8> = input.iter().map(steps).collect();
    let sums = whole_conv(&x, zero, size, &weights, 3);
    let hidden: Vec<f32> = sums
        .iter()
        .enumerate()
        .map(|(i, sum)| made.rounded((*sum as f32 * weights.bias_scales[i / 1024]).max(0.0)))
        .collect();
    let mut clipped = 0;
    for (class, at) in (0..3).flat_map(|class| (0..1024).map(move |at| (class, at))) {
        let products = (0..6).map(|c| hidden[c * 1024 + at] * tensor("logits.weight")[class * 6 + c]);
        let expected = tensor("logits.bias")[class] + products.sum::<f32>();
        // A sum on the border between two steps may fall on either side.
        assert!((found.logits[class * 1024 + at] - expected).abs() <= made.scale(), "{class} {at}");
        clipped += usize::from((found.logits[class * 1024 + at] - expected).abs() > 1e-4);
    }
    assert!(clipped < 30, "{clipped} of 3072 values lie on the other side of a border");
}

#[test]
fn learnt_upsampling_keeps_its_meaning() {
    for factor in [2, 4] {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let mut sketch = Sketch::default();
        let image = sketch.node(Op::Input, &[], 3);
        let weight = sketch.parameter("up.weight", &[3, 1, 2 * factor, 2 * factor], &mut rng);
        let up = sketch.node(Op::UpConv { weight, factor }, &[image], 3);
        let logits = sketch.conv(up, "logits", 3, 1, &mut rng);
        let regression = sketch.conv(up, "regression", 8, 1, &mut rng);
        let network = sketch.finish(logits, regression);
        let input: Vec<f32> = (0..3 * 8 * 12).map(|_| rng.random_range(-1.0..1.0)).collect();
        let observed = BTreeMap::from([(image, Range::new(-1.0, 1.0)), (up, Range::new(-2.0, 2.0))]);
        let quantization = Quantization::new(&network.graph, &layers(&network.graph, LOGITS), &observed);
        assert_eq!(quantization.layer_count(), 1);
        let float = answer(file(&network, None, &facts()), &input, [12, 8]);
        let int8 = answer(file(&network, Some(&quantization), &facts()), &input, [12, 8]);
        assert_eq!(float.map_size, int8.map_size);
        let largest = probe::largest_difference(&float.logits, &int8.logits);
        assert!(largest > 0.0 && largest < 0.04, "factor {factor}: {largest}");
        // ONNX Runtime gets other operators, of which the same comes.
        let other = file_for(Target::OnnxRuntime, &network, Some(&quantization), &facts());
        assert_ne!(other.bytes(), file(&network, Some(&quantization), &facts()).bytes());
        let other = answer(other, &input, [12, 8]);
        assert_eq!((other.logits, other.regression), (int8.logits, int8.regression), "factor {factor}");
    }
}

/// What the maps of `network` take on noise.
fn calibrated(network: &Network, facts: &Facts) -> Calibration {
    let mut calibration = Calibration::new(network, &layers(&network.graph, LOGITS), &[], facts, Some(1)).unwrap();
    let [width, height] = probe::SIZE;
    let values = &probe::input(probe::SIZE);
    calibration.observe(TensorView { shape: &[1, 3, height, width], values }).unwrap();
    calibration
}

#[test]
fn every_kind_of_network_stays_near_itself() {
    let limit = |backbone, norm| match (backbone, norm) {
        // A depthwise layer adds up nine numbers only: what rounding did to them is not averaged out.
        (Backbone::MobilenetV2 | Backbone::MobilenetV2Tensorflow | Backbone::EfficientnetLite0, _) => 0.25,
        (_, NormKind::Batch) => 0.1,
        // Group norm of a narrow network divides by the deviation of a few values, and enlarges what rounding did to
        // them.
        (_, NormKind::Group) => 0.8,
    };
    for (backbone, norm, neck, msfe) in [
        (Backbone::MobilenetV2, NormKind::Batch, NeckKind::Plain, Msfe::None),
        (Backbone::MobilenetV2Tensorflow, NormKind::Batch, NeckKind::Plain, Msfe::None),
        (Backbone::EfficientnetLite0, NormKind::Batch, NeckKind::Plain, Msfe::None),
        (Backbone::Resnet18, NormKind::Batch, NeckKind::Plain, Msfe::None),
        (Backbone::Vgg16, NormKind::Batch, NeckKind::Plain, Msfe::None),
        (Backbone::Dla34, NormKind::Batch, NeckKind::Plain, Msfe::A),
        (Backbone::Dla34, NormKind::Batch, NeckKind::Plain, Msfe::B),
        (Backbone::Dla34, NormKind::Batch, NeckKind::Plain, Msfe::C),
        (Backbone::Dla34, NormKind::Group, NeckKind::Plain, Msfe::None),
        (Backbone::Dla34, NormKind::Batch, NeckKind::Deformable, Msfe::None),
        (Backbone::Dla34, NormKind::Group, NeckKind::Deformable, Msfe::C),
    ] {
        let model = small_on(backbone, norm, neck, msfe);
        let facts = DetectorFile::facts(&model, Target::Portable);
        let network = Network::deployable(&model).unwrap();
        let calibration = calibrated(&network, &facts);
        let input = probe::input(probe::SIZE);
        let float = answer(file(&network, None, &facts), &input, probe::SIZE);
        for observer in OBSERVERS {
            let layers = layers(&network.graph, LOGITS);
            let quantization = Quantization::new(&network.graph, &layers, &calibration.ranges(observer));
            assert_eq!(quantization.layer_count(), layers.len());
            let int8 = answer(file(&network, Some(&quantization), &facts), &input, probe::SIZE);
            let apart: f64 = float.logits.iter().zip(&int8.logits).map(|(a, b)| f64::from((a - b).powi(2))).sum();
            let mean = float.logits.iter().map(|a| f64::from(*a)).sum::<f64>() / float.logits.len() as f64;
            let spread: f64 = float.logits.iter().map(|a| (f64::from(*a) - mean).powi(2)).sum();
            let share = (apart / spread).sqrt();
            println!("{backbone:?} {norm:?} {neck:?} {msfe:?} {observer:?}: {share:.3} of the deviation");
            assert!(
                share > 0.0 && share < limit(backbone, norm),
                "{backbone:?} {norm:?} {neck:?} {msfe:?} {observer:?}: {share}"
            );
        }
    }
}

#[test]
fn the_head_at_the_peaks_is_that_of_the_whole_file() {
    let model = small(NormKind::Batch, NeckKind::Plain, Msfe::A);
    let facts = DetectorFile::facts(&model, Target::Portable);
    let network = Network::deployable(&model).unwrap();
    let ranges = calibrated(&network, &facts).ranges(Observer::MinMax);
    let quantization = Quantization::new(&network.graph, &layers(&network.graph, LOGITS), &ranges);
    let whole = file(&network, Some(&quantization), &facts);
    let cut = LocalHeadFile::new(&whole, REGRESSION, Path::new("in memory")).unwrap().unwrap();
    let head = SparseHead::new(&cut);
    let input = probe::input(probe::SIZE);
    let [dense, features] = [whole, cut.model].map(|file| answer(file, &input, probe::SIZE));
    assert_eq!(dense.logits, features.logits);
    let [width, height] = dense.map_size;
    for cell in [[0, 0], [width - 1, height - 1], [5, 7]] {
        let found = head.regression(&features.regression, features.map_size, cell);
        for (channel, found) in found.into_iter().enumerate() {
            let expected = f64::from(dense.regression[(channel * height + cell[1]) * width + cell[0]]);
            assert!((found - expected).abs() < 1e-4, "{cell:?} {channel}: {found} {expected}");
        }
    }
}

#[test]
fn a_network_does_itself_no_harm_and_coarse_ranges_do() {
    let model = small(NormKind::Batch, NeckKind::Plain, Msfe::A);
    let facts = DetectorFile::facts(&model, Target::Portable);
    let network = Network::deployable(&model).unwrap();
    let path = Path::new("in memory");
    let mut answers = Answers::new(&detector_file(file(&network, None, &facts)), path, Some(1)).unwrap();
    let camera = Camera::from_hfov(80.0, 128, 64).unwrap();
    let reference = answers.reference(probe::input(probe::SIZE), probe::SIZE, camera).unwrap();
    assert!(reference.peak_count() > 0, "without peaks there is nothing to compare");
    let references = [reference];
    let own = answers.change(&references).unwrap();
    assert!(own.total() < 1e-9, "{own:?}");

    let ranges = calibrated(&network, &facts).ranges(Observer::MinMax);
    let coarse: BTreeMap<NodeId, Range> =
        ranges.iter().map(|(id, range)| (*id, Range::new(range.ends()[0] * 20.0, range.ends()[1] * 20.0))).collect();
    let change = |ranges: &BTreeMap<NodeId, Range>| {
        let quantization = Quantization::new(&network.graph, &layers(&network.graph, LOGITS), ranges);
        let file = file(&network, Some(&quantization), &facts);
        Answers::new(&detector_file(file), path, Some(1)).unwrap().change(&references).unwrap().total()
    };
    let (fine, coarse) = (change(&ranges), change(&coarse));
    assert!(fine > 0.0 && coarse > 3.0 * fine, "{fine} {coarse}");
}
