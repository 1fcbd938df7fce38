//! Export of a detector whose network is run as one: CenterNet for 3D boxes.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use farsight_methods::detectors::{NetworkForm, from_model_file};
use farsight_onnx::{OnnxModel, Target, is_safetensors};

use super::{ExportArgs, answer, image_probe, keep, reference_engine};
use crate::commands::Outcome;
use crate::printer::Printer;

/// The network of the model at `path`, if it is of such a method.
pub(super) fn read(path: &Path, target: Target) -> Result<Option<OnnxModel>> {
    if !is_safetensors(path).unwrap_or(false) {
        return Ok(None);
    }
    Ok(from_model_file(path, NetworkForm::Deployable, target)?.map(|network| network.onnx))
}

/// Checks `file` against the network as it was trained, and writes it.
pub(super) fn run(args: &ExportArgs, file: &OnnxModel, printer: &mut Printer) -> Result<Outcome> {
    let path = args.model.display();
    let is_changed = args.input.is_some() || args.focal_range.is_some() || args.fit_on.is_some();
    ensure!(
        !args.half && !args.int8.int8 && !is_changed && !args.tells_facts(),
        "{path}: not a SMOKE; expected --out and --target alone beside it"
    );
    let engine = reference_engine(file);
    let whole = from_model_file(&args.model, NetworkForm::AsTrained, engine.target())?;
    let whole = whole.with_context(|| format!("{path}: changed while it was read"))?.onnx;
    let input = image_probe();
    let (expected, reference) = answer(engine, whole, &args.model, &input)?;
    keep(file, &input, &expected, &reference, args, printer)
}
