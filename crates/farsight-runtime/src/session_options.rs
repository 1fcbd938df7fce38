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

/// In which numbers layers that are not in 8 bits are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FloatPrecision {
    /// Single precision.
    #[default]
    F32,
    /// bfloat16 where the device has it.
    Bf16,
    /// What the device is fastest in: bfloat16 where the processor has instructions for it, else single precision.
    Fastest,
}

/// How a network is to run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SessionOptions {
    /// Threads of the network on the CPU; one for each core by default.
    pub threads: Option<usize>,
    /// How many sharers run at the same time; more wait for each other. 0 is 1.
    pub sharers: usize,
    /// In which numbers it computes. ONNX Runtime knows single precision alone.
    pub float: FloatPrecision,
    /// What it computes on.
    pub device: Device,
}
