//! ONNX files: networks of ours written for other engines, and what a file says about itself.
//!
//! A file holds the network of a model in its deployable form, and in its metadata all that is needed to use it. Only
//! files of this kind are read; see [`OnnxModel`] for what a file from a stranger cannot do.

mod bounded;
mod deform;
mod error;
mod facts;
mod field;
mod head_names;
mod limits;
mod local_head;
mod parts;
mod proto;
mod quantized;
mod read;
mod seal;
mod steps;
mod wire;
mod write;

pub use error::{OnnxError, OnnxProblem};
pub use facts::{Facts, key};
pub use local_head::{HeadLayer, LocalHeadFile};
pub use read::{OnnxModel, TensorInfo, int8_outputs, is_safetensors};
pub use steps::{Convolution, ConvolutionKind, Step, Subgraph};
pub use wire::WireError;
pub use write::{write, write_quantized};

/// Name of the one input.
pub const INPUT: &str = "image";

/// For which engines a file is meant. Networks are the same for both that have no deformable convolutions, and no
/// learnt upsampling in 8 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Target {
    /// Deformable convolutions from `GridSample`, which all engines have.
    #[default]
    Portable,
    /// Deformable convolutions as `DeformConv`, which ONNX Runtime has and is faster; upsampling in 8 bits without
    /// `DepthToSpace`, in which ONNX Runtime is slow.
    OnnxRuntime,
}

impl Target {
    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::OnnxRuntime => "onnxruntime",
        }
    }
}
