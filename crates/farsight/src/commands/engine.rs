//! `farsight engine`: the libraries of the optional engines.

use anyhow::Result;
use clap::{Args, Subcommand, ValueEnum};
use farsight::Library;
use farsight::libraries::install;

use super::Outcome;
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
        library: LibraryName,
    },
}

/// [`Library`] as it is written on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum LibraryName {
    /// Microsoft's ONNX Runtime, 1.17 or later
    Onnxruntime,
    /// Intel's OpenVINO, 2025.1 or later
    Openvino,
}

impl LibraryName {
    fn library(self) -> Library {
        match self {
            Self::Onnxruntime => Library::OnnxRuntime,
            Self::Openvino => Library::OpenVino,
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &EngineCommandArgs, printer: &mut Printer) -> Result<Outcome> {
    let EngineCommand::Install { library } = args.command;
    let library = library.library();
    let (found, version) = install(library)?;
    printer.line(&format!("{} {version}: {}", library.name(), found.path.display()));
    printer.status(&format!("from now on `--engine {}` finds it", library.name()));
    Ok(Outcome::Done)
}
