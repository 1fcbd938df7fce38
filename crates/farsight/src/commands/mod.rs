//! One file a command.

mod bench;
mod calibrate;
mod completions;
mod demo;
mod doctor;
mod engine;
pub(crate) mod eval;
mod eval_tracks;
mod experiment;
mod export;
mod fine_tune;
mod import;
mod info;
mod man;
mod measure;
mod merge;
mod parity;
mod prune;
mod range;
mod robustness;
mod serve;
pub(crate) mod synth;
mod track;
pub(crate) mod train;
#[cfg(feature = "train")]
mod validate;

use anyhow::Result;
use clap::{Parser, Subcommand};
use farsight_methods::input_spec::SIZE_STEP;
use farsight_methods::smoke::config::MAX_SIDE;

use crate::printer::{LogLevel, Printer};

/// Finds vehicles in images of one camera and says how far away each is.
#[derive(Debug, Parser)]
#[command(name = "farsight", version, arg_required_else_help = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Print nothing about the results but what failed; the same as --log-level error
    #[arg(short, long, global = true, conflicts_with = "log_level")]
    pub(crate) quiet: bool,
    /// What to print about the results: error, warn or info [default: info]
    #[arg(long, global = true, value_name = "LEVEL", value_enum, hide_possible_values = true)]
    pub(crate) log_level: Option<LogLevel>,
    /// Refuse images with more pixels, counted as they unpack: 16 bits and four channels count more [default: 100M]
    #[arg(long, global = true, value_name = "N", value_parser = pixels)]
    pub(crate) max_pixels: Option<u64>,
}

/// A number of pixels: `40000000` or `40M`.
fn pixels(text: &str) -> Result<u64, String> {
    let (digits, factor) = text.strip_suffix(['M', 'm']).map_or((text, 1), |digits| (digits, 1_000_000));
    let count = digits.parse::<u64>().ok().and_then(|count| count.checked_mul(factor)).filter(|&count| count > 0);
    count.ok_or_else(|| "expected a number of pixels, such as 40000000 or 40M".to_owned())
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Try it: the model that comes with the program on scenes that come with it
    Demo(demo::DemoArgs),
    /// Find vehicles in images and say how far away each is
    Range(range::RangeArgs),
    /// Find out how a fixed camera stands over its road, from the traffic that it sees
    Calibrate(calibrate::CalibrateArgs),
    /// Follow vehicles through a video: identity, distance, speed and time to collision
    Track(Box<track::TrackArgs>),
    /// Answer images over HTTP, with a page to try it
    Serve(serve::ServeArgs),
    /// Judge result files as KITTI does, and their errors of distance
    Eval(Box<eval::EvalArgs>),
    /// Judge tracks against labelled sequences: HOTA, and errors of distance, speed and time to collision
    EvalTracks(eval_tracks::EvalTracksArgs),
    /// Render traffic scenes with exact labels
    Synth(synth::SynthArgs),
    /// Train a model
    Train(train::TrainArgs),
    /// Train a model on with your own labelled images, and fit its error bars
    FineTune(fine_tune::FineTuneArgs),
    /// Turn a checkpoint of SMOKE, mmdetection3d or ImageNet's DLA-34 into Farsight's format
    Import(import::ImportArgs),
    /// Write a model as an ONNX file, checked before it is kept
    Export(export::ExportArgs),
    /// Compare an engine's answers with stored reference tensors
    Parity(parity::ParityArgs),
    /// Manage the libraries of the optional engines
    Engine(engine::EngineCommandArgs),
    /// Show what this machine has to run models with, and what would help
    Doctor(doctor::DoctorArgs),
    /// Time every stage, from the image file to the picture
    Bench(bench::BenchArgs),
    /// Remove the channels of a model that matter least
    Prune(prune::PruneArgs),
    /// Put the parts of a job together that --shard divided
    Merge(merge::MergeArgs),
    /// Show what a model is made of and what it costs
    Info(info::InfoArgs),
    /// Measure a model on several data sets, and put the figures into documents
    Measure(measure::MeasureArgs),
    /// Judge a model on images that are made worse step by step: noise, blur, light, compression, weather
    Robustness(robustness::RobustnessArgs),
    /// Train and judge several arms with several seeds, as a plan says
    Experiment(experiment::ExperimentArgs),
    /// Print the script by which a shell completes commands and options
    Completions(completions::CompletionsArgs),
    /// Print a manual page
    Man(man::ManArgs),
}

/// How a command ended that could run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// All is well.
    Done,
    /// Done, with something that the caller asked to be told by the exit status.
    Told,
    /// The time that was given is over before the work; the same command goes on.
    #[cfg_attr(not(feature = "train"), allow(dead_code, reason = "only training takes so long"))]
    Unfinished,
}

impl Command {
    /// Runs the command; an error means that it could not run.
    pub(crate) fn run(self, printer: &mut Printer) -> Result<Outcome> {
        match self {
            Self::Demo(args) => demo::run(&args, printer),
            Self::Range(args) => range::run(&args, printer),
            Self::Robustness(args) => robustness::run(&args, printer),
            Self::Calibrate(args) => calibrate::run(&args, printer),
            Self::Track(args) => track::run(&args, printer),
            Self::Serve(args) => serve::run(&args, printer),
            Self::Eval(args) => eval::run(&args, printer),
            Self::EvalTracks(args) => eval_tracks::run(&args, printer),
            Self::Synth(args) => synth::run(&args, printer),
            Self::Train(args) => train::run(&args, printer),
            Self::FineTune(args) => fine_tune::run(&args, printer),
            Self::Import(args) => import::run(&args, printer),
            Self::Export(args) => export::run(&args, printer),
            Self::Parity(args) => parity::run(&args, printer),
            Self::Engine(args) => engine::run(&args, printer),
            Self::Doctor(args) => doctor::run(&args, printer),
            Self::Bench(args) => bench::run(&args, printer),
            Self::Prune(args) => prune::run(&args, printer),
            Self::Info(args) => info::run(&args, printer),
            Self::Completions(args) => completions::run(&args, printer),
            Self::Man(args) => man::run(&args, printer),
            Self::Merge(args) => merge::run(&args, printer),
            Self::Measure(args) => measure::run(&args, printer),
            Self::Experiment(args) => experiment::run(&args, printer),
        }
    }
}

/// Width and height of a network's input, as in `1280x384`.
fn input_size(text: &str) -> Result<[usize; 2], String> {
    let sides = text.split_once('x').map(|(width, height)| [width.parse(), height.parse()]);
    match sides {
        Some([Ok(width), Ok(height)])
            if [width, height].iter().all(|side| (1..=MAX_SIDE).contains(side) && side % SIZE_STEP == 0) =>
        {
            Ok([width, height])
        }
        _ => Err(format!("expected width and height in multiples of {SIZE_STEP}, at most {MAX_SIDE}: 1280x384")),
    }
}
