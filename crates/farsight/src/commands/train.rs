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

/// Trains a detector, or a refiner or a plate reader where the config is one's.
#[cfg(feature = "train")]
pub(crate) fn run(args: &TrainArgs, printer: &mut Printer) -> Result<Outcome> {
    use anyhow::Context;
    use farsight_train::config::RunConfig;
    use farsight_train::crops::{CropNetwork, CropRun};
    use farsight_train::trainer::Job;
    use farsight_train::{detector, plate, refiner};

    let (out, resume) = (args.out.clone(), args.resume);
    let mut progress = progress::Progress::new(printer);
    let trained = if std::fs::read_to_string(&args.config).is_ok_and(|text| CropRun::is_meant(&text)) {
        let mut run = CropRun::read(&args.config)?;
        args.override_data(&mut run.data);
        let job = Job { run, out, resume };
        match job.run.network().context("no network")? {
            CropNetwork::Refiner(config) => refiner::train(&job, config, &mut progress)?,
            CropNetwork::Plates(config) => plate::train(&job, config, &mut progress)?,
        }
    } else {
        let mut run = RunConfig::read(&args.config)?;
        args.override_data(&mut run.data);
        detector::train(&Job { run, out, resume }, &mut progress)?
    };
    printer.line(&trained.display().to_string());
    Ok(Outcome::Done)
}

#[cfg(feature = "train")]
mod progress {
    use std::io::{IsTerminal, stderr};
    use std::time::{Duration, Instant};

    use farsight_train::metrics::{Record, Terms};
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

    impl<T: Terms> Observer<T> for Progress<'_> {
        fn begin(&mut self, Beginning { done, total, taken }: Beginning) {
            if let Some(Taken { tensors, of }) = taken {
                self.printer.status(&format!("starts from {tensors} of its {of} tensors; the others are random"));
            }
            self.bar.set_length(total);
            self.bar.set_position(done);
            self.bar.reset_eta();
        }

        fn step(&mut self, record: &Record<T>) {
            let summary = summary(record);
            self.bar.set_position(record.step);
            self.bar.set_message(summary.clone());
            let total = self.bar.length().unwrap_or(record.step);
            if self.line_is_due() || record.step == total {
                let left = HumanDuration(self.bar.eta());
                self.printer.status(&format!("step {}/{total}  {left} left  {summary}", record.step));
                self.last_line = Some(Instant::now());
            }
        }
    }

    fn summary<T: Terms>(record: &Record<T>) -> String {
        let terms: Vec<String> =
            record.terms.named().iter().map(|(name, value)| format!("{name} {value:.3}")).collect();
        let Record { epoch, loss, learning_rate, samples_per_second, .. } = record;
        format!(
            "epoch {epoch}  loss {loss:.3}  {}  rate {learning_rate:.1e}  {samples_per_second:.1} {}/s",
            terms.join("  "),
            T::SAMPLES
        )
    }
}
