//! Names of `MobileNetV2`: Farsight's are those of torchvision behind a prefix.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use farsight_core::input::{CHANNEL_MEAN, CHANNEL_STD};
use farsight_graph::graph::NORM_EPSILON;
use farsight_graph::layers::inverted_residuals::{Convention, INPUT, PREFIX};
use farsight_graph::layers::{Builder, NormKind, mobilenet_v2};
use farsight_graph::weights::WeightTensor;

/// Farsight's name of a tensor that torchvision calls `name`; none of the classifier and of the convolution before it.
pub(crate) fn canonical_name(name: &str) -> Option<String> {
    let canonical = format!("{PREFIX}{name}");
    NAMES.contains(&canonical).then_some(canonical)
}

/// The tensors of the backbone, statistics among them, sorted; with the scale of the image or without.
pub(crate) fn names(with_input: bool) -> Vec<String> {
    let input = format!("{PREFIX}{INPUT}.");
    NAMES.iter().filter(|name| with_input || !name.starts_with(&input)).cloned().collect()
}

static NAMES: LazyLock<BTreeSet<String>> = LazyLock::new(|| {
    let mut b = Builder::new(NormKind::Batch);
    let image = b.input(3);
    mobilenet_v2(&mut b, image, 1.0, Convention::Tensorflow);
    b.finish().parameters.into_iter().map(|parameter| parameter.name).collect()
});

/// What torchvision calls a tensor now that it called `name` first.
///
/// In a block the layers stood in one row and activations counted: convolution, norm, activation, convolution, norm,
/// activation, convolution, norm. Now each convolution with an activation is a module of its own.
pub(crate) fn modern_name(name: &str) -> Option<String> {
    let Some((block, rest)) = name.split_once(".conv.") else { return Some(name.to_owned()) };
    let (place, tensor) = rest.split_once('.')?;
    let place: usize = place.parse().ok().filter(|place| *place < 8)?;
    // The first block has no expansion: its row starts with the depthwise convolution, and ends three places earlier.
    let last = if block == "features.1" { 1 } else { 2 };
    let (unit, part) = (place / 3, place % 3);
    let place = if unit < last { format!("{unit}.{part}") } else { (unit + part).to_string() };
    Some(format!("{block}.conv.{place}.{tensor}"))
}

/// TensorFlow's object detection calls the layers so.
const TENSORFLOW: &str = "FeatureExtractor/MobilenetV2/";

/// The variance with which a batch norm divides by one.
const UNIT_VARIANCE: f32 = 1.0 - NORM_EPSILON as f32;

/// What torchvision calls the tensor `name` of TensorFlow's object detection: the weight of a convolution, or its bias,
/// which is that of the norm folded into it.
pub(crate) fn name_from_tensorflow(name: &str) -> Option<String> {
    let Some(rest) = name.strip_prefix(TENSORFLOW) else { return Some(name.to_owned()) };
    let (layer, tensor) = rest.rsplit_once('.')?;
    let (block, part) = layer.split_once('/').unwrap_or((layer, ""));
    let index = match block {
        "Conv" => 0,
        "Conv_1" => 18,
        "expanded_conv" => 1,
        _ => block.strip_prefix("expanded_conv_")?.parse::<usize>().ok().filter(|k| (1..=16).contains(k))? + 1,
    };
    // The first block has no expansion.
    let unit = usize::from(index > 1);
    let [convolution, norm] = match (index, part) {
        (0 | 18, "") => ["0".to_owned(), "1".to_owned()],
        (2..=17, "expand") => ["conv.0.0".to_owned(), "conv.0.1".to_owned()],
        (1..=17, "depthwise") => [0, 1].map(|i| format!("conv.{unit}.{i}")),
        (1..=17, "project") => [1, 2].map(|i| format!("conv.{}", unit + i)),
        _ => return None,
    };
    let place = if tensor == "weight" { convolution } else { norm };
    Some(format!("features.{index}.{place}.{tensor}"))
}

/// Gives each folded norm, of which `tensors` has the bias alone, what makes it add that bias and nothing else; and the
/// image the scale of TensorFlow's object detection, -1 to 1.
pub(crate) fn add_norms_and_scale(tensors: &mut BTreeMap<String, WeightTensor>) {
    let biases = tensors.keys().filter_map(|name| name.strip_suffix(".bias")).map(str::to_owned);
    for norm in biases.collect::<Vec<_>>() {
        let channels = tensors[&format!("{norm}.bias")].values.len();
        for (part, value) in [("weight", 1.0), ("running_mean", 0.0), ("running_var", UNIT_VARIANCE)] {
            let tensor = WeightTensor { shape: vec![channels], values: vec![value; channels] };
            tensors.insert(format!("{norm}.{part}"), tensor);
        }
    }
    add_scale_of_image(tensors, [2.0, -1.0]);
}

/// Adds the norm that makes `slope` times a colour from 0 to 1 and `shift` of our image.
pub(super) fn add_scale_of_image(tensors: &mut BTreeMap<String, WeightTensor>, [slope, shift]: [f32; 2]) {
    // Our image is (colour - mean) / deviation.
    let [scale, shift] = [CHANNEL_STD.map(|std| slope * std), CHANNEL_MEAN.map(|mean| slope * mean + shift)];
    let parts = [("weight", scale), ("bias", shift), ("running_mean", [0.0; 3]), ("running_var", [UNIT_VARIANCE; 3])];
    for (part, values) in parts {
        let name = format!("{PREFIX}{INPUT}.{part}");
        tensors.insert(name, WeightTensor { shape: vec![3], values: values.to_vec() });
    }
}
