//! Where training frames come from: a data set in KITTI's layout, or rendered scenes without end.

use std::fmt::Debug;
use std::sync::{Arc, OnceLock};

use farsight_data::kitti::dataset::DatasetError;
use farsight_data::{Frame, ItemKey, KittiDataset};
use farsight_synth::SceneStream;

/// Gives the frame of an item, the same whenever it is asked for.
pub trait FrameSource: Debug + Send + Sync {
    /// Frames in an epoch.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether its frames list the number plates that they show.
    fn knows_plates(&self) -> bool;

    /// The frame that `key` stands for.
    ///
    /// # Errors
    /// When it cannot be read.
    fn frame(&self, key: ItemKey) -> Result<Arc<Frame>, DatasetError>;
}

/// The frames of a data set, the same in every epoch.
#[derive(Debug)]
pub struct KittiSource {
    dataset: KittiDataset,
    cache: Option<Vec<OnceLock<Arc<Frame>>>>,
}

impl KittiSource {
    /// Frames of `dataset`; with `cache`, decoded frames stay in main memory.
    pub fn new(dataset: KittiDataset, cache: bool) -> Self {
        let cache = cache.then(|| (0..dataset.len()).map(|_| OnceLock::new()).collect());
        Self { dataset, cache }
    }
}

impl FrameSource for KittiSource {
    fn len(&self) -> usize {
        self.dataset.len()
    }

    fn knows_plates(&self) -> bool {
        self.dataset.knows_plates()
    }

    fn frame(&self, key: ItemKey) -> Result<Arc<Frame>, DatasetError> {
        let load = || self.dataset.load(key.index).map(Arc::new);
        match &self.cache {
            None => load(),
            Some(cache) => match cache[key.index].get() {
                Some(frame) => Ok(Arc::clone(frame)),
                None => load().map(|frame| Arc::clone(cache[key.index].get_or_init(|| frame))),
            },
        }
    }
}

/// Rendered scenes: every frame of every epoch is a new one, made when it is asked for.
#[derive(Debug)]
pub struct RenderedSource {
    stream: SceneStream,
    frames: usize,
}

impl RenderedSource {
    /// Scenes of `stream`, `frames` an epoch.
    pub fn new(stream: SceneStream, frames: usize) -> Self {
        Self { stream, frames }
    }
}

impl FrameSource for RenderedSource {
    fn len(&self) -> usize {
        self.frames
    }

    fn knows_plates(&self) -> bool {
        true
    }

    fn frame(&self, key: ItemKey) -> Result<Arc<Frame>, DatasetError> {
        Ok(Arc::new(self.stream.frame(key.epoch * self.frames as u64 + key.index as u64)))
    }
}
