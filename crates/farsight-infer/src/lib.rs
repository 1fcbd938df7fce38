//! Image in, detections out: the engine trait and the detector.
//!
//! An [`Engine`] turns a tensor into head maps and knows nothing else. A [`Detector`] does the rest, the same for every engine: it warps and
//! normalises the image, moves the camera with it, runs the engine and decodes.

#[cfg(feature = "rten")]
pub mod calibration;
#[cfg(feature = "rten")]
pub mod damage;
pub mod detector;
pub mod engine;
#[cfg(any(feature = "rten", feature = "onnxruntime", feature = "openvino"))]
pub mod library;
#[cfg(feature = "onnxruntime")]
pub mod onnxruntime;
#[cfg(feature = "openvino")]
pub mod openvino;
pub mod peaks_head;
pub mod probe;
#[cfg(feature = "rten")]
pub mod refiner;
#[cfg(feature = "rten")]
pub mod rten;
pub mod spec;
pub mod timing;

#[cfg(feature = "rten")]
pub use calibration::Calibration;
#[cfg(feature = "rten")]
pub use damage::{Answers, Damage};
pub use detector::{DetectError, Detector};
pub use engine::{Engine, EngineError};
#[cfg(feature = "onnxruntime")]
pub use onnxruntime::OrtEngine;
#[cfg(feature = "openvino")]
pub use openvino::{OpenvinoEngine, OpenvinoPrecision};
pub use peaks_head::PeaksHead;
#[cfg(feature = "rten")]
pub use refiner::{Refiner, Sides};
#[cfg(feature = "rten")]
pub use rten::RtenEngine;
pub use spec::{DetectorSpec, UnfamiliarCamera};
pub use timing::StageTimes;
