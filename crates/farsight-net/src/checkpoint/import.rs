//! From a foreign checkpoint to Farsight's weights.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;

use super::error::{CheckpointError, CheckpointProblem};
use super::names::{ImagenetNorms, Layout, canonical_names, is_dead, running_statistics};
use super::read_pth;
use crate::weights::{WeightTensor, Weights, is_step_counter};

/// Metadata key: whose checkpoint it was, see [`Layout::name`].
pub const SOURCE_KEY: &str = "farsight.source.layout";
/// Metadata key: the classes of the heat map in the order of its channels.
pub const CLASSES_KEY: &str = "farsight.classes";
/// Metadata key: `group` or `batch`.
pub const NORM_KEY: &str = "farsight.norm";
/// Metadata key: `rgb` or `bgr`, the order of the input channels (spec section 8).
pub const CHANNELS_KEY: &str = "farsight.quirks.channels";
/// Metadata key: `true` where the network was trained without the fourth column of the projection (spec section 5.6).
pub const CAMERA_3X3_KEY: &str = "farsight.quirks.camera_3x3";
/// Metadata key: `half_pixel` or `pixel_exact`, where the input's warp looks in the image (spec section 8).
pub const SAMPLING_KEY: &str = "farsight.quirks.sampling";

/// The order of the classes in Farsight, which is official SMOKE's. mmdetection3d has it the other way round.
const CLASS_ORDER: &str = "Car,Cyclist,Pedestrian";
const CLASS_COUNT: usize = 3;

/// The last convolution before the heat map.
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
    /// The tensors by their canonical names; the metadata says how the network was trained to be run.
    pub weights: Weights,
    /// Whose checkpoint it was.
    pub layout: Layout,
    /// Tensors of the file that Farsight has no place for, by the file's names, sorted. Step counters of batch norm are not counted.
    pub left_over: Vec<String>,
    /// Tensors of the network that the file does not have, by canonical names, sorted. Tensors that no forward pass uses are not counted.
    pub missing: Vec<String>,
}

/// Imports a SMOKE checkpoint of the official code or of mmdetection3d, or an ImageNet DLA-34.
///
/// Beside the names, only mmdetection3d's class order changes: its heat map's channels are put in the official order. Everything else
/// that the two do differently is recorded in the metadata.
///
/// # Errors
/// [`CheckpointError`] names the file, and the tensor where there is one.
pub fn import(path: &Path, options: ImportOptions) -> Result<Imported, CheckpointError> {
    let tensors = read_pth(path)?;
    translate(tensors, options).map_err(|problem| CheckpointError::new(path, problem))
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
    if layout == Layout::Mmdet3d {
        reverse_classes(&mut tensors)?;
    }
    let (missing, metadata) = (missing(&tensors), metadata(layout, is_batch_normed(&tensors)));
    Ok(Imported { weights: Weights { tensors, metadata }, layout, left_over, missing })
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

fn is_batch_normed(tensors: &BTreeMap<String, WeightTensor>) -> bool {
    tensors.keys().any(|name| name.ends_with(".running_mean"))
}

fn missing(tensors: &BTreeMap<String, WeightTensor>) -> Vec<String> {
    let mut expected = canonical_names();
    if is_batch_normed(tensors) {
        expected.extend(running_statistics());
    }
    expected.retain(|name| !tensors.contains_key(name) && !is_dead(name));
    expected.sort();
    expected
}

/// What a program must know to run the network as it was trained (spec section 13).
fn metadata(layout: Layout, batch_normed: bool) -> BTreeMap<String, String> {
    let norm = if batch_normed { "batch" } else { "group" };
    let facts: &[(&str, &str)] = match layout {
        Layout::OfficialSmoke => &[
            (CLASSES_KEY, CLASS_ORDER),
            (NORM_KEY, norm),
            (CHANNELS_KEY, "bgr"),
            (CAMERA_3X3_KEY, "true"),
            (SAMPLING_KEY, "half_pixel"),
        ],
        Layout::Mmdet3d => &[
            (CLASSES_KEY, CLASS_ORDER),
            (NORM_KEY, norm),
            (CHANNELS_KEY, "rgb"),
            (CAMERA_3X3_KEY, "false"),
            (SAMPLING_KEY, "pixel_exact"),
        ],
        // A classifier has no camera, and its norms are only a start.
        Layout::ImagenetDla34 => &[(CHANNELS_KEY, "rgb")],
    };
    let source = [(SOURCE_KEY, layout.name())];
    source.iter().chain(facts).map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
}
