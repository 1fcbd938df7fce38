//! Rendered scenes as a data set.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use farsight_core::{Camera, Label};
use farsight_data::annotations::{Annotation, Annotations, DepthMap, Plates};
use farsight_data::{Dataset, DatasetError, Frame, ItemKey};
use image::RgbImage;

use crate::generator::generate_scene;
use crate::stream::SceneStream;

/// Scenes between two views of the same one: more than a batch has, so that no step sees a scene twice but for the
/// first ones of a run.
const VIEW_DISTANCE: usize = 256;

/// Scenes of a stream: an endless data set, in which every frame of every epoch is a new one, rendered when it is asked
/// for.
///
/// Labels follow from what the image shows, so whatever is asked for but the camera renders the frame.
#[derive(Debug)]
pub struct SceneDataset {
    stream: SceneStream,
    frames_per_epoch: usize,
    views: usize,
    kept: Mutex<BTreeMap<usize, Arc<OnceLock<Arc<Frame>>>>>,
}

impl SceneDataset {
    /// Scenes of `stream`, so many an epoch. Frame number `index` is the scene of that number.
    pub fn new(stream: SceneStream, frames_per_epoch: usize) -> Self {
        Self { stream, frames_per_epoch, views: 1, kept: Mutex::default() }
    }

    /// Each scene comes `views` times as an [item](Dataset::item), at least 1: where drawing a scene takes longer than
    /// learning from it, it is worth several augmentations.
    ///
    /// The items must be asked for nearly in their order. Up to 256 scenes times `views` stay in memory.
    pub fn with_views(self, views: usize) -> Self {
        Self { views: views.max(1), ..self }
    }

    /// The scene of the item at this place of the endless row: every place that `views` divides has a new one, and the
    /// places after it have one from 256 scenes before, one from 512 scenes before and so on.
    fn scene_of(&self, place: usize) -> usize {
        let (newest, view) = (place / self.views, place % self.views);
        newest.checked_sub(view * VIEW_DISTANCE).unwrap_or(newest)
    }

    /// A scene that is asked for `views` times, rendered once. Whatever is too old to be asked for again is dropped.
    fn kept_frame(&self, scene: usize, newest: usize) -> Arc<Frame> {
        let place = {
            let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
            let oldest = newest.saturating_sub(self.views * VIEW_DISTANCE);
            *kept = kept.split_off(&oldest.min(scene));
            Arc::clone(kept.entry(scene).or_default())
        };
        Arc::clone(place.get_or_init(|| Arc::new(self.stream.frame(scene as u64))))
    }
}

impl Dataset for SceneDataset {
    fn name(&self) -> String {
        format!("rendered scenes of seed {}", self.stream.seed)
    }

    fn len(&self) -> usize {
        self.frames_per_epoch
    }

    fn is_endless(&self) -> bool {
        true
    }

    fn id(&self, index: usize) -> String {
        SceneStream::id(index as u64)
    }

    fn image(&self, index: usize) -> Result<RgbImage, DatasetError> {
        Ok(self.stream.frame(index as u64).image)
    }

    fn camera(&self, index: usize) -> Result<Camera, DatasetError> {
        Ok(generate_scene(&self.stream.config, self.stream.seed, index as u64).scene.camera)
    }

    fn labels(&self, index: usize) -> Result<Vec<Label>, DatasetError> {
        Ok(self.stream.frame(index as u64).labels)
    }

    fn annotation_names(&self) -> Vec<&'static str> {
        vec![DepthMap::NAME, Plates::NAME]
    }

    fn annotations(&self, index: usize) -> Result<Annotations, DatasetError> {
        Ok(self.stream.frame(index as u64).annotations)
    }

    fn frame(&self, index: usize) -> Result<Arc<Frame>, DatasetError> {
        Ok(Arc::new(self.stream.frame(index as u64)))
    }

    fn item(&self, key: ItemKey) -> Result<Arc<Frame>, DatasetError> {
        let place = self.index_of(key);
        if self.views == 1 { self.frame(place) } else { Ok(self.kept_frame(self.scene_of(place), place / self.views)) }
    }
}
