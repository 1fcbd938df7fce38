//! `farsight engine`: the libraries of the optional engines.

use anyhow::Result;
use clap::{Args, Subcommand};

use super::Outcome;
use crate::libraries::{self, Library};
use crate::printer::Printer;

/// Arguments of `farsight engine`.
#[derive(Debug, Args)]
pub(crate) struct EngineCommandArgs {
    #[command(subcommand)]
    command: EngineCommand,
}

#[derive(Debug, Subcommand)]
enum EngineCommand {
    /// Fetch an engine's library with your own pip into your data folder
    Install {
        /// Which engine
        #[arg(value_enum)]
        library: Library,
    },
}

/// Runs the command.
pub(crate) fn run(args: &EngineCommandArgs, printer: &mut Printer) -> Result<Outcome> {
    let EngineCommand::Install { library } = args.command;
    let (found, version) = libraries::install(library)?;
    printer.line(&format!("{} {version}: {}", library.name(), found.path.display()));
    printer.status(&format!("from now on `--engine {}` finds it", library.name()));
    Ok(Outcome::Done)
}
