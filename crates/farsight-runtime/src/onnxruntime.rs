//! ONNX Runtime, loaded at run time: the fastest engine on most CPUs.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use farsight_onnx::{OnnxModel, TensorInfo};
use ort::environment::Environment;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use ort::session::{Session, SessionInputValue};
use ort::value::TensorRef;

use crate::EngineError;
use crate::library::{Failure, unpanicked};
use crate::runner::{Runner, Tensor, TensorView, input};

/// Its name as users write it.
const NAME: &str = "onnxruntime";

/// The library and its environment, which a process has once: the first library that was loaded stays.
static ENVIRONMENT: OnceLock<Environment> = OnceLock::new();

/// Runs an ONNX model with ONNX Runtime.
pub struct OrtRunner {
    session: Session,
    /// What another session is made from; ONNX Runtime runs a session from one thread at a time here.
    library: PathBuf,
    model: OnnxModel,
    threads: Option<usize>,
}

impl OrtRunner {
    /// Loads the shared `library` of ONNX Runtime 1.17 or later and `model`, to be run by so many threads; `None` takes one for each core.
    ///
    /// # Errors
    /// When the library cannot be loaded, is too old, or refuses the model.
    pub fn new(library: &Path, model: &OnnxModel, threads: Option<usize>) -> Result<Self, EngineError> {
        unpanicked(NAME, || {
            let mut builder = Session::builder(environment(library)?)?
                .with_optimization_level(GraphOptimizationLevel::All)
                .map_err(plain)?;
            if let Some(threads) = threads {
                builder = builder.with_intra_threads(threads).map_err(plain)?;
            }
            let session = builder.commit_from_memory(model.bytes())?;
            Ok(Self { session, library: library.to_owned(), model: model.clone(), threads })
        })
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

    fn values(&mut self, given: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, Failure> {
        let name = &self.model.input().name;
        let view = input(given, name)?;
        let value = TensorRef::from_array_view((view.shape.to_vec(), view.values))?;
        let answer = self.session.run(vec![(name.clone(), SessionInputValue::from(value))])?;
        let tensor = |output: &TensorInfo| {
            let value = answer.get(&output.name).ok_or_else(|| format!("no output \"{}\"", output.name))?;
            let (shape, values) = value.try_extract_tensor::<f32>()?;
            Ok(Tensor { shape: shape.iter().map(|&side| side as usize).collect(), values: values.to_vec() })
        };
        self.model.outputs().iter().map(tensor).collect()
    }
}

impl Runner for OrtRunner {
    fn engine(&self) -> &str {
        NAME
    }

    fn inputs(&self) -> &[TensorInfo] {
        std::slice::from_ref(self.model.input())
    }

    fn outputs(&self) -> &[TensorInfo] {
        self.model.outputs()
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        unpanicked(NAME, || self.values(inputs))
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        Ok(Box::new(Self::new(&self.library, &self.model, self.threads)?))
    }
}

/// The error without the builder that it gives back.
fn plain(error: ort::Error<SessionBuilder>) -> ort::Error {
    error.into()
}

fn environment(library: &Path) -> Result<&'static Environment, Failure> {
    if let Some(environment) = ENVIRONMENT.get() {
        return Ok(environment);
    }
    let environment = ort::init_from(library)?.with_name("farsight").with_telemetry(false).build()?;
    Ok(ENVIRONMENT.get_or_init(|| environment))
}
