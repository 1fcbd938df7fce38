//! What must hold of every data set.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::{CachedDataset, Dataset, DatasetError};
use crate::loader::ItemKey;

/// Checks the laws of [`Dataset`] on its first frames, at most `frames`: for the tests of an implementation. The answer
/// is the first law that is broken.
///
/// A frame is equal whenever it is asked for, and equal to what is asked for alone: name, pixels, camera, road, labels,
/// time, pose, annotations. Frames of an epoch have names of their own. A data set that is not labelled has no labels.
/// Every frame has the annotations that are named. Epochs have the same frames, or, of an endless data set, new ones.
/// [`CachedDataset`] gives the same.
///
/// # Errors
/// When a frame cannot be read.
pub fn check_laws(dataset: &Arc<dyn Dataset>, frames: usize) -> Result<Option<String>, DatasetError> {
    let cached = CachedDataset::new(Arc::clone(dataset));
    let ids = dataset.ids();
    if ids.len() != dataset.len() || ids.iter().collect::<BTreeSet<_>>().len() != ids.len() {
        return Ok(Some(format!("names are not one for each of {} frames: {ids:?}", dataset.len())));
    }
    let named = dataset.annotation_names();
    for (index, id) in ids.iter().enumerate().take(frames) {
        let frame = dataset.frame(index)?;
        let key = |epoch| ItemKey { epoch, index, seed: 0 };
        let annotated: Vec<&str> = frame.annotations.names().collect();
        let is_mine = |text: &str| text.contains(&frame.id) || text.contains(&dataset.name());
        let laws = [
            ("another frame the second time", dataset.frame(index)? == frame),
            ("another item of the first epoch", dataset.item(key(0))? == frame),
            ("items of two epochs", (dataset.item(key(1))? == frame) != dataset.is_endless()),
            ("another name", dataset.id(index) == frame.id && *id == frame.id),
            ("another image", dataset.image(index)? == frame.image),
            ("another camera", dataset.camera(index)? == frame.camera),
            ("another road", dataset.road(index)? == frame.road),
            ("other labels", dataset.labels(index)? == frame.labels),
            ("labels of what is not labelled", dataset.is_labelled() || frame.labels.is_empty()),
            ("another time", dataset.timestamp_ns(index)? == frame.timestamp_ns),
            ("another pose", dataset.world_from_camera(index)? == frame.world_from_camera),
            ("other annotations", dataset.annotations(index)? == frame.annotations),
            ("an annotation that is named is not there", named.iter().all(|name| annotated.contains(name))),
            ("an origin that says nothing", is_mine(&dataset.origin(index))),
            ("another camera of the cache before", cached.camera(index)? == frame.camera),
            ("another frame of the cache", cached.frame(index)? == frame && cached.frame(index)? == frame),
            ("another camera of the cache after", cached.camera(index)? == frame.camera),
            ("another road of the cache", cached.road(index)? == frame.road),
            ("other labels of the cache", cached.labels(index)? == frame.labels),
            ("another image of the cache", cached.image(index)? == frame.image),
            ("other annotations of the cache", cached.annotations(index)? == frame.annotations),
            ("another item of the cache", cached.item(key(1))? == dataset.item(key(1))?),
        ];
        if let Some((law, _)) = laws.into_iter().find(|(_, holds)| !holds) {
            return Ok(Some(format!("frame {index}: {law}")));
        }
    }
    Ok(None)
}
