//! What a run learns from, in a few hashes: a run that goes on with other data than it began with is told so.

use std::fs;

use farsight_data::{Dataset, DatasetError};
use farsight_graph::weights::hexadecimal;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// The data of a run and the program that made its steps. Where the data lie plays no part: a folder may be moved.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// Version of the program.
    pub program: String,
    /// Frames of an epoch.
    pub frames: usize,
    /// SHA-256 of the names of the frames.
    pub names: String,
    /// SHA-256 of the sizes of their image files; of rendered scenes, of the first one's pixels.
    pub images: String,
    /// SHA-256 of their cameras and labels; of rendered scenes, of the first one's.
    pub labels: String,
}

impl Fingerprint {
    /// Of the first `frames` frames of `dataset`. Of rendered scenes the first one stands for all: they follow from the
    /// config, which a checkpoint knows.
    ///
    /// # Errors
    /// When a camera or labels cannot be read.
    pub fn of(dataset: &dyn Dataset, frames: usize) -> Result<Self, DatasetError> {
        let (mut names, mut images, mut labels) = (Sha256::new(), Sha256::new(), Sha256::new());
        let looked_at = if dataset.is_endless() { frames.min(1) } else { frames };
        for index in 0..looked_at {
            names.update(dataset.id(index) + "\n");
            if dataset.is_endless() {
                images.update(dataset.image(index)?.as_raw());
            } else {
                // No file, no size: frames in memory.
                let size = fs::metadata(dataset.origin(index)).map_or(0, |file| file.len());
                images.update(size.to_le_bytes());
            }
            labels.update(format!("{:?} {:?}\n", dataset.camera(index)?, dataset.labels(index)?));
        }
        let [names, images, labels] = [names, images, labels].map(|hash| hexadecimal(&hash.finalize()));
        Ok(Self { program: env!("CARGO_PKG_VERSION").to_owned(), frames, names, images, labels })
    }

    /// What differs between the beginning of a run and `now`, in words.
    pub fn differences(&self, now: &Self) -> Vec<String> {
        let mut differences = Vec::new();
        if self.program != now.program {
            differences.push(format!("farsight {} began it, this is {}", self.program, now.program));
        }
        if self.frames != now.frames {
            differences.push(format!("it had {} frames, now there are {}", self.frames, now.frames));
        }
        let hashes = [
            (&self.names, &now.names, "the frames have other names"),
            (&self.images, &now.images, "the images are others"),
            (&self.labels, &now.labels, "labels or cameras are others"),
        ];
        differences.extend(hashes.into_iter().filter(|(then, now, _)| then != now).map(|(_, _, told)| told.to_owned()));
        differences
    }
}
