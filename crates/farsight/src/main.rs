//! The command line.
//!
//! Exit status: 0 done; 1 done, but an input failed or something was told that the caller asked for; 2 could not run,
//! or could not write an output; 75 the time that was given is over, the same command goes on.

mod camera_args;
mod commands;
mod experiment;
mod figures;
mod inputs;
mod json_array;
mod layout;
mod names;
mod one_dash;
mod outputs;
mod pipeline_args;
mod printer;
mod range_table;
mod rangers;
mod recording_file;
mod shard;
mod side_by_side;
mod untrained;

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory, Parser};

use commands::{Cli, Outcome};
use farsight::ImageLimits;
use printer::{LogLevel, Printer};

/// `EX_TEMPFAIL` of `sysexits.h`: try again later.
const UNFINISHED: u8 = 75;

fn main() -> ExitCode {
    if let Some((written, meant)) = one_dash::meant(&Cli::command(), std::env::args_os()) {
        Cli::command()
            .error(ErrorKind::UnknownArgument, format!("'{written}' has one dash; expected '{meant}'"))
            .exit();
    }
    let cli = Cli::parse();
    printer::set_log_level(if cli.quiet { LogLevel::Error } else { cli.log_level.unwrap_or_default() });
    if let Some(max_pixels) = cli.max_pixels {
        ImageLimits { max_pixels }.set_default();
    }
    report_no_caught_panics();
    let mut printer = Printer::new();
    let ended = cli.command.run(&mut printer).and_then(|outcome| printer.finish().map(|()| outcome));
    match ended {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Told) => ExitCode::from(1),
        Ok(Outcome::Unfinished) => ExitCode::from(UNFINISHED),
        Err(error) => {
            printer.failure(&error);
            ExitCode::from(2)
        }
    }
}

/// A panic in the library of an engine becomes an error of ours; what Rust prints about it by itself would only
/// confuse.
fn report_no_caught_panics() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !farsight_runtime::library::inside_library() {
            report(panic);
        }
    }));
}
