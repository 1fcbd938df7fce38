//! `farsight completions`: the script by which a shell completes commands and options.

use anyhow::Result;
use clap::{Args, CommandFactory};
use clap_complete::{Shell, generate};

use super::Outcome;
use crate::Cli;
use crate::printer::Printer;

/// Arguments of `farsight completions`.
#[derive(Debug, Args)]
#[command(after_help = "bash: farsight completions bash > ~/.local/share/bash-completion/completions/farsight")]
pub(crate) struct CompletionsArgs {
    /// For which shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Runs the command.
pub(crate) fn run(args: &CompletionsArgs, printer: &mut Printer) -> Result<Outcome> {
    let mut script = Vec::new();
    generate(args.shell, &mut Cli::command(), "farsight", &mut script);
    printer.text(&String::from_utf8(script)?);
    Ok(Outcome::Done)
}
