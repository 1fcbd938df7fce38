//! How a network is to run on an engine whose library is loaded at run time.

use std::fmt;

/// What a network computes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Device {
    /// The processor.
    #[default]
    Cpu,
    /// An NVIDIA GPU, by ONNX Runtime's CUDA provider.
    Cuda,
    /// An NVIDIA GPU, by ONNX Runtime's TensorRT provider; CUDA has what TensorRT has not.
    TensorRt,
    /// Intel's GPU, by OpenVINO.
    Gpu,
}

impl Device {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Cpu, Self::Cuda, Self::TensorRt, Self::Gpu];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::TensorRt => "tensorrt",
            Self::Gpu => "gpu",
        }
    }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// How a network is to run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SessionOptions {
    /// Threads of the network on the CPU; one for each core by default.
    pub threads: Option<usize>,
    /// How many sharers run at the same time; more wait for each other. 0 is 1.
    pub sharers: usize,
    /// Whether it computes in bfloat16 where the device has it.
    pub bf16: bool,
    /// What it computes on.
    pub device: Device,
}
