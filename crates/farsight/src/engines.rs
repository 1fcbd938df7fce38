//! Opening a model on an engine.

use std::path::Path;

use anyhow::{Result, ensure};
use clap::ValueEnum;
use farsight_core::detection::DecodeOptions;
use farsight_infer::Detector;

/// What runs the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum EngineName {
    /// PyTorch's library; on the GPU when there is one
    Libtorch,
}

/// The model at `path` on this engine.
pub(crate) fn open(engine: EngineName, path: &Path, options: DecodeOptions) -> Result<Detector> {
    ensure!(
        path.is_file(),
        "{}: no such file; expected a model that `farsight train` or `farsight import` wrote",
        path.display()
    );
    match engine {
        EngineName::Libtorch => libtorch(path, options),
    }
}

#[cfg(feature = "train")]
fn libtorch(path: &Path, options: DecodeOptions) -> Result<Detector> {
    let (engine, config) = farsight_train::engine::TorchEngine::open(path)?;
    Ok(Detector::new(Box::new(engine), farsight_infer::DetectorSpec::new(&config, options)))
}

#[cfg(not(feature = "train"))]
fn libtorch(_: &Path, _: DecodeOptions) -> Result<Detector> {
    anyhow::bail!(
        "this farsight was built without libtorch; `cargo xtask libtorch` fetches it, `cargo xtask run range ...` builds and runs with it"
    )
}
