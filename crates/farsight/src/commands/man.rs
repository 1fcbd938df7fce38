//! `farsight man`: manual pages.

use anyhow::{Context, Result};
use clap::{Args, CommandFactory};
use clap_mangen::Man;

use super::Outcome;
use crate::Cli;
use crate::printer::Printer;

/// Arguments of `farsight man`.
#[derive(Debug, Args)]
#[command(after_help = "To read it: farsight man range | man -l -")]
pub(crate) struct ManArgs {
    /// The command to tell about [default: the program as a whole]
    command: Option<String>,
}

/// Runs the command.
pub(crate) fn run(args: &ManArgs, printer: &mut Printer) -> Result<Outcome> {
    let mut program = Cli::command();
    // Names of subcommands with the program's before them, and the options that all of them have.
    program.build();
    let command = match &args.command {
        None => program,
        Some(name) => {
            let known = program.find_subcommand(name).cloned();
            let known = known.with_context(|| format!("{name}: no such command; `farsight --help` lists them"))?;
            known.display_name(format!("farsight-{name}"))
        }
    };
    let mut page = Vec::new();
    Man::new(command).render(&mut page)?;
    printer.text(&String::from_utf8(page)?);
    Ok(Outcome::Done)
}
