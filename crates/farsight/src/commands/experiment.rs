//! `farsight experiment`: runs the plan of an experiment, cell by cell; times and draws its arms.

#[cfg(feature = "train")]
mod cell;
mod plot;
#[cfg(feature = "train")]
mod record;
#[cfg(feature = "train")]
mod run;
mod time;
#[cfg(feature = "train")]
mod twins;

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Subcommand};

use super::Outcome;
use crate::experiment::{Experiment, Results, tables};
use crate::pipeline_args::EngineArgs;
use crate::printer::Printer;

/// Arguments of `farsight experiment`.
#[derive(Debug, Args)]
pub(crate) struct ExperimentArgs {
    #[command(subcommand)]
    command: ExperimentCommand,
}

#[derive(Debug, Subcommand)]
enum ExperimentCommand {
    /// Train and judge the cells that are not done yet; exit status 75 when the minutes are over before the cells
    Run(RunArgs),
    /// Time every arm on several engines, in turns
    Time(time::TimeArgs),
    /// Draw what the arms are worth against the time that they take
    Plot(plot::PlotArgs),
}

/// Arguments of `farsight experiment run`.
#[derive(Debug, Args)]
#[command(after_help = "\
A cell is one arm with one seed. Cells are run by block, seed and arm, so that any prefix is balanced. What is done is not
done again, also after a kill; a cell that another process works on is left out.
farsight experiment run configs/experiments/claim.toml --list
farsight experiment run configs/experiments/claim.toml --data TWINS --kitti KITTI_ALL --out runs/claim --minutes 165")]
pub(crate) struct RunArgs {
    /// The plan, TOML
    #[arg(value_name = "FILE")]
    plan: PathBuf,
    /// Data in KITTI's layout; with --kitti, where the twins are or will be
    #[arg(long, value_name = "DIR", required_unless_present = "list")]
    data: Option<PathBuf>,
    /// Judge on the frames of this folder, in KITTI's layout, instead of those of --data
    #[arg(long, value_name = "DIR")]
    judge: Option<PathBuf>,
    /// All label and calibration files of KITTI's training set and its `ImageSets`, to render the twins of when --data
    /// is not there
    #[arg(long, value_name = "DIR")]
    kitti: Option<PathBuf>,
    /// Folder of the cells [default: runs/NAME]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// File of the results, JSON [default: docs/results/NAME.json]
    #[arg(long, value_name = "FILE")]
    results: Option<PathBuf>,
    /// Folder with a record of each cell that is done; a cell that has one is not run again
    /// [default: beside the results]
    #[arg(long, value_name = "DIR")]
    records: Option<PathBuf>,
    /// Stop at a checkpoint after this many minutes
    #[arg(long, value_name = "N", value_parser = minutes_from_text, allow_negative_numbers = true)]
    minutes: Option<f64>,
    /// Only the cells whose names (ARM-SEED) start so
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// What answers; --threads are training's, too, instead of the plan's
    #[command(flatten)]
    engine: EngineArgs,
    /// List the cells and what is done, run nothing
    #[arg(long)]
    list: bool,
}

/// A year at most, so that the clock can count them.
const MAX_MINUTES: f64 = 525_600.0;

fn minutes_from_text(text: &str) -> Result<f64, String> {
    let minutes = text.parse().ok().filter(|minutes: &f64| *minutes > 0.0 && *minutes <= MAX_MINUTES);
    minutes.ok_or_else(|| format!("expected a positive number of minutes, at most {MAX_MINUTES}"))
}

/// Runs the command.
pub(crate) fn run(args: &ExperimentArgs, printer: &mut Printer) -> Result<Outcome> {
    let args = match &args.command {
        ExperimentCommand::Run(args) => args,
        ExperimentCommand::Time(args) => return time::run(args, printer),
        ExperimentCommand::Plot(args) => return plot::run(args, printer),
    };
    let plan = Experiment::read(&args.plan)?;
    if args.list {
        return list(args, &plan, printer);
    }
    run_cells(args, &plan, printer)
}

impl RunArgs {
    fn results(&self, plan: &Experiment) -> PathBuf {
        self.results.clone().unwrap_or_else(|| results_file(plan))
    }
}

/// Where the results of a plan are.
fn results_file(plan: &Experiment) -> PathBuf {
    format!("docs/results/{}.json", plan.name).into()
}

#[cfg(feature = "train")]
impl RunArgs {
    fn records(&self, plan: &Experiment) -> PathBuf {
        let results = self.results(plan);
        let name = results.file_stem().unwrap_or_default().to_string_lossy();
        self.records.clone().unwrap_or_else(|| results.with_file_name(format!("{name}-cells")))
    }
}

fn list(args: &RunArgs, plan: &Experiment, printer: &mut Printer) -> Result<Outcome> {
    let path = args.results(plan);
    let results = if path.exists() { Results::read(&path)? } else { Results::default() };
    for cell in plan.cells() {
        let is_done = results.cells.iter().any(|done| done.arm == cell.arm && done.seed == cell.seed);
        let state = if is_done { "done" } else { "to do" };
        printer.line(&format!("{:24}{state:8}{}", cell.name(), plan.title(&cell.arm)));
    }
    printer.line(&tables::progress(plan, &results));
    Ok(Outcome::Done)
}

/// Says how to get a build that can train.
#[cfg(not(feature = "train"))]
fn run_cells(_: &RunArgs, _: &Experiment, _: &mut Printer) -> Result<Outcome> {
    anyhow::bail!(
        "this farsight was built without training, which needs libtorch; `cargo xtask libtorch` fetches it, `cargo xtask run experiment run ...` builds and trains with it"
    )
}

#[cfg(feature = "train")]
fn run_cells(args: &RunArgs, plan: &Experiment, printer: &mut Printer) -> Result<Outcome> {
    use std::time::{Duration, Instant};

    use anyhow::Context;

    use self::run::{Job, run};

    let job = Job {
        out: args.out.clone().unwrap_or_else(|| PathBuf::from("runs").join(&plan.name)),
        results: args.results(plan),
        records: args.records(plan),
        data: args.data.clone().context("expected --data")?,
        judge: args.judge.clone(),
        kitti: args.kitti.clone(),
        deadline: args.minutes.map(|minutes| Instant::now() + Duration::from_secs_f64(60.0 * minutes)),
        only: args.only.clone(),
        engine: args.engine.options()?,
        plan: plan.clone(),
    };
    run(&job, printer)
}
