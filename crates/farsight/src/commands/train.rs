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
    /// Go on although frames, labels or images are not those that the run began with
    #[arg(long, requires = "resume")]
    accept_other_data: bool,
}

/// Says how to get a build that can train.
#[cfg(not(feature = "train"))]
pub(crate) fn run(_: &TrainArgs, _: &mut Printer) -> Result<Outcome> {
    cannot_train()
}

/// What a build without libtorch says to whoever wants to train.
#[cfg(not(feature = "train"))]
pub(super) fn cannot_train() -> Result<Outcome> {
    anyhow::bail!(
        "this farsight was built without training, which needs libtorch; `cargo xtask libtorch` fetches it, `cargo xtask run train ...` builds and trains with it"
    )
}

/// Trains the method that the config names.
#[cfg(feature = "train")]
pub(crate) fn run(args: &TrainArgs, printer: &mut Printer) -> Result<Outcome> {
    use farsight_methods::training::train;
    use farsight_train::training::FileOptions;

    let options = FileOptions { data: args.data.clone(), out: args.out.clone(), resume: args.resume };
    let trained = train(&args.config, &options, &mut progress::Progress::new(printer, args.accept_other_data))?;
    printer.line(&trained.display().to_string());
    Ok(Outcome::Done)
}

#[cfg(feature = "train")]
pub(crate) mod progress {
    use std::io::{IsTerminal, stderr};
    use std::path::Path;
    use std::time::{Duration, Instant};

    use farsight_train::config::ValidateConfig;
    use farsight_train::executor::Precision;
    use farsight_train::metrics::StepSummary;
    use farsight_train::training::{Callback, Loaded, Start};
    use indicatif::{HumanDuration, ProgressBar, ProgressStyle};

    use crate::commands::validate::validated;
    use crate::printer::Printer;

    /// Time between two lines where there is no terminal to redraw a bar on.
    const LINE_INTERVAL: Duration = Duration::from_secs(20);

    /// How the run goes: a bar on a terminal, a line now and then elsewhere.
    pub(crate) struct Progress<'a> {
        bar: ProgressBar,
        printer: &'a mut Printer,
        last_line: Option<Instant>,
        accepts_other_data: bool,
        /// What the last validation measured.
        validation: String,
    }

    impl<'a> Progress<'a> {
        pub(crate) fn new(printer: &'a mut Printer, accepts_other_data: bool) -> Self {
            let template = "{bar:30} {pos}/{len} steps  {eta} left  {msg}";
            let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
            let bar = ProgressBar::new(0).with_style(style);
            Self { bar, printer, last_line: None, accepts_other_data, validation: String::new() }
        }

        fn line_is_due(&self) -> bool {
            !stderr().is_terminal() && self.last_line.is_none_or(|last| last.elapsed() >= LINE_INTERVAL)
        }
    }

    impl Callback for Progress<'_> {
        fn on_part(&mut self, name: &str, number: usize, of: usize) {
            self.printer.status(&format!("part {name}, {number} of {of}"));
        }

        fn on_start(&mut self, Start { done, total, loaded, precision, is_emulated }: Start) {
            if is_emulated {
                self.printer.warning(
                    "this CPU has no bfloat16 and emulates it, tens of times slower than train.precision = \"f32\"; \
                     \"auto\" takes what is faster",
                );
            } else if precision == Precision::Bf16 {
                self.printer.status("computes in bfloat16");
            }
            if let Some(Loaded { tensors, of }) = loaded {
                self.printer.status(&format!("starts from {tensors} of its {of} tensors; the others are random"));
            }
            self.bar.set_length(total);
            self.bar.set_position(done);
            self.bar.reset_eta();
        }

        fn accepts_other_data(&mut self, differences: &[String]) -> bool {
            if self.accepts_other_data {
                self.printer.warning(&format!("goes on with other data: {}", differences.join(", ")));
            }
            self.accepts_other_data
        }

        fn on_step(&mut self, step: &StepSummary) {
            let summary = self.summary(step);
            self.bar.set_position(step.step);
            self.bar.set_message(summary.clone());
            let total = self.bar.length().unwrap_or(step.step);
            if self.line_is_due() || step.step == total {
                let left = HumanDuration(self.bar.eta());
                self.printer.status(&format!("step {}/{total}  {left} left  {summary}", step.step));
                self.last_line = Some(Instant::now());
            }
        }

        fn validate(&mut self, step: u64, model: &Path, config: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
            let measured = validated(model, config).map_err(|error| format!("{error:#}"))?;
            let shown: Vec<String> = measured.iter().map(|(name, value)| format!("{name} {value:.3}")).collect();
            self.printer.status(&format!("step {step}: {}", shown.join("  ")));
            self.validation = shown.join("  ");
            Ok(measured)
        }
    }

    impl Progress<'_> {
        fn summary(&self, step: &StepSummary) -> String {
            let metrics: Vec<String> = step.metrics.iter().map(|(name, value)| format!("{name} {value:.3}")).collect();
            let StepSummary { epoch, loss, learning_rate, samples_per_second, samples, .. } = step;
            format!(
                "epoch {epoch}  loss {loss:.3}  {}  rate {learning_rate:.1e}  {samples_per_second:.1} {samples}/s  {}",
                metrics.join("  "),
                self.validation
            )
            .trim_end()
            .to_owned()
        }
    }
}
