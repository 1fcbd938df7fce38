//! `farsight demo`: the shipped model on the shipped scenes, offline.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use farsight::shipped;

use super::Outcome;
use super::range::{self, RangeArgs};
use crate::printer::Printer;

/// Arguments of `farsight demo`.
#[derive(Debug, Args)]
pub(crate) struct DemoArgs {
    /// Folder for the scenes, the pictures and the JSON
    #[arg(long, value_name = "DIR", default_value = "farsight-demo")]
    out: PathBuf,
}

/// Runs the command.
pub(crate) fn run(args: &DemoArgs, printer: &mut Printer) -> Result<Outcome> {
    let images = shipped::write_scenes(&args.out.join("scenes"))?;
    let range = RangeArgs::demo(images, args.out.clone(), args.out.join("detections.json"));
    let outcome = range::run(&range, printer)?;
    printer.line("");
    printer.line(&format!(
        "Pictures with boxes and the view from above: {} (numbers: detections.json). Next, a photo of your own: farsight range photo.jpg --hfov 60 --out {}",
        args.out.join("*.png").display(),
        args.out.display()
    ));
    Ok(outcome)
}
