//! Engines by name, and networks started on them: the one place where a network becomes one that runs.

use std::path::Path;
use std::thread::available_parallelism;

use farsight_graph::model::{Model, NetworkConfig};
use farsight_graph::transform::Network;
use farsight_methods::detectors::{self, NetworkForm};
use farsight_methods::method::Method;
use farsight_methods::roi::RoiRunner;
use farsight_onnx::OnnxModel;
use farsight_runtime::{Device, FiniteRunner, RtenRunner, Runner, SessionOptions, onnxruntime, openvino};

use crate::Error;
use crate::engine_options::{EngineKind, EngineOptions, Precision};
use crate::libraries::{Library, data_folder};
use crate::libtorch;

/// The folder of the user's data folder in which networks are kept as OpenVINO compiled them.
const COMPILED: &str = "compiled";

impl EngineOptions {
    /// Threads of the network that are started: more than the machine runs at once make nothing faster. None is one for
    /// each core.
    pub fn usable_threads(&self) -> Option<usize> {
        let cores = available_parallelism().map_or(usize::MAX, std::num::NonZero::get);
        self.threads.map(|threads| threads.clamp(1, cores))
    }

    /// Options of another engine than the one that is asked for would be ignored without a word.
    ///
    /// # Errors
    /// When there are such, or libtorch is asked for and not built in.
    pub fn check(&self) -> Result<(), Error> {
        if self.kind == EngineKind::Libtorch && !libtorch::IS_BUILT_IN {
            return Err(Error::NoLibtorch);
        }
        let unused = |option, expected| Error::Option { option, engine: self.kind, expected };
        if self.library.is_some() && self.kind.library().is_none() {
            return Err(unused("a library", "onnxruntime or openvino"));
        }
        self.check_device()?;
        match (self.precision, self.kind) {
            (Precision::F32, _) | (_, EngineKind::OpenVino) | (Precision::Int8, EngineKind::OnnxRuntime) => Ok(()),
            (Precision::Bf16, _) => Err(unused("bfloat16", "openvino")),
            (Precision::Int8, _) => Err(unused("computing in 8 bits", "onnxruntime or openvino")),
        }
    }

    /// Refuses a device that the engine has not got, and numbers that the device does not compute in.
    ///
    /// # Errors
    /// When there are such.
    pub fn check_device(&self) -> Result<(), Error> {
        let (device, precision) = (self.device, self.precision);
        let expected = match device {
            Device::Cpu => return Ok(()),
            Device::Cuda | Device::TensorRt => EngineKind::OnnxRuntime,
            Device::Gpu => EngineKind::OpenVino,
        };
        if self.kind == EngineKind::Libtorch {
            let expected = "onnxruntime or openvino; libtorch takes the first GPU by itself";
            return Err(Error::Option { option: "a device", engine: self.kind, expected });
        }
        if self.kind != expected {
            return Err(Error::Device { device, engine: self.kind, expected });
        }
        let is_computed = match precision {
            Precision::F32 => true,
            Precision::Bf16 => false,
            Precision::Int8 => device != Device::Cuda,
        };
        if is_computed { Ok(()) } else { Err(Error::DevicePrecision { precision, device }) }
    }

    /// In which form networks are started.
    pub(crate) fn form(&self) -> NetworkForm {
        if self.precision == Precision::Int8 { NetworkForm::Int8 } else { NetworkForm::Deployable }
    }

    /// Starts a network in its ONNX form; `source` is only what errors call it. Answers of it that are not finite are
    /// errors.
    ///
    /// # Errors
    /// When the engine's library is not there, or the engine fails or has no such network; libtorch runs no ONNX files.
    pub fn start(&self, network: OnnxModel, source: &Path) -> Result<Box<dyn Runner>, Error> {
        Ok(Box::new(FiniteRunner::new(self.started(network, source)?, source)))
    }

    /// Starts a network as it was trained on libtorch, as [`EngineOptions::start`] does on other engines.
    ///
    /// # Errors
    /// When libtorch is not built in or refuses the network.
    pub(crate) fn start_libtorch_network(&self, network: &Network, source: &Path) -> Result<Box<dyn Runner>, Error> {
        Ok(Box::new(FiniteRunner::new(libtorch::start_network(self, network)?, source)))
    }

    /// Starts a model file of our own on libtorch, as [`EngineOptions::start`] does on other engines.
    ///
    /// # Errors
    /// When libtorch is not built in or refuses the network.
    pub(crate) fn start_libtorch<C: NetworkConfig>(
        &self,
        model: &Model<C>,
        source: &Path,
    ) -> Result<Box<dyn Runner>, Error> {
        Ok(Box::new(FiniteRunner::new(libtorch::start(self, model)?, source)))
    }

    fn started(&self, network: OnnxModel, source: &Path) -> Result<Box<dyn Runner>, Error> {
        self.check()?;
        if network.has_deform_conv() && self.kind != EngineKind::OnnxRuntime {
            return Err(Error::DeformConv(source.to_owned()));
        }
        let options = SessionOptions {
            threads: self.usable_threads(),
            sharers: self.at_once(),
            float: self.precision.of_float_layers(),
            device: self.device,
        };
        match self.kind {
            EngineKind::Rten => Ok(Box::new(RtenRunner::new(network, options.threads)?)),
            EngineKind::OnnxRuntime => {
                let library = Library::OnnxRuntime.find(self.library.as_deref())?.path;
                onnxruntime::open(&library, network, options).map_err(|source| Error::EngineLibrary { library, source })
            }
            EngineKind::OpenVino => {
                let library = Library::OpenVino.find(self.library.as_deref())?.path;
                let compiled = data_folder().map(|folder| folder.join(COMPILED));
                openvino::open(&library, network, options, compiled.as_deref())
                    .map_err(|source| Error::EngineLibrary { library, source })
            }
            EngineKind::Libtorch => Err(libtorch::no_onnx().into()),
        }
    }

    /// Starts the network of a second stage.
    ///
    /// # Errors
    /// As [`EngineOptions::start`].
    pub fn start_second_stage<C: Method>(&self, model: &Model<C>) -> Result<RoiRunner, Error> {
        Ok(RoiRunner::new(self.start_small(model)?))
    }

    /// Starts a network that is no detector.
    pub(crate) fn start_small<C: Method>(&self, model: &Model<C>) -> Result<Box<dyn Runner>, Error> {
        let name = Path::new(C::NAME);
        match self.kind {
            EngineKind::Libtorch => self.start_libtorch(model, name),
            kind => self.start(detectors::in_form(model, self.form(), kind.target(), name)?, name),
        }
    }
}
