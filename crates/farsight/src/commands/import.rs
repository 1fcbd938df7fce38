//! `farsight import`: checkpoints of other programs become models.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::Args;
use farsight_graph::model::ATTRIBUTION_KEY;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::import::{ImportOptions, import};

use super::Outcome;
use crate::outputs;
use crate::printer::Printer;

/// Arguments of `farsight import`.
#[derive(Debug, Args)]
pub(crate) struct ImportArgs {
    /// A .pth file of official SMOKE or of mmdetection3d's SMOKE, or of DLA-34, MobileNetV2 or EfficientNet-Lite
    /// trained on ImageNet; a .tflite file of an SSD on MobileNetV2
    checkpoint: PathBuf,
    /// The file to write
    #[arg(long, value_name = "FILE.safetensors")]
    out: PathBuf,
    /// Take the whole SSD of a .tflite file, a detector of 2D boxes, and not its backbone alone
    #[arg(long)]
    detector: bool,
}

/// Runs the command.
pub(crate) fn run(args: &ImportArgs, printer: &mut Printer) -> Result<Outcome> {
    outputs::check_kind(&args.out, "onnx", "a name ending in .safetensors")?;
    if args.detector {
        return ssd(args, printer);
    }
    let imported = import(&args.checkpoint, ImportOptions::default())?;
    let tensors = imported.weights.tensors.len();
    printer.line(&format!("{}: {}, {tensors} tensors", args.checkpoint.display(), imported.layout.name()));
    for name in &imported.left_over {
        printer.note(&format!("left over: {name} has no place in the network"));
    }
    let Some(config) = imported.config else {
        // A backbone alone is no model; training starts from its weights.
        imported.weights.write(&args.out)?;
        if let Some(attribution) = imported.weights.metadata.get(ATTRIBUTION_KEY) {
            printer.line(attribution);
        }
        printer.line(&format!("{}: weights to start a training from (train.start_from)", args.out.display()));
        return Ok(Outcome::Done);
    };
    if let Some(name) = imported.missing.first() {
        bail!(
            "{}: no whole model: {} tensors are missing, {name} for one",
            args.checkpoint.display(),
            imported.missing.len()
        );
    }
    imported.weights.check_finite(&args.checkpoint)?;
    let model = SmokeModel::new(config, imported.weights).with_context(|| args.checkpoint.display().to_string())?;
    model.write(&args.out)?;
    printer.line(&format!("{}: a model for `farsight range --model`", args.out.display()));
    Ok(Outcome::Done)
}

/// Imports a whole SSD.
fn ssd(args: &ImportArgs, printer: &mut Printer) -> Result<Outcome> {
    let model = farsight_methods::ssd::import::import(&args.checkpoint)?;
    // The file's own numbers are of half precision.
    model.write_half(&args.out)?;
    if let Some(attribution) = model.weights.metadata.get(ATTRIBUTION_KEY) {
        printer.line(attribution);
    }
    printer.line(&format!("{}: a detector for `farsight range --model`", args.out.display()));
    Ok(Outcome::Done)
}
