//! ONNX Runtime, loaded at run time: the fastest engine on most CPUs.

use std::path::Path;
use std::sync::OnceLock;

use farsight_core::HeadMaps;
use farsight_net::onnx::{INPUT, OnnxModel};
use ort::environment::Environment;
use ort::session::Session;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use ort::value::TensorRef;

use crate::engine::{apart, batch_size};
use crate::library::{Failure, unpanicked};
use crate::{Engine, EngineError};

/// Its name as users write it.
const NAME: &str = "onnxruntime";

/// The library and its environment, which a process has once: the first library that was loaded stays.
static ENVIRONMENT: OnceLock<Environment> = OnceLock::new();

/// Runs an ONNX model with ONNX Runtime.
pub struct OrtEngine {
    session: Session,
    outputs: [String; 2],
}

impl OrtEngine {
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
            let outputs = model.outputs().map(str::to_owned);
            Ok(Self { session: builder.commit_from_memory(model.bytes())?, outputs })
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

    fn run(&mut self, inputs: &[f32], size @ [width, height]: [usize; 2]) -> Result<Vec<HeadMaps>, Failure> {
        let batch = batch_size(inputs, size);
        let image = TensorRef::from_array_view(([batch, 3, height, width], inputs))?;
        let answer = self.session.run(ort::inputs![INPUT => image])?;
        let map = |name: &str| {
            let value = answer.get(name).ok_or_else(|| format!("no output \"{name}\""))?;
            let (shape, values) = value.try_extract_tensor::<f32>()?;
            let &[_, _, height, width] = &shape[..] else {
                return Err(format!("\"{name}\" has the shape {shape:?}").into());
            };
            Ok::<_, Failure>(([width as usize, height as usize], values))
        };
        let (map_size, logits) = map(&self.outputs[0])?;
        let (_, regression) = map(&self.outputs[1])?;
        Ok(apart(batch, map_size, logits.to_vec(), regression.to_vec()))
    }
}

impl Engine for OrtEngine {
    fn name(&self) -> &'static str {
        NAME
    }

    fn batch_head_maps(&mut self, inputs: &[f32], input_size: [usize; 2]) -> Result<Vec<HeadMaps>, EngineError> {
        unpanicked(NAME, || self.run(inputs, input_size))
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
