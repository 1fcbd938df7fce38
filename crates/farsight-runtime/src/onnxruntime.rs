//! ONNX Runtime, loaded at run time: the fastest engine on most CPUs. Only this file knows whether it is compiled in.
//!
//! Its sessions cannot run for two threads at once, so each sharer has a session of its own, made when it first runs.
//! Sessions share no weights: ONNX Runtime packs them for itself (its container for shared packed weights takes only
//! initializers that are handed over one by one, beside the file).

#[cfg(not(feature = "onnxruntime"))]
use absent as engine;
#[cfg(feature = "onnxruntime")]
use present as engine;

pub use engine::{open, version};

/// Its name as users write it.
const NAME: &str = "onnxruntime";

#[cfg(feature = "onnxruntime")]
mod present {
    use std::path::{Path, PathBuf};
    use std::sync::{Arc, OnceLock};

    use farsight_onnx::{OnnxModel, TensorInfo};
    use ort::environment::Environment;
    use ort::ep::{self, ExecutionProvider};
    use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
    use ort::session::{Session, SessionInputValue};
    use ort::value::TensorRef;

    use super::NAME;
    use crate::EngineError;
    use crate::elf::check_whole;
    use crate::library::{Failure, unpanicked};
    use crate::runner::{Runner, Tensor, TensorView, input};
    use crate::session_options::{Device, SessionOptions};
    use crate::spare::Spare;

    /// The library and its environment, which a process has once: the first library that was loaded stays.
    static ENVIRONMENT: OnceLock<Environment> = OnceLock::new();

    /// What sessions are made from.
    struct Source {
        library: PathBuf,
        model: OnnxModel,
        options: SessionOptions,
    }

    /// Runs an ONNX model with ONNX Runtime.
    struct OrtRunner {
        source: Arc<Source>,
        /// None until the first run of a sharer.
        session: Option<Session>,
        spare: Spare,
    }

    /// Loads the shared `library` of ONNX Runtime 1.17 or later and `model`.
    ///
    /// # Errors
    /// When the library cannot be loaded, is too old, or refuses the model, and when it or this computer has not got
    /// the device.
    pub fn open(library: &Path, model: OnnxModel, options: SessionOptions) -> Result<Box<dyn Runner>, EngineError> {
        let source = Source { library: library.to_owned(), model, options };
        let session = unpanicked(NAME, || source.session())?;
        Ok(Box::new(OrtRunner { source: Arc::new(source), session: Some(session), spare: Spare::default() }))
    }

    /// Loads the library at `path` and says which version it is.
    ///
    /// # Errors
    /// When it cannot be loaded or is too old.
    pub fn version(path: &Path) -> Result<String, EngineError> {
        unpanicked(NAME, || {
            environment(path)?;
            let minor = ort::util::probe(path).ok_or("no version is known of it")?;
            Ok(format!("1.{minor}"))
        })
    }

    impl Source {
        fn session(&self) -> Result<Session, Failure> {
            let mut builder = Session::builder(environment(&self.library)?)?
                .with_optimization_level(GraphOptimizationLevel::All)
                .map_err(plain)?
                // Threads of one network that wait for work, busily, take the cores from the next network.
                .with_config_entry("session.force_spinning_stop", "1")
                .map_err(plain)?;
            if let Some(threads) = self.options.threads {
                builder = builder.with_intra_threads(threads).map_err(plain)?;
            }
            match self.options.device {
                Device::Cpu => {}
                Device::Cuda => register(&ep::CUDA::default(), Device::Cuda, &mut builder)?,
                Device::TensorRt => {
                    register(&ep::TensorRT::default(), Device::TensorRt, &mut builder)?;
                    register(&ep::CUDA::default(), Device::Cuda, &mut builder)?;
                }
                Device::Gpu => return Err("it has no device gpu".into()),
            }
            Ok(builder.commit_from_memory(self.model.bytes())?)
        }
    }

    impl OrtRunner {
        fn values(&mut self, given: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, Failure> {
            let Self { source, session, spare } = self;
            let model = &source.model;
            let name = &model.input().name;
            let view = input(given, name)?;
            let value = TensorRef::from_array_view((view.shape.to_vec(), view.values))?;
            let session = match session {
                Some(session) => session,
                none => none.insert(source.session()?),
            };
            let answer = session.run(vec![(name.clone(), SessionInputValue::from(value))])?;
            let tensor = |output: &TensorInfo| {
                let value = answer.get(&output.name).ok_or_else(|| format!("no output \"{}\"", output.name))?;
                let (shape, values) = value.try_extract_tensor::<f32>()?;
                Ok(Tensor { shape: shape.iter().map(|&side| side as usize).collect(), values: spare.filled(values) })
            };
            model.outputs().iter().map(tensor).collect()
        }
    }

    impl Runner for OrtRunner {
        fn engine(&self) -> &str {
            NAME
        }

        fn inputs(&self) -> &[TensorInfo] {
            std::slice::from_ref(self.source.model.input())
        }

        fn outputs(&self) -> &[TensorInfo] {
            self.source.model.outputs()
        }

        fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
            unpanicked(NAME, || self.values(inputs))
        }

        fn recycle(&mut self, values: Vec<f32>) {
            self.spare.keep(values);
        }

        fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
            Ok(Box::new(Self { source: self.source.clone(), session: None, spare: Spare::default() }))
        }
    }

    /// Has sessions compute on `device` by `provider`.
    fn register<P: ExecutionProvider>(
        provider: &P,
        device: Device,
        builder: &mut SessionBuilder,
    ) -> Result<(), Failure> {
        if !P::is_available()? {
            let text = format!(
                "this build of its library has no {}, so no device {device}; NVIDIA's GPUs need the one in PyPI's \
                 package onnxruntime-gpu",
                P::NAME
            );
            return Err(text.into());
        }
        let unregistered = |error: ort::Error| {
            format!(
                "the device {device} cannot be used ({error}); it needs an NVIDIA GPU, its driver and its libraries"
            )
        };
        Ok(provider.register(builder).map_err(unregistered)?)
    }

    /// The error without the builder that it gives back.
    fn plain(error: ort::Error<SessionBuilder>) -> ort::Error {
        error.into()
    }

    fn environment(library: &Path) -> Result<&'static Environment, Failure> {
        if let Some(environment) = ENVIRONMENT.get() {
            return Ok(environment);
        }
        check_whole(library)?;
        let environment = ort::init_from(library)?.with_name("farsight").with_telemetry(false).build()?;
        Ok(ENVIRONMENT.get_or_init(|| environment))
    }
}

#[cfg(not(feature = "onnxruntime"))]
mod absent {
    use std::path::Path;

    use farsight_onnx::OnnxModel;

    use super::NAME;
    use crate::{EngineError, Runner, SessionOptions};

    /// The engine is not compiled in.
    ///
    /// # Errors
    /// Always.
    pub fn open(_: &Path, _: OnnxModel, _: SessionOptions) -> Result<Box<dyn Runner>, EngineError> {
        Err(EngineError::not_built(NAME))
    }

    /// The engine is not compiled in.
    ///
    /// # Errors
    /// Always.
    pub fn version(_: &Path) -> Result<String, EngineError> {
        Err(EngineError::not_built(NAME))
    }
}
