//! Where models come from.

use std::path::{Path, PathBuf};

use farsight_onnx::OnnxModel;

use crate::model_file;
use crate::shipped::Family;

/// Where the detector comes from.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum ModelSource {
    /// One that comes with the library.
    Shipped(Family),
    /// A file that `farsight train`, `farsight import` or `farsight export` wrote.
    File(PathBuf),
    /// A detector's network in memory.
    Memory {
        /// The network, or what of it is before its first sampler.
        onnx: Box<OnnxModel>,
        /// What comes after each sampler.
        later: Vec<OnnxModel>,
        /// What errors call it.
        name: PathBuf,
    },
}

impl Default for ModelSource {
    fn default() -> Self {
        Self::Shipped(Family::default())
    }
}

impl ModelSource {
    /// A file, or a shipped model by its word: its name, or [`model_file::SHIPPED`] for the one that is used unless
    /// another is named.
    pub fn from_word(word: impl Into<PathBuf>) -> Self {
        let path = word.into();
        model_file::shipped_detector(&path).map_or(Self::File(path), Self::Shipped)
    }

    /// What errors and records call it.
    pub fn name(&self) -> &Path {
        match self {
            Self::Shipped(family) => Path::new(family.name()),
            Self::File(path) => path,
            Self::Memory { name, .. } => name,
        }
    }
}

/// Where a second stage comes from.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum StageSource {
    /// The one that comes with the library, with what it was made for: the refiner with the shipped detector's weights,
    /// the plate reader where the shipped refiner is used with them.
    #[default]
    Default,
    /// None.
    Off,
    /// The one that comes with the library.
    Shipped,
    /// A file that `farsight train` wrote.
    File(PathBuf),
}

impl StageSource {
    /// A file, or the words `none` and `shipped`.
    pub fn from_word(word: impl Into<PathBuf>) -> Self {
        let path = word.into();
        if path == Path::new("none") {
            Self::Off
        } else if path == Path::new(model_file::SHIPPED) {
            Self::Shipped
        } else {
            Self::File(path)
        }
    }

    /// Whether there is to be one, whatever the detector is.
    pub(crate) fn is_asked_for(&self) -> bool {
        matches!(self, Self::Shipped | Self::File(_))
    }
}
