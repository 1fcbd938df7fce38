//! From a foreign checkpoint to Farsight's weights.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;

use farsight_core::input::{ChannelOrder, Sampling};

use farsight_graph::layers::NormKind;
use farsight_graph::model::ATTRIBUTION_KEY;
use farsight_graph::weights::{MAX_FILE, WeightTensor, Weights, is_step_counter};
use farsight_import::tflite::{is_tflite, read_convolutions};
use farsight_import::{CheckpointError, CheckpointProblem, attribution, tensors_from_pth};

use super::config::{Quirks, SmokeConfig};

mod names;

pub use names::{ImagenetNorms, Layout, canonical_names, is_dead, running_statistics};
use names::{efficientnet_lite, mobilenet_v2};

/// Metadata key: whose checkpoint it was, see [`Layout::name`].
pub const SOURCE_KEY: &str = "farsight.source.layout";
/// SMOKE's classes. Farsight has them in the official order; mmdetection3d has them the other way round.
const CLASS_COUNT: usize = 3;

/// The last convolution before the heatmap.
const CLASS_CONVOLUTION: [&str; 2] = ["heads.predictor.class_head.3.weight", "heads.predictor.class_head.3.bias"];

/// How to import.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ImportOptions {
    /// Which norms of an ImageNet checkpoint to take over.
    pub imagenet_norms: ImagenetNorms,
}

/// A checkpoint in Farsight's terms, and what did not fit.
#[derive(Debug, Clone)]
pub struct Imported {
    /// The tensors by their canonical names.
    pub weights: Weights,
    /// The network they are weights of, and how it was trained to be run; `None` for a backbone alone (ImageNet).
    pub config: Option<SmokeConfig>,
    /// Whose checkpoint it was.
    pub layout: Layout,
    /// Tensors of the file that Farsight has no place for, by the file's names, sorted. Step counters of batch norm are
    /// not counted.
    pub left_over: Vec<String>,
    /// Tensors of the network that the file does not have, by canonical names, sorted. Tensors that no forward pass
    /// uses are not counted.
    pub missing: Vec<String>,
}

/// Imports a SMOKE checkpoint of the official code or of mmdetection3d, or the ImageNet weights of DLA-34,
/// `MobileNetV2` or `EfficientNet-Lite`.
///
/// Beside the names, only mmdetection3d's class order changes: its heatmap's channels are put in the official order.
/// Everything else that the two do differently is recorded as quirks in the config. Of files that are known, whose they
/// are and under which licence goes into the header.
///
/// # Errors
/// [`CheckpointError`] names the file, and the tensor where there is one.
pub fn import(path: &Path, options: ImportOptions) -> Result<Imported, CheckpointError> {
    let read = || {
        let bytes = farsight_files::read_file(path, MAX_FILE)?;
        let tensors = if is_tflite(&bytes) { read_convolutions(&bytes)? } else { tensors_from_pth(&bytes)? };
        let mut imported = translate(tensors, options)?;
        if let Some(attribution) = attribution(&bytes) {
            imported.weights.metadata.insert(ATTRIBUTION_KEY.to_owned(), attribution.to_owned());
        }
        Ok(imported)
    };
    read().map_err(|problem| CheckpointError::new(path, problem))
}

fn translate(found: BTreeMap<String, WeightTensor>, options: ImportOptions) -> Result<Imported, CheckpointProblem> {
    let layout = Layout::detect(found.keys().map(String::as_str))
        .ok_or_else(|| CheckpointProblem::Layout { example: found.keys().next().cloned().unwrap_or_default() })?;
    let (mut tensors, mut left_over) = (BTreeMap::new(), Vec::new());
    for (name, tensor) in found {
        let Some(canonical) = layout.canonical_name(&name, options.imagenet_norms) else {
            left_over.extend((!is_step_counter(&name)).then_some(name));
            continue;
        };
        match tensors.entry(canonical) {
            Entry::Vacant(entry) => entry.insert(tensor),
            Entry::Occupied(entry) => return Err(CheckpointProblem::Twice { name, canonical: entry.key().clone() }),
        };
    }
    match layout {
        Layout::Mmdet3d => reverse_classes(&mut tensors)?,
        Layout::MobilenetV2Tensorflow => mobilenet_v2::add_norms_and_scale(&mut tensors),
        Layout::EfficientnetLite => efficientnet_lite::with_their_norms_and_scale(&mut tensors),
        _ => {}
    }
    let (missing, config) = (missing(layout, &tensors), config(layout, &tensors));
    let metadata = BTreeMap::from([(SOURCE_KEY.to_owned(), layout.name().to_owned())]);
    Ok(Imported { weights: Weights { tensors, metadata }, config, layout, left_over, missing })
}

