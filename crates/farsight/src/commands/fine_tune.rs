//! `farsight fine-tune`: someone's own labels, in one command. It trains a detector on and fits its scores and error
//! bars on frames that it did not learn from. Training needs the cargo feature `train`.

use std::path::PathBuf;

use clap::Args;
use farsight::shipped::Family;

/// Arguments of `farsight fine-tune`.
#[derive(Debug, Args)]
#[cfg_attr(not(feature = "train"), allow(dead_code, reason = "without training they are only checked"))]
pub(crate) struct FineTuneArgs {
    /// Labelled images in KITTI's layout, a few hundred at least
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// The model to write
    #[arg(long, value_name = "FILE.safetensors")]
    out: PathBuf,
    /// Frames to use: a name under `ImageSets` or a file with a frame a line
    /// [default: those of `ImageSets/train.txt` if that is there, otherwise all]
    #[arg(long, value_name = "SPLIT")]
    split: Option<PathBuf>,
    /// Labelled images to fit scores and error bars on, not those of --data
    /// [default: every fifth frame, which is not learnt from]
    #[arg(long, value_name = "DIR")]
    fit_on: Option<PathBuf>,
    /// The detector to go on from: a SMOKE of `farsight train`, "farsight-s" or "farsight-n"
    #[arg(long, value_name = "FILE", default_value = Family::FarsightS.name())]
    model: PathBuf,
    /// Passes over the frames
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    epochs: u64,
    /// Folder for checkpoints and metrics [default: the name of --out, with -run]
    #[arg(long, value_name = "RUN")]
    run: Option<PathBuf>,
    /// Go on with the run that is in RUN
    #[arg(long)]
    resume: bool,
}

/// Says how to get a build that can train.
#[cfg(not(feature = "train"))]
pub(crate) fn run(_: &FineTuneArgs, _: &mut crate::printer::Printer) -> anyhow::Result<super::Outcome> {
    super::train::cannot_train()
}

#[cfg(feature = "train")]
pub(crate) use training::run;

#[cfg(feature = "train")]
mod training {
    use std::path::{Path, PathBuf};

    use anyhow::{Context, Result, ensure};
    use farsight::model_file::read_own;
    use farsight_data::open_labelled;
    use farsight_files::write_atomically;
    use farsight_methods::smoke::SmokeModel;
    use farsight_methods::smoke::config::SmokeConfig;
    use farsight_methods::training::train;
    use farsight_train::training::FileOptions;
    use toml::{Table, Value};

    use super::FineTuneArgs;
    use crate::commands::Outcome;
    use crate::commands::export::fit::fit;
    use crate::commands::train::progress::Progress;
    use crate::outputs;
    use crate::pipeline_args::tell_unhashed;
    use crate::printer::Printer;

    /// How it learns: all but the network, which is that of the model.
    const RECIPE: &str = include_str!("../../assets/fine-tune.toml");

    /// Of so many frames one is not learnt from, and serves to fit on.
    const HELD_OUT_STEP: usize = 5;

    /// Fewer frames teach nothing.
    const MIN_FRAMES: usize = 10;

