//! From a TFLite file of TensorFlow's object detection to our names.

use std::collections::BTreeMap;
use std::path::Path;

use farsight_graph::model::ATTRIBUTION_KEY;
use farsight_graph::weights::{MAX_FILE, WeightTensor, Weights};
use farsight_import::tflite::{is_tflite, read_convolutions};
use farsight_import::{CheckpointError, CheckpointProblem, attribution};

use super::anchors::{LEVELS, shapes};
use super::config::LABELS;
use super::{SsdConfig, SsdModel};
use crate::smoke::import::{SOURCE_KEY, mobilenet_v2_from_tensorflow, with_norms_and_scale};

/// Channels of the classes of an anchor in the file: Open Images' selection, the background first.
const FILE_LABELS: usize = 24;

/// Where [`LABELS`] stand among them.
const PLACES: [usize; LABELS.len()] = [1, 4, 18, 23];

/// The SSD in the TFLite file at `path`, with our labels alone.
///
/// # Errors
/// [`CheckpointError`] names the file, and the tensor where there is one.
pub fn import(path: &Path) -> Result<SsdModel, CheckpointError> {
    let read = || {
        let bytes = farsight_files::read_file(path, MAX_FILE)?;
        if !is_tflite(&bytes) {
            return Err(CheckpointProblem::Tflite("not a TFLite file; expected an SSD on MobileNetV2"));
        }
        let mut weights = translated(read_convolutions(&bytes)?)?;
        if let Some(attribution) = attribution(&bytes) {
            weights.metadata.insert(ATTRIBUTION_KEY.to_owned(), attribution.to_owned());
        }
        SsdModel::new(SsdConfig::default(), weights)
            .map_err(|error| CheckpointProblem::ShapeMismatch(error.to_string()))
    };
    read().map_err(|problem| CheckpointError::new(path, problem))
}

fn translated(found: BTreeMap<String, WeightTensor>) -> Result<Weights, CheckpointProblem> {
    let (mut layers, mut heads) = (BTreeMap::new(), BTreeMap::new());
    for (name, tensor) in found {
        if let Some(head) = head_name(&name) {
            let tensor = if head.contains(".classes.") { selected(&name, &tensor)? } else { tensor };
            heads.insert(head, tensor);
        } else if let Some(layer) = step_name(&name).or_else(|| mobilenet_v2_from_tensorflow(&name)) {
            layers.insert(layer, tensor);
        }
    }
    let mut tensors = with_norms_and_scale(layers);
    tensors.extend(heads);
    let metadata = BTreeMap::from([(SOURCE_KEY.to_owned(), "tensorflow-ssd".to_owned())]);
    Ok(Weights { tensors, metadata })
}

/// `BoxPredictor_2/ClassPredictor.bias` is `heads.2.classes.bias`.
fn head_name(name: &str) -> Option<String> {
    let (level, rest) = name.strip_prefix("BoxPredictor_")?.split_once('/')?;
    let level: usize = level.parse().ok().filter(|level| *level < LEVELS)?;
    let (head, tensor) = rest.rsplit_once('.')?;
    let head = match head {
        "BoxEncodingPredictor" => "boxes",
        "ClassPredictor" => "classes",
        _ => return None,
    };
    Some(format!("heads.{level}.{head}.{tensor}"))
}

/// `FeatureExtractor/MobilenetV2/layer_19_2_Conv2d_3_3x3_s2_256.weight` is `steps.1.1.0.weight`: the convolution; its
/// bias is that of the norm.
fn step_name(name: &str) -> Option<String> {
    let rest = name.strip_prefix("FeatureExtractor/MobilenetV2/layer_19_")?;
    let (layer, tensor) = rest.rsplit_once('.')?;
    let (part, rest) = layer.split_once("_Conv2d_")?;
    let (step, _) = rest.split_once('_')?;
    let (part, step): (usize, usize) = (part.parse().ok()?, step.parse().ok()?);
    let module = usize::from(tensor != "weight");
    Some(format!("steps.{}.{}.{module}.{tensor}", step.checked_sub(2)?, part.checked_sub(1)?))
}

/// The rows of our labels, anchor by anchor.
fn selected(name: &str, tensor: &WeightTensor) -> Result<WeightTensor, CheckpointProblem> {
    let level = name.strip_prefix("BoxPredictor_").and_then(|rest| rest.split('/').next()?.parse::<usize>().ok());
    let anchors = level.filter(|level| *level < LEVELS).map_or(0, |level| shapes(level).len());
    if tensor.shape.first() != Some(&(anchors * FILE_LABELS)) || anchors == 0 {
        return Err(CheckpointProblem::Classes { name: name.to_owned(), found: tensor.shape.clone() });
    }
    let row = tensor.values.len() / tensor.shape[0];
    let rows = (0..anchors).flat_map(|anchor| PLACES.map(|place| anchor * FILE_LABELS + place));
    let values: Vec<f32> = rows.flat_map(|at| tensor.values[at * row..][..row].iter().copied()).collect();
    let mut shape = tensor.shape.clone();
    shape[0] = anchors * LABELS.len();
    Ok(WeightTensor { shape, values })
}
