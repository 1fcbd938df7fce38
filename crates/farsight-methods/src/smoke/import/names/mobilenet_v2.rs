//! Names of `MobileNetV2`: Farsight's are those of torchvision behind a prefix.

use std::collections::BTreeSet;
use std::sync::LazyLock;

use farsight_graph::layers::mobilenet_v2::PREFIX;
use farsight_graph::layers::{Builder, NormKind, mobilenet_v2};

/// Farsight's name of a tensor that torchvision calls `name`; none of the classifier and of the convolution before it.
pub(crate) fn canonical_name(name: &str) -> Option<String> {
    let canonical = format!("{PREFIX}{name}");
    NAMES.contains(&canonical).then_some(canonical)
}

/// The tensors of the backbone, sorted.
pub(crate) fn names() -> &'static BTreeSet<String> {
    &NAMES
}

static NAMES: LazyLock<BTreeSet<String>> = LazyLock::new(|| {
    let mut b = Builder::new(NormKind::Batch);
    let image = b.input(3);
    mobilenet_v2(&mut b, image, 1.0);
    b.finish().parameters.into_iter().map(|parameter| parameter.name).collect()
});

/// What torchvision calls a tensor now that it called `name` first.
///
/// In a block the layers stood in one row and activations counted: convolution, norm, activation, convolution, norm, activation, convolution, norm. Now
/// each convolution with an activation is a module of its own.
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
