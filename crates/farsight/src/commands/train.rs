//! `farsight train`: needs libtorch, and so the cargo feature `train`.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use super::Outcome;
use crate::printer::Printer;

/// Arguments of `farsight train`.
#[derive(Debug, Args)]
pub(crate) struct TrainArgs {
    /// What to train and how, TOML
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Data in KITTI's layout [default: the one in the config]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder for the model, checkpoints, metrics and the resolved config
    #[arg(long, value_name = "RUN", default_value = "run")]
    out: PathBuf,
    /// Go on with the run that is in RUN
    #[arg(long)]
    resume: bool,
}

#[cfg(feature = "train")]
impl TrainArgs {
    /// What the command line names is what the user means now.
    fn override_data(&self, data: &mut farsight_train::config::DataConfig) {
        if let Some(root) = &self.data {
            data.root = Some(root.clone());
            data.rendered = None;
        }
    }
}

/// Says how to get a build that can train.
#[cfg(not(feature = "train"))]
pub(crate) fn run(_: &TrainArgs, _: &mut Printer) -> Result<Outcome> {
    anyhow::bail!(
        "this farsight was built without training, which needs libtorch; `cargo xtask libtorch` fetches it, `cargo xtask run train ...` builds and trains with it"
    )
}

/// Trains.
#[cfg(feature = "train")]
pub(crate) fn run(args: &TrainArgs, printer: &mut Printer) -> Result<Outcome> {
    use farsight_train::config::RunConfig;
    use farsight_train::refiner::RefinerRun;
    use farsight_train::trainer::{Job, train};

    if std::fs::read_to_string(&args.config).is_ok_and(|text| RefinerRun::is_meant(&text)) {
        return run_refiner(args, printer);
    }
    let mut run = RunConfig::read(&args.config)?;
    args.override_data(&mut run.data);
    let job = Job { run, out: args.out.clone(), resume: args.resume };
    let model = train(&job, &mut progress::Progress::new(printer))?;
    printer.line(&model.display().to_string());
    Ok(Outcome::Done)
}

/// Trains a refiner.
#[cfg(feature = "train")]
fn run_refiner(args: &TrainArgs, printer: &mut Printer) -> Result<Outcome> {
    use farsight_train::refiner::{RefinerJob, RefinerRun, train};

    let mut run = RefinerRun::read(&args.config)?;
    args.override_data(&mut run.data);
    let job = RefinerJob { run, out: args.out.clone(), resume: args.resume };
    let refiner = train(&job, &mut progress::Progress::new(printer))?;
    printer.line(&refiner.display().to_string());
    Ok(Outcome::Done)
}

#[cfg(feature = "train")]
mod progress {
    use std::io::{IsTerminal, stderr};
    use std::time::{Duration, Instant};

    use farsight_train::metrics::Record;
    use farsight_train::refiner::{RefinerObserver, RefinerRecord};
    use farsight_train::trainer::{Beginning, Observer, Taken};
    use indicatif::{HumanDuration, ProgressBar, ProgressStyle};

    use crate::printer::Printer;

    /// Time between two lines where there is no terminal to redraw a bar on.
    const LINE_INTERVAL: Duration = Duration::from_secs(20);

    /// How the run goes: a bar on a terminal, a line now and then elsewhere.
    pub(super) struct Progress<'a> {
        bar: ProgressBar,
        printer: &'a mut Printer,
        last_line: Option<Instant>,
    }

    impl<'a> Progress<'a> {
        pub(super) fn new(printer: &'a mut Printer) -> Self {
            let template = "{bar:30} {pos}/{len} steps  {eta} left  {msg}";
            let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
            Self { bar: ProgressBar::new(0).with_style(style), printer, last_line: None }
        }

        fn line_is_due(&self) -> bool {
            !stderr().is_terminal() && self.last_line.is_none_or(|last| last.elapsed() >= LINE_INTERVAL)
        }
    }

    impl Progress<'_> {
        fn begin(&mut self, Beginning { done, total, taken }: Beginning) {
            if let Some(Taken { tensors, of }) = taken {
                self.printer.status(&format!("starts from {tensors} of its {of} tensors; the others are random"));
            }
            self.bar.set_length(total);
            self.bar.set_position(done);
            self.bar.reset_eta();
        }

        fn advance(&mut self, step: u64, summary: &str) {
            self.bar.set_position(step);
            self.bar.set_message(summary.to_owned());
            let total = self.bar.length().unwrap_or(step);
            if self.line_is_due() || step == total {
                let left = HumanDuration(self.bar.eta());
                self.printer.status(&format!("step {step}/{total}  {left} left  {summary}"));
                self.last_line = Some(Instant::now());
            }
        }
    }

    impl Observer for Progress<'_> {
        fn begin(&mut self, beginning: Beginning) {
            Self::begin(self, beginning);
        }

        fn step(&mut self, record: &Record) {
            self.advance(record.step, &summary(record));
        }
    }

    impl RefinerObserver for Progress<'_> {
        fn begin(&mut self, beginning: Beginning) {
            Self::begin(self, beginning);
        }

        fn record(&mut self, record: &RefinerRecord) {
            let RefinerRecord { step, loss, depth_error, kind_error, learning_rate, samples_per_second } = record;
            let summary = format!(
                "loss {loss:.3}  depth off by {:.1}%  {:.1}% mistaken  rate {learning_rate:.1e}  {samples_per_second:.0} cut-outs/s",
                100.0 * depth_error,
                100.0 * kind_error
            );
            self.advance(*step, &summary);
        }
    }

    fn summary(record: &Record) -> String {
        let terms = record.terms.named().map(|(name, value)| format!("{name} {value:.3}")).join("  ");
        let Record { epoch, loss, learning_rate, samples_per_second, .. } = record;
        format!("epoch {epoch}  loss {loss:.3}  {terms}  rate {learning_rate:.1e}  {samples_per_second:.1} images/s")
    }
}
