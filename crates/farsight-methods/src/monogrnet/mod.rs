//! `MonoGRNet` (Qin et al., *A Geometric Reasoning Network for Monocular 3D Object Localization*, AAAI 2019):
//! each cell of a coarse grid says whether an object is there, its 2D box, its depth and where the centre of its 3D box
//! is seen. Features at the 2D box refine that and give the eight corners; features at what is seen of them move the
//! corners once more.
//!
//! A method of three graphs with two samplers. What follows the authors and what differs: `docs/rivals.md`.

pub mod codec;
pub mod config;
pub mod decode;
mod detector;
pub mod layout;
pub mod network;
pub mod sampler;
pub mod targets;
#[cfg(feature = "train")]
pub mod train;

use farsight_graph::model::Model;

pub use config::MonoGrNetConfig;

/// A `MonoGRNet` with its weights.
pub type MonoGrNetModel = Model<MonoGrNetConfig>;