/// Turns Pedestrian, Cyclist, Car into Car, Cyclist, Pedestrian, or back.
fn reverse_classes(tensors: &mut BTreeMap<String, WeightTensor>) -> Result<(), CheckpointProblem> {
    for name in CLASS_CONVOLUTION {
        let Some(tensor) = tensors.get_mut(name) else { continue };
        if tensor.shape.first() != Some(&CLASS_COUNT) {
            return Err(CheckpointProblem::Classes { name: name.to_owned(), found: tensor.shape.clone() });
        }
        // Rows are classes. An empty row has nothing to move, and `chunks` takes no zero.
        let row = (tensor.values.len() / CLASS_COUNT).max(1);
        tensor.values = tensor.values.chunks(row).rev().flatten().copied().collect();
    }
    Ok(())
}

/// Farsight's name of a tensor of the backbone that TensorFlow's object detection calls `name`, the layer behind it
/// included.
pub(crate) fn mobilenet_v2_from_tensorflow(name: &str) -> Option<String> {
    mobilenet_v2::name_from_tensorflow(name)
        .map(|name| format!("{}{name}", farsight_graph::layers::inverted_residuals::PREFIX))
}

/// `tensors` of layers whose norms were folded, with norms that add what is left of them, and the scale of the image.
pub(crate) fn with_norms_and_scale(mut tensors: BTreeMap<String, WeightTensor>) -> BTreeMap<String, WeightTensor> {
    mobilenet_v2::add_norms_and_scale(&mut tensors);
    tensors
}

fn is_batch_normed(tensors: &BTreeMap<String, WeightTensor>) -> bool {
    tensors.keys().any(|name| name.ends_with(".running_mean"))
}

fn missing(layout: Layout, tensors: &BTreeMap<String, WeightTensor>) -> Vec<String> {
    let mut expected = match layout {
        Layout::MobilenetV2 | Layout::MobilenetV2InRows => mobilenet_v2::names(false),
        Layout::MobilenetV2Tensorflow => mobilenet_v2::names(true),
        Layout::EfficientnetLite => efficientnet_lite::names(tensors),
        _ => canonical_names(),
    };
    if matches!(layout, Layout::OfficialSmoke | Layout::Mmdet3d) && is_batch_normed(tensors) {
        expected.extend(running_statistics());
    }
    expected.retain(|name| !tensors.contains_key(name) && !is_dead(name));
    expected.sort();
    expected
}

/// SMOKE as wide as the tensors are, with the habits of the program that trained it (spec section 13).
fn config(layout: Layout, tensors: &BTreeMap<String, WeightTensor>) -> Option<SmokeConfig> {
    let quirks = match layout {
        Layout::OfficialSmoke => {
            Quirks { camera_3x3: true, channels: ChannelOrder::Bgr, sampling: Sampling::HalfPixel }
        }
        Layout::Mmdet3d => Quirks::default(),
        // A classifier has no camera, and its norms are only a start.
        Layout::ImagenetDla34
        | Layout::MobilenetV2
        | Layout::MobilenetV2InRows
        | Layout::MobilenetV2Tensorflow
        | Layout::EfficientnetLite => return None,
    };
    let norm = if is_batch_normed(tensors) { NormKind::Batch } else { NormKind::Group };
    let smoke = SmokeConfig { norm, quirks, ..SmokeConfig::default() };
    let width = |name: &str| tensors.get(name).and_then(|tensor| tensor.shape.first()).copied();
    let level = |layer: &str| width(&format!("backbone.body.base.{layer}.weight"));
    let last_layers = [
        "level0.0",
        "level1.0",
        "level2.root.conv",
        "level3.tree2.root.conv",
        "level4.tree2.root.conv",
        "level5.root.conv",
    ];
    let standard = smoke.channels();
    let channels = std::array::from_fn(|i| level(last_layers[i]).unwrap_or(standard[i]));
    let head = width("heads.predictor.class_head.0.weight").unwrap_or(smoke.head_width());
    Some(SmokeConfig {
        level_channels: (channels != standard).then_some(channels),
        head_channels: (head != smoke.head_width()).then_some(head),
        ..smoke
    })
}
