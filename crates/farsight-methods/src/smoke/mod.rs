//! SMOKE: keypoints of projected 3D centres with eight regression channels each (Liu, Wu, Tóth 2020), with multi-scale
//! feature enhancement and the dynamic Gaussian heatmap as switches.

pub mod codec;
pub mod config;
pub mod corner_loss;
pub mod decode;
pub mod detector;
mod facts;
mod heads;
pub mod import;
pub mod network;
pub mod sensitivity;
pub mod sparse_head;
pub mod targets;
#[cfg(feature = "train")]
pub mod train;

use farsight_graph::model::Model;

pub use codec::Codec;
pub use config::{Quirks, SmokeConfig};
pub use decode::HeadMaps;
pub use detector::SmokeDetector;
pub use facts::DetectorFile;
pub use network::{FEATURES, LOGITS, REGRESSION, SURFACE};
pub use sparse_head::SparseHead;

/// A SMOKE network with its weights.
pub type SmokeModel = Model<SmokeConfig>;
