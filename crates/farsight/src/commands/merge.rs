//! `farsight merge`: one result out of the parts that `--shard` made.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::{Args, Parser};
use farsight_files::Scratch;

use super::{Cli, Command, Outcome, eval};
use crate::printer::{Printer, counted};
use crate::shard::merged::Parts;

/// Arguments of `farsight merge`.
#[derive(Debug, Args)]
pub(crate) struct MergeArgs {
    /// Folders of parts, as --parts named them
    #[arg(required = true, value_name = "DIR")]
    parts: Vec<PathBuf>,
    /// Folder for the result, which must be new or empty: what the command without --shard would have written, by the
    /// same names
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Runs the command.
pub(crate) fn run(args: &MergeArgs, printer: &mut Printer) -> Result<Outcome> {
    let parts = Parts::find(&args.parts)?;
    let shown = args.out.display();
    let unwritable = || format!("{shown}: cannot be written");
    if args.out.exists() && fs::read_dir(&args.out).with_context(unwritable)?.next().is_some() {
        bail!("{shown}: there already and not empty; expected a new folder");
    }
    if let Some(beside) = args.out.parent() {
        fs::create_dir_all(beside).with_context(unwritable)?;
    }
    let scratch = Scratch::folder(&args.out).with_context(unwritable)?;
    let folder = scratch.path();
    parts.write(folder)?;
    let words = std::iter::once("farsight").chain(parts.words().iter().map(String::as_str));
    let command = Cli::try_parse_from(words).context("the command line that made the parts")?.command;
    let judged = match command {
        Command::Eval(eval) => eval::merged(*eval, folder, &parts, printer)?,
        _ => Outcome::Done,
    };
    // It gets its name when it is whole.
    scratch.persist().with_context(unwritable)?;
    let (done, count, failed) = (parts.done(), parts.len(), parts.failed());
    for item in &failed {
        printer.error(&format!("{item}: failed when its part was made"));
    }
    let failures = if failed.is_empty() { String::new() } else { format!("; {} failed", failed.len()) };
    printer.status(&format!("{} of {} in {shown}{failures}", counted(done, "item"), counted(count, "part")));
    Ok(if failed.is_empty() { judged } else { Outcome::Told })
}
