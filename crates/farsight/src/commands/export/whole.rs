//! Export of a detector whose network is run as one: CenterNet for 3D boxes.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use farsight::model_file::detector_of_word;
use farsight::shipped::{self, Family};
use farsight_methods::detectors::{NetworkForm, from_model, from_model_file};
use farsight_onnx::{OnnxModel, Target, is_safetensors};
use farsight_runtime::probe;

use super::{ExportArgs, answer, keep, reference_engine};
use crate::commands::Outcome;
use crate::printer::Printer;

/// Large enough for the last map of an SSD.
const PROBE_SIZE: [usize; 2] = [320, 320];

/// The network of the model at `path`, if it is of such a method.
pub(super) fn read(path: &Path, target: Target) -> Result<Option<OnnxModel>> {
    if detector_of_word(path) == Some(Family::World) {
        return Ok(Some(from_model(&shipped::world()?, NetworkForm::Deployable, target, path)?.onnx));
    }
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
    let form = NetworkForm::AsTrained;
    let whole = if detector_of_word(&args.model) == Some(Family::World) {
        from_model(&shipped::world()?, form, engine.target(), &args.model)?.onnx
    } else {
        let whole = from_model_file(&args.model, form, engine.target())?;
        whole.with_context(|| format!("{path}: changed while it was read"))?.onnx
    };
    let input = probe::tensor(3, PROBE_SIZE);
    let (expected, reference) = answer(engine, whole, &args.model, &input)?;
    keep(file, &input, &expected, &reference, args, printer)
}
