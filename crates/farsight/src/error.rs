//! Why there is no pipeline.

use std::path::PathBuf;

use farsight_core::Region;
use farsight_graph::model::ModelError;
use farsight_methods::detectors::ReadError;
use farsight_onnx::OnnxError;
use farsight_runtime::EngineError;
use thiserror::Error;

use crate::engine_options::{Device, EngineKind, Precision};
use crate::libraries::LibraryError;

/// A pipeline that cannot be opened.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// A file is plainly no model.
    #[error("{}: {found}; expected {expected}", path.display())]
    Kind {
        /// The file.
        path: PathBuf,
        /// What it is.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// A model file of our own could not be read.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A detector's file could not be read.
    #[error(transparent)]
    Detector(#[from] ReadError),
    /// A network has no ONNX form, or a file is none of ours.
    #[error(transparent)]
    Onnx(#[from] OnnxError),
    /// The engine's shared library was not found.
    #[error(transparent)]
    Library(#[from] LibraryError),
    /// The engine's shared library was found and failed.
    #[error("{}: {source}", library.display())]
    EngineLibrary {
        /// The library.
        library: PathBuf,
        /// What it says.
        source: EngineError,
    },
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The engine libtorch needs the feature `train`.
    #[error(
        "this farsight was built without libtorch; `cargo xtask libtorch` fetches it, `cargo xtask run range ...` builds and runs with it"
    )]
    NoLibtorch,
    /// Deformable convolutions in the form of another engine.
    #[error("{}: its deformable convolutions are in the form that only ONNX Runtime has; export it with --target portable, or say --engine onnxruntime", .0.display())]
    DeformConv(PathBuf),
    /// An option that means nothing to the engine that was asked for.
    #[error("{option} is not for the engine {engine}; expected {expected}")]
    Option {
        /// The option.
        option: &'static str,
        /// The engine.
        engine: EngineKind,
        /// The engines that have it.
        expected: &'static str,
    },
    /// A device that the engine has not got.
    #[error("the engine {engine} has no device {device}; {expected} has")]
    Device {
        /// The device.
        device: Device,
        /// The engine that was asked for.
        engine: EngineKind,
        /// The engine that has it.
        expected: EngineKind,
    },
    /// Numbers that the device does not compute in.
    #[error("the device {device} does not compute in {precision}; expected f32, or int8 with tensorrt or gpu")]
    DevicePrecision {
        /// The numbers.
        precision: Precision,
        /// The device.
        device: Device,
    },
    /// A region, with a refiner that was not fitted by regions.
    #[error("{}: the region {region} is asked for, with a refiner that was not fitted by regions; \"farsight-w\" has one that was", model.display())]
    NoRegions {
        /// The model.
        model: PathBuf,
        /// The region.
        region: Region,
    },
    /// What needs error bars, with a model that has none.
    #[error("{}: a model without error bars, which {stage} goes by; `farsight export --fit-on` fits them", model.display())]
    NoErrorBars {
        /// The model.
        model: PathBuf,
        /// What needs them.
        stage: &'static str,
    },
}
