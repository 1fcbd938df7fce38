//! Tensors in, tensors out: what runs a network.
//!
//! A [`Runner`] is one network, ready to run; there is one file for each engine, and it alone knows the engine's library. What the tensors mean is the
//! business of the method that the network belongs to.

#[cfg(feature = "rten")]
pub mod calibration;
pub mod library;
#[cfg(feature = "onnxruntime")]
pub mod onnxruntime;
#[cfg(feature = "openvino")]
pub mod openvino;
pub mod probe;
#[cfg(feature = "rten")]
pub mod rten;
pub mod runner;
pub mod timing;

#[cfg(feature = "rten")]
pub use calibration::Calibration;
#[cfg(feature = "onnxruntime")]
pub use onnxruntime::OrtRunner;
#[cfg(feature = "openvino")]
pub use openvino::{OpenvinoPrecision, OpenvinoRunner};
#[cfg(feature = "rten")]
pub use rten::RtenRunner;
pub use runner::{EngineError, Runner, Tensor, TensorView};
pub use timing::StageTimes;
