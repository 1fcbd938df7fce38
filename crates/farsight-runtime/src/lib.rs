//! Tensors in, tensors out: what runs a network.
//!
//! A [`Runner`] is one network, ready to run; there is one file for each engine, and it alone knows the engine's
//! library. What the tensors mean is the business of the method that the network belongs to.

pub mod calibration;
#[cfg(feature = "openvino")]
mod compiled_cache;
mod convolution;
pub mod elf;
pub mod finite;
pub mod library;
pub mod onnxruntime;
pub mod openvino;
mod plan;
pub mod probe;
pub mod rten;
pub mod runner;
pub mod session_options;
#[cfg(any(feature = "onnxruntime", feature = "openvino"))]
mod spare;
pub mod timing;

pub use calibration::Calibration;
pub use finite::FiniteRunner;
pub use rten::RtenRunner;
pub use runner::{EngineError, Runner, Tensor, TensorView};
pub use session_options::{Device, FloatPrecision, SessionOptions};
pub use timing::StageTimes;
