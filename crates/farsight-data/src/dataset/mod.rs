//! Data sets: frames with pixels, camera and labels, whatever they come from.
//!
//! [`Dataset`] is what training, evaluation and fitting ask for. A folder in KITTI's layout
//! ([`KittiDataset`](crate::KittiDataset)), a folder of images ([`ImageFolder`]) and frames in memory
//! ([`MemoryDataset`]) are data sets, and so are rendered scenes (`farsight_synth::SceneDataset`). [`CachedDataset`]
//! keeps the frames of another one in memory; it is a [`DatasetLayer`], as all that stand over another one are.
//!
//! A new kind of data set is one file with an implementation, and one line in [`FORMATS`](crate::formats::FORMATS), so
//! that [`open_dataset`](crate::open_dataset) knows its folders. [`check_laws`] says what must hold of it.

mod cached;
mod error;
mod format;
mod image_folder;
mod laws;
mod layer;
mod memory;

use std::fmt::Debug;
use std::path::PathBuf;
use std::sync::Arc;

use farsight_core::road::RoadPlane;
use farsight_core::{Camera, Label, Pose};
use image::RgbImage;

use crate::annotations::{Annotation, Annotations};
use crate::frame::Frame;
use crate::loader::ItemKey;

pub use cached::CachedDataset;
pub use error::DatasetError;
pub use format::{DatasetFormat, Opener};
pub use image_folder::{FolderCamera, ImageFolder, ImageFolderError};
pub use laws::check_laws;
pub use layer::DatasetLayer;
pub use memory::MemoryDataset;

/// Frames by number, each the same whenever it is asked for, on any thread.
///
/// Reading the camera or the labels of a frame does not read its pixels, where they are stored apart. Objects have the
/// classes of [`farsight_core`]; a data set with names of its own maps them ([`ClassMap`](crate::ClassMap)).
///
/// # Panics
/// Readers of a frame panic when there is none of that number, as slices do.
pub trait Dataset: Debug + Send + Sync {
    /// What messages call it: the folder, if it has one.
    fn name(&self) -> String;

    /// Frames in an epoch; their numbers start at 0.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether it goes on behind [`len`](Self::len): frames of any number exist, and every epoch has new ones.
    fn is_endless(&self) -> bool {
        false
    }

    /// Name of a frame, which is a good name of a file.
    fn id(&self, index: usize) -> String;

    /// Names of the frames of an epoch, each another one.
    fn ids(&self) -> Vec<String> {
        (0..self.len()).map(|index| self.id(index)).collect()
    }

    /// Where a frame comes from, for messages: its image file, if it has one.
    fn origin(&self, index: usize) -> String {
        format!("{}: frame {}", self.name(), self.id(index))
    }

    /// The pixels of a frame.
    ///
    /// # Errors
    /// When they cannot be read.
    fn image(&self, index: usize) -> Result<RgbImage, DatasetError>;

    /// The camera of a frame's image.
    ///
    /// # Errors
    /// When it cannot be read.
    fn camera(&self, index: usize) -> Result<Camera, DatasetError>;

    /// The road under a frame's camera, if somebody has calibrated it.
    ///
    /// # Errors
    /// When it cannot be read.
    fn road(&self, index: usize) -> Result<Option<RoadPlane>, DatasetError> {
        let _ = index;
        Ok(None)
    }

    /// Whether somebody has said what its frames show. Otherwise all labels are empty.
    fn is_labelled(&self) -> bool {
        true
    }

    /// The objects in a frame.
    ///
    /// # Errors
    /// When they cannot be read.
    fn labels(&self, index: usize) -> Result<Vec<Label>, DatasetError>;

    /// When a frame was taken, as [`Frame::timestamp_ns`], if that is known.
    ///
    /// # Errors
    /// When it cannot be read.
    fn timestamp_ns(&self, index: usize) -> Result<Option<i64>, DatasetError> {
        let _ = index;
        Ok(None)
    }

    /// Where the camera was, as [`Frame::world_from_camera`], if that is known.
    ///
    /// # Errors
    /// When it cannot be read.
    fn world_from_camera(&self, index: usize) -> Result<Option<Pose>, DatasetError> {
        let _ = index;
        Ok(None)
    }

    /// Names of the kinds of annotations that its frames have, sorted.
    fn annotation_names(&self) -> Vec<&'static str> {
        Vec::new()
    }

    /// What else is known of a frame.
    ///
    /// # Errors
    /// When it cannot be read.
    fn annotations(&self, index: usize) -> Result<Annotations, DatasetError> {
        let _ = index;
        Ok(Annotations::default())
    }

    /// All of a frame.
    ///
    /// # Errors
    /// When something of it cannot be read.
    fn frame(&self, index: usize) -> Result<Arc<Frame>, DatasetError> {
        Ok(Arc::new(Frame {
            id: self.id(index),
            image: self.image(index)?,
            camera: self.camera(index)?,
            road: self.road(index)?,
            labels: self.labels(index)?,
            timestamp_ns: self.timestamp_ns(index)?,
            world_from_camera: self.world_from_camera(index)?,
            annotations: self.annotations(index)?,
        }))
    }

    /// Number of the frame that an item of an epoch is.
    fn index_of(&self, key: ItemKey) -> usize {
        if self.is_endless() { key.epoch as usize * self.len() + key.index } else { key.index }
    }

    /// The frame that an item of an epoch is.
    ///
    /// # Errors
    /// When something of it cannot be read.
    fn item(&self, key: ItemKey) -> Result<Arc<Frame>, DatasetError> {
        self.frame(self.index_of(key))
    }

    /// Folders that its files lie in, where nothing else is to be written.
    fn folders(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// The folder of its label files, if [`labels`](Self::labels) are what KITTI's label files there say.
    fn label_folder(&self) -> Option<PathBuf> {
        None
    }
}

impl dyn Dataset {
    /// Whether its frames have annotations of this kind.
    pub fn has<A: Annotation>(&self) -> bool {
        self.annotation_names().contains(&A::NAME)
    }
}
