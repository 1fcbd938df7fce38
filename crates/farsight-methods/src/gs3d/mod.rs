//! GS3D (Li et al., *GS3D: An Efficient 3D Object Detection Framework for Autonomous Driving*, CVPR 2019): a 2D box and
//! the angle under which its object is seen give a cuboid by similar triangles ([`guidance`]); features of the cuboid's
//! visible faces ([`surfaces`]) say what is wrong with it ([`refinement`]).
//!
//! A method of two graphs: the first finds 2D boxes and angles, the second looks at each of them again. There is no
//! public code; what the paper leaves open and what differs: `docs/rivals.md`.

pub mod boxes;
pub mod config;
pub mod decode;
mod detector;
pub mod guidance;
pub mod network;
pub mod refinement;
pub mod surfaces;
pub mod targets;
#[cfg(feature = "train")]
pub mod train;

use farsight_graph::model::Model;

pub use config::Gs3dConfig;

/// A GS3D with its weights.
pub type Gs3dModel = Model<Gs3dConfig>;
