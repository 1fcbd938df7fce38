//! `farsight info`: what a model is made of and what it costs.

mod picture;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use farsight::shipped::Family;
use farsight::{model_file, shipped};
use farsight_files::{MeasuredTable, write_quickly};
use farsight_graph::blocks::blocks;
use farsight_graph::count::{StageCount, count, total};
use farsight_graph::graph::Graph;
use farsight_methods::description::Description;
use farsight_onnx::{Facts, OnnxModel, is_safetensors, key};

use super::Outcome;
use crate::pipeline_args::tell_unhashed;
use crate::printer::{Printer, grouped};
use crate::{outputs, untrained};

/// Arguments of `farsight info`.
#[derive(Debug, Args)]
pub(crate) struct InfoArgs {
    /// A model, a refiner or a plate reader (.safetensors, .onnx), "farsight-w", "farsight-s", "farsight-n",
    /// "farsight-w-refiner", "farsight-s-refiner" or "shipped-plates" for those that come with the program, or the
    /// config of a training (.toml)
    #[arg(value_name = "MODEL_OR_CONFIG")]
    model: PathBuf,
    /// Draw the network: its stages as boxes with parameters and multiply-accumulates
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Put its parameters and multiply-accumulates as a row into the table in FILE (JSON), for documents to quote
    /// (`farsight measure --docs`)
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &InfoArgs, printer: &mut Printer) -> Result<Outcome> {
    if let Some(path) = &args.svg {
        outputs::check_file(path)?;
    }
    if let Some(path) = &args.table {
        outputs::check_json(path, [&args.model])?;
    }
    let Description { input: [width, height], graph, facts, .. } = read(&args.model)?;
    tell_unhashed([args.model.clone()], printer);
    let stages = count(&graph, width, height).with_context(|| {
        format!("{}: its input of {width}x{height} pixels does not fit its network", args.model.display())
    })?;
    for (name, fact) in facts {
        printer.line(&format!("{name:15} {fact}"));
    }
    printer.line("");
    printer.heading(&format!("{:15} {:>12} {:>10}", "stage", "parameters", "GMAC"));
    for stage in stages.iter().chain([&total(&stages)]) {
        printer.line(&row(stage));
    }
    if let Some(path) = &args.svg {
        draw(path, &args.model, &graph, [width, height], &total(&stages))?;
    }
    if let Some(path) = &args.table {
        put(path, &args.model, [width, height], &total(&stages))?;
    }
    Ok(Outcome::Done)
}

/// Puts a row into the table at `path`, which need not be there yet.
fn put(path: &Path, model: &Path, [width, height]: [usize; 2], total: &StageCount) -> Result<()> {
    let columns = ["network", "input", "parameters", "GMAC"];
    let mut table = MeasuredTable::read_or_new(path, "farsight info MODEL_OR_CONFIG --table FILE", columns)?;
    let gmacs = format!("{:.2}", total.macs as f64 / 1e9);
    table.put([model.display().to_string(), format!("{width}x{height}"), grouped(total.parameters), gmacs]);
    Ok(table.write(path)?)
}

fn draw(path: &Path, model: &Path, graph: &Graph, [width, height]: [usize; 2], total: &StageCount) -> Result<()> {
    let blocks = blocks(graph, width, height).context("the input does not fit the network")?;
    let name = model.file_name().unwrap_or(model.as_os_str()).to_string_lossy();
    let gmacs = total.macs as f64 / 1e9;
    let title = format!("{name}: {} parameters, {gmacs:.2} GMAC", grouped(total.parameters));
    let svg = picture::svg(&title, &blocks);
    Ok(write_quickly(path, |file| file.write_all(svg.as_bytes()))?)
}

fn read(path: &Path) -> Result<Description> {
    if untrained::is_config(path) {
        return untrained::read(path);
    }
    let told_of = |(description, facts): (Description, Facts)| with(description, told(&facts));
    match model_file::shipped_detector(path) {
        Some(Family::FarsightW) => return Ok(told_of(Description::of_model(&shipped::ssd()?))),
        Some(Family::FarsightS) => return Ok(told_of(Description::of_model(&shipped::smoke()?))),
        Some(Family::FarsightN) => return Ok(told_of(Description::of_model(&shipped::small_smoke()?))),
        None => {}
    }
    if let Some(family) = model_file::shipped_refiner(path) {
        return Ok(told_of(Description::of_model(&shipped::refiner(family)?)));
    }
    if path == Path::new(model_file::SHIPPED_PLATES) {
        return Ok(told_of(Description::of_model(&shipped::plates()?)));
    }
    model_file::check(path, "a model, a refiner, a plate reader or the config of a training (.toml)")?;
    if is_safetensors(path).with_context(|| format!("{}: cannot be read", path.display()))? {
        return Ok(told_of(Description::of_model_file(path)?));
    }
    let onnx = OnnxModel::read(path)?;
    let mut told = told(onnx.facts());
    if onnx.facts().get(key::NARROWED).is_some() {
        // How wide the layers are stands in the file's constants alone.
        told.push(("pruned", "yes; these are the counts of the network before pruning".to_owned()));
    }
    Ok(with(Description::of_onnx(&onnx, path)?, told))
}

/// A network, and what else its file tells.
fn with(mut description: Description, told: Vec<(&'static str, String)>) -> Description {
    description.facts.extend(told);
    description
}

/// Facts that only the one who trained the model knows, and the hash that tells two models apart.
fn told(facts: &Facts) -> Vec<(&'static str, String)> {
    let names = [
        ("training", key::TRAINING),
        ("trained on", key::TRAINING_DATA),
        ("its licence", key::TRAINING_DATA_LICENCE),
        ("made from", key::ATTRIBUTION),
        ("camera", key::CAMERA),
        ("evaluation", key::EVALUATION),
        ("8 bits", key::QUANTIZATION),
        ("weights SHA-256", key::WEIGHTS_SHA256),
    ];
    names.into_iter().filter_map(|(name, key)| Some((name, facts.get(key)?.to_owned()))).collect()
}

fn row(stage: &StageCount) -> String {
    let gmacs = stage.macs as f64 / 1e9;
    format!("{:15} {:>12} {gmacs:>10.3}", stage.stage, grouped(stage.parameters))
}