    /// Runs the command.
    pub(crate) fn run(args: &FineTuneArgs, printer: &mut Printer) -> Result<Outcome> {
        outputs::check_kind(&args.out, "onnx", "a name ending in .safetensors; `farsight export` makes ONNX of it")?;
        tell_unhashed([args.model.clone()], printer);
        let start = read_own(&args.model)?;
        let run = args.run.clone().unwrap_or_else(|| with_suffix(&args.out, "-run"));
        outputs::make_folder(&run)?;
        let [learnt, held_out] = splits(args)?;
        printer.status(&format!(
            "{} frames to learn from, {} to fit on",
            learnt.len(),
            fit_words(args, held_out.len())
        ));
        let [learnt_file, held_out_file] = [("train.txt", &learnt), ("held-out.txt", &held_out)].map(|(name, ids)| {
            let path = run.join(name);
            write_atomically(&path, |out| ids.iter().try_for_each(|id| writeln!(out, "{id}"))).map(|()| path)
        });
        let config = write_config(args, &start, &run, &learnt_file?, learnt.len())?;
        let options = FileOptions { data: Some(args.data.clone()), out: run, resume: args.resume };
        let trained = train(&config, &options, &mut Progress::new(printer, false))?;
        let mut model = SmokeModel::read(&trained)?;
        match &args.fit_on {
            Some(data) => fit(&mut model, &trained, data, None, printer)?,
            None => fit(&mut model, &trained, &args.data, Some(&held_out_file?), printer)?,
        }
        model.write_half(&args.out)?;
        printer.line(&format!("{}: half-precision numbers", args.out.display()));
        Ok(Outcome::Done)
    }

    fn fit_words(args: &FineTuneArgs, held_out: usize) -> String {
        args.fit_on.as_ref().map_or_else(|| held_out.to_string(), |data| format!("those of {}", data.display()))
    }

    /// The frames to learn from, and those to fit on.
    fn splits(args: &FineTuneArgs) -> Result<[Vec<String>; 2]> {
        let own = args.data.join("ImageSets/train.txt");
        let split = args.split.clone().or_else(|| own.is_file().then(|| PathBuf::from("train")));
        let ids = open_labelled(&args.data, split.as_deref())?.ids();
        let data = args.data.display();
        ensure!(ids.len() >= MIN_FRAMES, "{data}: {} labelled frames; expected at least {MIN_FRAMES}", ids.len());
        let holds_out = args.fit_on.is_none();
        let (held_out, learnt): (Vec<_>, Vec<_>) =
            ids.into_iter().enumerate().partition(|(place, _)| holds_out && (place + 1) % HELD_OUT_STEP == 0);
        Ok([learnt, held_out].map(|ids| ids.into_iter().map(|(_, id)| id).collect()))
    }

    /// The config of the run: the recipe, the network of `start` and its weights.
    fn write_config(
        args: &FineTuneArgs,
        start: &SmokeModel,
        run: &Path,
        learnt: &Path,
        frames: usize,
    ) -> Result<PathBuf> {
        let start_file = run.join("start.safetensors");
        start.write(&start_file)?;
        let mut config: Table = RECIPE.parse().context("configs/fine-tune.toml")?;
        config.insert("model".to_owned(), Value::try_from(unfitted(start.config.clone()))?);
        let number = |key: &str| config["train"].get(key).and_then(Value::as_integer).unwrap_or(1);
        // As many batches as it learns from are enough for the statistics.
        let steps = i64::try_from(args.epochs)?.saturating_mul((i64::try_from(frames)? / number("batch_size")).max(1));
        let statistics_batches = number("statistics_batches").min(steps);
        let mut set = |table: &str, key: &str, value: Value| {
            if let Some(Value::Table(table)) = config.get_mut(table) {
                table.insert(key.to_owned(), value);
            }
        };
        set("train", "start_from", Value::String(start_file.display().to_string()));
        set("train", "epochs", Value::Integer(i64::try_from(args.epochs)?));
        set("train", "statistics_batches", Value::Integer(statistics_batches));
        set("data", "split", Value::String(learnt.display().to_string()));
        let path = run.join("fine-tune.toml");
        write_atomically(&path, |out| out.write_all(config.to_string().as_bytes()))?;
        Ok(path)
    }

    /// What was fitted says nothing of weights that have moved.
    fn unfitted(mut config: SmokeConfig) -> SmokeConfig {
        config.depth.error = None;
        config.classes.iter_mut().for_each(|class| class.score = None);
        config
    }

    /// `path` without its extension, and with `suffix`.
    fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
        let mut name = path.file_stem().unwrap_or(path.as_os_str()).to_owned();
        name.push(suffix);
        path.with_file_name(name)
    }
}
