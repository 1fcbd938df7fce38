//! The command line.
//!
//! Exit status: 0 done; 1 done, with something the caller asked to be told; 2 could not run.

mod camera_source;
mod commands;
mod engines;
mod figures;
mod inputs;
mod libraries;
mod model_files;
mod names;
mod outputs;
mod pipeline;
mod printer;
mod range_json;
mod range_table;
mod shipped;
mod untrained;

use std::process::ExitCode;

use clap::Parser;

use commands::{Command, Outcome};
use printer::Printer;

/// Finds vehicles in images of one camera and says how far away each is.
#[derive(Debug, Parser)]
#[command(name = "farsight", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    report_no_caught_panics();
    let mut printer = Printer::new();
    let ended = cli.command.run(&mut printer).and_then(|outcome| printer.finish().map(|()| outcome));
    match ended {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Told) => ExitCode::from(1),
        Err(error) => {
            printer.failure(&error);
            ExitCode::from(2)
        }
    }
}

/// A panic in the library of an engine becomes an error of ours; what Rust prints about it by itself would only confuse.
fn report_no_caught_panics() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !farsight_runtime::library::inside_library() {
            report(panic);
        }
    }));
}
