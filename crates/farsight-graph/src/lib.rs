//! A network as data: one description, many readers.
//!
//! [`graph::Graph`] lists typed nodes; [`layers`] has the builders of backbones, necks and blocks that append to such a
//! list; [`weights::Weights`] maps parameter names to numbers; a [`model::Model`] is a graph with its weights, in one
//! file that says of which method it is. Everything else reads these: [`count`], [`transform`] (the same answers with
//! less), [`prune`] and [`quantize`] here; ONNX files and the libtorch executor in their own crates.

pub mod blocks;
pub mod count;
pub mod graph;
pub mod init;
pub mod layers;
mod live;
pub mod model;
pub mod prune;
pub mod quantize;
pub mod transform;
pub mod weights;
