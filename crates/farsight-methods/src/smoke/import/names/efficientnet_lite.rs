//! Names of `EfficientNet-Lite` in PyTorch (`efficientnet_lite_pytorch`), and what those weights expect of a network.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use farsight_graph::graph::NORM_EPSILON;
use farsight_graph::layers::inverted_residuals::PREFIX;
use farsight_graph::layers::{Builder, EfficientnetLite, NormKind};
use farsight_graph::weights::WeightTensor;

use super::mobilenet_v2::add_scale_of_image;

/// What the norms of these networks add to a variance.
const THEIR_EPSILON: f64 = 1e-3;

/// A colour from 0 to 1 is (255 colour - 127) / 128 there.
const SLOPE_AND_SHIFT: [f32; 2] = [255.0 / 128.0, -127.0 / 128.0];

/// A block that the smallest network does not have.
const DEEPER: &str = "features.17.";

/// Farsight's name of a tensor that `efficientnet_lite_pytorch` calls `name`; none of the classifier and of the
/// convolution before it.
pub(crate) fn canonical_name(name: &str) -> Option<String> {
    let (layer, tensor) = name.rsplit_once('.')?;
    let place = match layer.strip_prefix("_blocks.") {
        None => match layer {
            "_conv_stem" => "features.0.0".to_owned(),
            "_bn0" => "features.0.1".to_owned(),
            _ => return None,
        },
        Some(rest) => {
            let (block, part) = rest.split_once('.')?;
            let block: usize = block.parse().ok()?;
            // The first block has no expansion.
            let unit = usize::from(block > 0);
            let part = match part {
                "_expand_conv" if unit == 1 => "0.0".to_owned(),
                "_bn0" if unit == 1 => "0.1".to_owned(),
                "_depthwise_conv" => format!("{unit}.0"),
                "_bn1" => format!("{unit}.1"),
                "_project_conv" => (unit + 1).to_string(),
                "_bn2" => (unit + 2).to_string(),
                _ => return None,
            };
            format!("features.{}.conv.{part}", block.checked_add(1)?)
        }
    };
    let canonical = format!("{PREFIX}{place}.{tensor}");
    DEEP.contains(&canonical).then_some(canonical)
}

/// The tensors of the backbone that `tensors` is, statistics and the scale of the image among them, sorted.
pub(crate) fn names(tensors: &BTreeMap<String, WeightTensor>) -> Vec<String> {
    let is_deep = tensors.keys().any(|name| name.starts_with(&format!("{PREFIX}{DEEPER}")));
    if is_deep { DEEP.iter().cloned().collect() } else { names_of(EfficientnetLite::Lite0).into_iter().collect() }
}

/// The names of all networks but the smallest.
static DEEP: LazyLock<BTreeSet<String>> = LazyLock::new(|| names_of(EfficientnetLite::Lite1));

fn names_of(network: EfficientnetLite) -> BTreeSet<String> {
    let mut b = Builder::new(NormKind::Batch);
    let image = b.input(3);
    network.append(&mut b, image, 1.0);
    b.finish().parameters.into_iter().map(|parameter| parameter.name).collect()
}

/// Makes our norms divide by what theirs do, and gives the image their scale.
pub(crate) fn with_their_norms_and_scale(tensors: &mut BTreeMap<String, WeightTensor>) {
    let variances = tensors.iter_mut().filter(|(name, _)| name.ends_with(".running_var"));
    for value in variances.flat_map(|(_, tensor)| &mut tensor.values) {
        *value = (f64::from(*value) + THEIR_EPSILON - NORM_EPSILON) as f32;
    }
    add_scale_of_image(tensors, SLOPE_AND_SHIFT);
}
