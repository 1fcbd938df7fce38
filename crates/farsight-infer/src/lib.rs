//! Image in, detections out: the engine trait and the detector.
//!
//! An [`Engine`] turns a tensor into head maps and knows nothing else. A [`Detector`] does the rest, the same for every engine: it warps and
//! normalises the image, moves the camera with it, runs the engine and decodes.
//!
//! The shipped model with its refiner and the road plane, on one of the shipped scenes:
//!
//! ```
//! # #[cfg(feature = "rten")] {
//! use std::path::Path;
//!
//! use farsight_core::Camera;
//! use farsight_core::detection::DecodeOptions;
//! use farsight_core::road::Road;
//! use farsight_data::read_image;
//! use farsight_infer::{Detector, DetectorSpec, Refiner, RtenEngine};
//! use farsight_net::onnx::{OnnxModel, Target};
//! use farsight_net::refiner::RefinerModel;
//!
//! let top = Path::new("../..");
//! let model = OnnxModel::read_any(&top.join("models/farsight-s.safetensors"), Target::Portable)?;
//! let refiner = RefinerModel::read(&top.join("models/farsight-refiner.safetensors"))?;
//! let spec = DetectorSpec::new(model.config(), DecodeOptions::default());
//! let mut detector = Detector::new(Box::new(RtenEngine::new(model, None)?), spec)
//!     .with_refiner(Refiner::new(&refiner, None)?)
//!     .with_road(Road::Below);
//!
//! let image = read_image(&top.join("assets/scenes/image_2/000000.jpg"))?;
//! let camera = Camera::from_hfov(81.4, image.width() as usize, image.height() as usize)?;
//! let found = detector.detect(&image, &camera)?;
//! for object in &found {
//!     let sigma_m = object.range_sigma_m.unwrap_or(f64::NAN);
//!     println!("{} {:.1} m, give or take {sigma_m:.1} m", object.class, object.box3d.depth_m());
//! }
//! assert!(!found.is_empty());
//! # }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

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
#[cfg(feature = "rten")]
mod part;
pub mod peaks_head;
#[cfg(feature = "rten")]
pub mod plate;
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
pub use plate::PlateReader;
#[cfg(feature = "rten")]
pub use refiner::{Refiner, Sides};
#[cfg(feature = "rten")]
pub use rten::RtenEngine;
pub use spec::{DetectorSpec, UnfamiliarCamera};
pub use timing::StageTimes;
