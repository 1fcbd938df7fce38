//! `farsight prune`: a smaller network of the same kind.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::Args;
use farsight::model_file::with_own;
use farsight_graph::count::{count, total};
use farsight_graph::model::Model;
use farsight_graph::prune::prune;
use farsight_methods::method::{DetectorMethod, ModelTaker};

use super::Outcome;
use crate::outputs;
use crate::pipeline_args::tell_unhashed;
use crate::printer::Printer;

/// Arguments of `farsight prune`.
#[derive(Debug, Args)]
pub(crate) struct PruneArgs {
    /// Model that `farsight train` or `farsight import` wrote, "farsight-s" or "farsight-n" for those that come with
    /// the program
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Share of the channels of every layer to keep, above 0 and at most 1
    #[arg(long, value_name = "SHARE", value_parser = share, allow_negative_numbers = true)]
    keep: f64,
    /// Where to write the pruned model (.safetensors)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

fn share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share| *share > 0.0 && *share <= 1.0);
    share.ok_or_else(|| "expected a share above 0 and at most 1".to_owned())
}

/// Runs the command.
pub(crate) fn run(args: &PruneArgs, printer: &mut Printer) -> Result<Outcome> {
    outputs::check_kind(&args.out, "onnx", "a name ending in .safetensors; `farsight export` makes ONNX of that")?;
    with_own(&args.model, Pruner { args, printer })??;
    Ok(Outcome::Done)
}

struct Pruner<'a> {
    args: &'a PruneArgs,
    printer: &'a mut Printer,
}

impl ModelTaker for Pruner<'_> {
    type Answer = Result<()>;

    fn take<C: DetectorMethod>(self, model: Model<C>) -> Result<()> {
        let Self { args, printer } = self;
        if let Some(problem) = C::NOT_PRUNED {
            bail!("{}: {}: {problem}; what is pruned must be trained on", args.model.display(), C::NAME);
        }
        tell_unhashed([args.model.clone()], printer);
        let pruned = prune(&model, args.keep)?;
        let [width, height] = model.config.counted_input();
        let costs = |model: &Model<C>| count(&model.graph, width, height).map(|stages| total(&stages));
        let (before, after) =
            costs(&model).zip(costs(&pruned)).context("the model's input does not fit its network")?;
        pruned.write(&args.out)?;
        printer.line(&format!("parameters {:>12} -> {:>12}", before.parameters, after.parameters));
        printer.line(&format!("GMAC       {:>12.3} -> {:>12.3}", before.macs as f64 / 1e9, after.macs as f64 / 1e9));
        printer.note("a pruned model must be trained on: name it as train.start_from in a config");
        Ok(())
    }
}
