//! `OFTNet` (Roddick, Kendall and Cipolla, *Orthographic Feature Transform for Monocular 3D Object Detection*, BMVC
//! 2019): what the image shows is carried onto a grid on the ground, where a second network looks for objects from
//! above.
//!
//! A method of two graphs: the first makes three maps of the image, a sampler takes their means over what each voxel
//! above the ground is seen as ([`sampler`]), the second works on the grid. What follows the authors and what differs:
//! `docs/rivals.md`.

pub mod codec;
pub mod config;
pub mod decode;
mod detector;
pub mod grid;
pub mod network;
pub mod sampler;
pub mod targets;
#[cfg(feature = "train")]
pub mod train;

use farsight_graph::model::Model;

pub use config::OftNetConfig;

/// An `OFTNet` with its weights.
pub type OftNetModel = Model<OftNetConfig>;
