//! Export of a detector whose network is run as one, or as two with a sampler between them.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use farsight::model_file::detector_of_word;
use farsight::shipped::{self, Family};
use farsight_methods::detectors::{DetectorNetwork, NetworkForm, Part, from_model, from_model_file, second_path};
use farsight_onnx::{Target, is_safetensors};
use farsight_runtime::{Tensor, probe};

use super::{ExportArgs, answer, check, keep, reference_engine, write_file};
use crate::commands::Outcome;
use crate::printer::Printer;

/// Large enough for the last map of an SSD.
const PROBE_SIZE: [usize; 2] = [320, 320];

/// Columns and rows of the grid that the second of two networks is tried on, whatever its own are.
const PROBE_GRID: [usize; 2] = [24, 20];

/// The network of the model at `path`, if it is of such a method.
pub(super) fn read(path: &Path, target: Target) -> Result<Option<DetectorNetwork>> {
    in_form(path, NetworkForm::Deployable, target)
}

fn in_form(path: &Path, form: NetworkForm, target: Target) -> Result<Option<DetectorNetwork>> {
    if detector_of_word(path) == Some(Family::World) {
        return Ok(Some(from_model(&shipped::world()?, form, target, path)?));
    }
    if !is_safetensors(path).unwrap_or(false) {
        return Ok(None);
    }
    Ok(from_model_file(path, form, target)?)
}

/// Checks the network against itself as it was trained, and writes it; a second part goes into the file beside
/// ([`second_path`]).
pub(super) fn run(args: &ExportArgs, network: &DetectorNetwork, printer: &mut Printer) -> Result<Outcome> {
    let path = args.model.display();
    let is_changed = args.input.is_some() || args.focal_range.is_some() || args.fit_on.is_some();
    ensure!(
        !args.half && !args.int8.int8 && !is_changed && !args.tells_facts(),
        "{path}: not a SMOKE; expected --out and --target alone beside it"
    );
    let engine = reference_engine(&network.first.onnx);
    let trained = in_form(&args.model, NetworkForm::AsTrained, engine.target())?;
    let trained = trained.with_context(|| format!("{path}: changed while it was read"))?;
    let answered = |part: &Part, size: [usize; 2]| -> Result<(Tensor, Vec<Tensor>, String)> {
        let input = probe::tensor(part.onnx.input().channels.unwrap_or(3), size);
        let (expected, reference) = answer(engine, part.onnx.clone(), &args.model, &input)?;
        Ok((input, expected, reference))
    };
    let (input, expected, reference) = answered(&trained.first, PROBE_SIZE)?;
    let (Some(second), Some(second_trained)) = (&network.second, &trained.second) else {
        return keep(&network.first.onnx, &input, &expected, &reference, &args.out, printer);
    };
    let beside = second_path(&args.out);
    check(&network.first.onnx, &input, &expected, &reference, &args.out, printer)?;
    let (input, expected, reference) = answered(second_trained, PROBE_GRID)?;
    check(&second.onnx, &input, &expected, &reference, &beside, printer)?;
    // Nobody finds a first part without its second.
    write_file(&second.onnx, &beside, printer)?;
    write_file(&network.first.onnx, &args.out, printer)?;
    Ok(Outcome::Done)
}
