//! Opening a model on an engine: the one place where commands get a network that runs.

use std::path::Path;

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use farsight_core::detection::DecodeOptions;
use farsight_infer::{Detector, DetectorSpec, Engine, RtenEngine};
use farsight_net::config::ModelConfig;
use farsight_net::onnx::{OnnxModel, Target};

/// What runs the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum EngineName {
    /// Built in, needs nothing
    Rten,
    /// PyTorch's library; on the GPU when there is one
    Libtorch,
}

/// Which engine, and how it is to run.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub(crate) struct EngineArgs {
    /// What runs the network
    #[arg(long, value_enum, default_value_t = EngineName::Rten)]
    pub(crate) engine: EngineName,
    /// Threads of the network [default: one for each core]
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
}

/// More threads than any computer has cores are a mistake.
const MOST_THREADS: usize = 1024;

fn threads(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| (1..=MOST_THREADS).contains(count));
    count.ok_or_else(|| format!("expected a number from 1 to {MOST_THREADS}"))
}

/// An engine that runs a model, and what the model is.
pub(crate) struct Opened {
    /// The engine.
    pub(crate) engine: Box<dyn Engine>,
    /// The model's description.
    pub(crate) config: ModelConfig,
}

/// The model at `path`, ready to look at images.
pub(crate) fn open_detector(args: &EngineArgs, path: &Path, options: DecodeOptions) -> Result<Detector> {
    let Opened { engine, config } = open(args, path)?;
    Ok(Detector::new(engine, DetectorSpec::new(&config, options)))
}

/// The model at `path`, an ONNX file or a model of ours, on the engine that `args` ask for.
pub(crate) fn open(args: &EngineArgs, path: &Path) -> Result<Opened> {
    ensure!(
        path.is_file(),
        "{}: no such file; expected a model that `farsight train`, `farsight import` or `farsight export` wrote",
        path.display()
    );
    match args.engine {
        EngineName::Rten => rten(OnnxModel::read_any(path, Target::Portable)?, args, path),
        EngineName::Libtorch => libtorch(path),
    }
}

/// A model in memory on rten; `source` is only what errors call it.
pub(crate) fn rten(model: OnnxModel, args: &EngineArgs, source: &Path) -> Result<Opened> {
    ensure!(
        !model.has_deform_conv(),
        "{}: its deformable convolutions are in the form that only ONNX Runtime has; export it with --target portable, or say --engine onnxruntime",
        source.display()
    );
    let config = model.config().clone();
    let engine = RtenEngine::new(model, args.threads)?;
    Ok(Opened { engine: Box::new(engine), config })
}

#[cfg(feature = "train")]
fn libtorch(path: &Path) -> Result<Opened> {
    let (engine, config) = farsight_train::engine::TorchEngine::open(path)?;
    Ok(Opened { engine: Box::new(engine), config })
}

#[cfg(not(feature = "train"))]
fn libtorch(_: &Path) -> Result<Opened> {
    anyhow::bail!(
        "this farsight was built without libtorch; `cargo xtask libtorch` fetches it, `cargo xtask run range ...` builds and runs with it"
    )
}
