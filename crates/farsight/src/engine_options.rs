//! Engines by name, and how they are to run.

use std::fmt;
use std::path::PathBuf;

use farsight_onnx::Target;

use crate::libraries::Library;

/// What runs a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum EngineKind {
    /// Pure Rust, always there.
    #[default]
    Rten,
    /// Microsoft's library.
    OnnxRuntime,
    /// Intel's library.
    OpenVino,
    /// PyTorch's library, on the GPU when there is one; needs the feature `train`.
    Libtorch,
}

impl EngineKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Rten, Self::OnnxRuntime, Self::OpenVino, Self::Libtorch];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rten => "rten",
            Self::OnnxRuntime => "onnxruntime",
            Self::OpenVino => "openvino",
            Self::Libtorch => "libtorch",
        }
    }

    /// The shared library that it needs, where it needs one.
    pub fn library(self) -> Option<Library> {
        match self {
            Self::OnnxRuntime => Some(Library::OnnxRuntime),
            Self::OpenVino => Some(Library::OpenVino),
            Self::Rten | Self::Libtorch => None,
        }
    }

    /// The form of ONNX files that suits it.
    pub fn target(self) -> Target {
        match self {
            Self::OnnxRuntime => Target::OnnxRuntime,
            _ => Target::Portable,
        }
    }
}

impl fmt::Display for EngineKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// In which numbers the engine computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// Single precision.
    #[default]
    F32,
    /// bfloat16 where the CPU has it: faster, two to three digits. Only OpenVINO has it.
    Bf16,
}

/// Which engine, and how it is to run.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct EngineOptions {
    /// What runs the network.
    pub kind: EngineKind,
    /// Its shared library, or the folder that it is in; looked for when it is not named ([`Library::find`]).
    pub library: Option<PathBuf>,
    /// Threads of the network; one for each core by default, and at most that.
    pub threads: Option<usize>,
    /// In which numbers it computes.
    pub precision: Precision,
}

impl From<EngineKind> for EngineOptions {
    fn from(kind: EngineKind) -> Self {
        Self { kind, ..Self::default() }
    }
}
