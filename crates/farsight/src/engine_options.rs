//! Engines by name, and how they are to run.

use std::fmt;
use std::num::NonZero;
use std::path::PathBuf;
use std::thread::available_parallelism;

use farsight_onnx::Target;
pub use farsight_runtime::Device;
use farsight_runtime::FloatPrecision;

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
    /// Convolutions in 8 bits, with the ranges that model files keep. ONNX Runtime and OpenVINO have it. What is left
    /// in float OpenVINO computes in bfloat16 where the CPU has instructions for it.
    Int8,
}

impl Precision {
    /// In which numbers layers compute that are not in 8 bits. Beside layers in 8 bits two or three digits are enough.
    pub(crate) fn of_float_layers(self) -> FloatPrecision {
        match self {
            Self::F32 => FloatPrecision::F32,
            Self::Bf16 => FloatPrecision::Bf16,
            Self::Int8 => FloatPrecision::Fastest,
        }
    }
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::F32 => "f32",
            Self::Bf16 => "bf16",
            Self::Int8 => "int8",
        })
    }
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
    /// What it computes on. libtorch takes the first GPU by itself.
    pub device: Device,
    /// How many threads use the network at the same time, each as a sharer of its own; one by default.
    pub side_by_side: Option<usize>,
}

/// With more images at once a machine with many cores would only hold more memory.
const MAX_SIDE_BY_SIDE: usize = 4;

impl EngineOptions {
    /// As these, for so many images: neighbouring ones are looked at side by side, with the threads that are asked for
    /// in each network, or with a share of the cores. Two networks of one thread do more than one of two.
    ///
    /// libtorch has its threads in common, and a GPU all have in common: there it is one image after the other.
    /// OpenVINO hands each network to a thread of its own, so one more image keeps the cores at work meanwhile.
    #[must_use]
    pub fn for_images(self, images: usize) -> Self {
        let cores = available_parallelism().map_or(1, NonZero::get);
        let wanted = cores / self.threads.unwrap_or(1).max(1);
        let count = wanted.min(images).clamp(1, MAX_SIDE_BY_SIDE);
        if count == 1 || self.kind == EngineKind::Libtorch || self.device != Device::Cpu {
            return self;
        }
        let ahead = usize::from(self.kind == EngineKind::OpenVino && count < images);
        Self { threads: self.threads.or(Some(cores / count)), side_by_side: Some(count + ahead), ..self }
    }

    /// For how many of those that use the network it runs at once: as many as there are cores for.
    pub(crate) fn at_once(&self) -> usize {
        let cores = available_parallelism().map_or(1, NonZero::get);
        let most = cores / self.threads.unwrap_or(1).max(1);
        self.side_by_side.unwrap_or(1).clamp(1, most.max(1))
    }
}

impl From<EngineKind> for EngineOptions {
    fn from(kind: EngineKind) -> Self {
        Self { kind, ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn openvino_has_one_image_more_than_it_runs_for() {
        let cores = available_parallelism().map_or(1, NonZero::get);
        for images in [1, 2, 3, 100] {
            let [rten, openvino] = [EngineKind::Rten, EngineKind::OpenVino].map(|kind| {
                let options = EngineOptions::from(kind).for_images(images);
                assert!(options.at_once() * options.threads.unwrap_or(1) <= cores, "{options:?}");
                options.side_by_side.unwrap_or(1)
            });
            let is_one_more = rten > 1 && rten < images;
            assert_eq!(openvino, rten + usize::from(is_one_more), "{images} images");
            assert!(openvino <= images);
        }
    }
}
