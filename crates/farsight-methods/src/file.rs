//! What a file says of the model in it, whatever its method.

use std::path::Path;

use farsight_graph::model::{Model, ModelError, NetworkConfig};
use farsight_onnx::{Facts, OnnxError, OnnxModel, OnnxProblem, Target, key};

use crate::method::Method;

/// A file that is no detector of a method that is known here.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// It is no model file of ours.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// It is no ONNX file of ours.
    #[error(transparent)]
    Onnx(#[from] OnnxError),
}

/// The config that an ONNX file says it has; `source` is only what errors call it.
///
/// # Errors
/// When it says none, one of another method or one that cannot be used, or lacks an output of it.
pub fn config_of<C: NetworkConfig>(onnx: &OnnxModel, source: &Path) -> Result<C, OnnxError> {
    let failed = |problem| OnnxError::new(source, problem);
    let text = onnx.facts().get(key::MODEL).ok_or_else(|| failed(OnnxProblem::UnknownProducer))?;
    if let Some(found) = onnx.facts().get(key::METHOD).filter(|found| *found != C::METHOD) {
        return Err(failed(OnnxProblem::Method { found: found.to_owned(), expected: C::NAME, method: C::METHOD }));
    }
    let config: C =
        serde_json::from_str(text).map_err(|error| failed(OnnxProblem::Config { problem: error.to_string() }))?;
    if let Some(problem) = config.problem() {
        return Err(failed(OnnxProblem::Config { problem }));
    }
    // The outputs of a first part are what a sampler reads.
    let outputs = if onnx.facts().get(key::PART).is_some() { &[] } else { C::OUTPUTS };
    for &name in outputs {
        if !onnx.outputs().iter().any(|output| output.name == name) {
            let found = onnx.outputs().iter().take(8).map(|output| output.name.clone()).collect();
            return Err(failed(OnnxProblem::Value { kind: "output", name, found }));
        }
    }
    let graph = config.graph();
    for &name in outputs {
        let expected = graph.tap(name).map(|node| graph.nodes[node].channels);
        if let Some((found, expected)) = onnx.channels(name).zip(expected).filter(|(found, expected)| found != expected)
        {
            return Err(failed(OnnxProblem::Channels { name, found: found as u64, expected }));
        }
    }
    Ok(config)
}

/// What the ONNX file of `model` says.
pub fn facts_of<C: Method>(model: &Model<C>, target: Target) -> Facts {
    with_own(Facts::new(model, target), model)
}

/// `facts` with those of the method.
pub(crate) fn with_own<C: Method>(mut facts: Facts, model: &Model<C>) -> Facts {
    model.config.onnx_facts().into_iter().for_each(|(key, fact)| facts.set(key, fact));
    facts
}
