//! `farsight info`: what a model is made of and what it costs.

mod picture;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use farsight::shipped::Family;
use farsight::{model_file, shipped};
use farsight_core::DepthFusion;
use farsight_core::DepthReference;
use farsight_files::write_quickly;
use farsight_graph::blocks::blocks;
use farsight_graph::count::{StageCount, count, total};
use farsight_graph::graph::Graph;
use farsight_graph::model::NetworkConfig;
use farsight_methods::detectors::{Description, config_of};
use farsight_methods::plate_reader::{PlateReaderConfig, PlateReaderModel};
use farsight_methods::refiner::{RefinerConfig, RefinerModel};
use farsight_methods::smoke::config::SmokeConfig;
use farsight_methods::smoke::network::Backbone;
use farsight_methods::smoke::{DetectorFile, SmokeModel};
use farsight_onnx::{Facts, OnnxModel, Target, is_safetensors, key};

use super::Outcome;
use crate::pipeline_args::tell_unhashed;
use crate::printer::{Printer, grouped};
use crate::untrained::Untrained;
use crate::{outputs, untrained};

/// Arguments of `farsight info`.
#[derive(Debug, Args)]
pub(crate) struct InfoArgs {
    /// A model, a refiner or a plate reader (.safetensors, .onnx), "farsight-w", "farsight-s", "farsight-w-refiner",
    /// "farsight-s-refiner" or "shipped-plates" for those that come with the program, or the config of a training
    /// (.toml)
    #[arg(value_name = "MODEL_OR_CONFIG")]
    model: PathBuf,
    /// Draw the network: its stages as boxes with parameters and multiply-accumulates
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &InfoArgs, printer: &mut Printer) -> Result<Outcome> {
    if let Some(path) = &args.svg {
        outputs::check_file(path)?;
    }
    let Described { input: [width, height], graph, facts } = read(&args.model)?;
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
    Ok(Outcome::Done)
}

fn draw(path: &Path, model: &Path, graph: &Graph, [width, height]: [usize; 2], total: &StageCount) -> Result<()> {
    let blocks = blocks(graph, width, height).context("the input does not fit the network")?;
    let name = model.file_name().unwrap_or(model.as_os_str()).to_string_lossy();
    let gmacs = total.macs as f64 / 1e9;
    let title = format!("{name}: {} parameters, {gmacs:.2} GMAC", grouped(total.parameters));
    let svg = picture::svg(&title, &blocks);
    Ok(write_quickly(path, |file| file.write_all(svg.as_bytes()))?)
}

/// A file as it describes itself.
struct Described {
    /// Width and height, pixels.
    input: [usize; 2],
    graph: Graph,
    facts: Vec<(&'static str, String)>,
}

impl Described {
    /// A detector, and what else its file tells.
    fn new(config: &SmokeConfig, graph: Graph, told: Vec<(&'static str, String)>) -> Self {
        Self { input: config.input, graph, facts: facts(config).into_iter().chain(told).collect() }
    }
}

fn read(path: &Path) -> Result<Described> {
    if untrained::is_config(path) {
        return Ok(match untrained::read(path)? {
            Untrained::Smoke(config) => Described::new(&config, config.graph(), Vec::new()),
            Untrained::Other(description) => whole(description, Vec::new()),
            Untrained::Refiner(config) => refiner(&config, None),
            Untrained::Plates(config) => plates(&config, None),
        });
    }
    match model_file::detector_of_word(path) {
        Some(Family::World) => {
            let (description, facts) = Description::of_model(&shipped::world()?);
            return Ok(whole(description, told(&facts)));
        }
        Some(Family::Smoke) => return Ok(detector(&shipped::smoke()?)),
        None => {}
    }
    if let Some(family) = model_file::refiner_of_word(path) {
        let RefinerModel { config, weights, .. } = shipped::refiner(family)?;
        return Ok(refiner(&config, weights.metadata.get(key::TRAINING)));
    }
    if path == Path::new(model_file::SHIPPED_PLATES) {
        let PlateReaderModel { config, weights, .. } = shipped::plates()?;
        return Ok(plates(&config, weights.metadata.get(key::TRAINING)));
    }
    model_file::check(path, "a model, a refiner, a plate reader or the config of a training (.toml)")?;
    if is_safetensors(path).with_context(|| format!("{}: cannot be read", path.display()))? {
        if RefinerModel::is_one(path) {
            let RefinerModel { config, weights, .. } = RefinerModel::read(path)?;
            return Ok(refiner(&config, weights.metadata.get(key::TRAINING)));
        }
        if PlateReaderModel::is_one(path) {
            let PlateReaderModel { config, weights, .. } = PlateReaderModel::read(path)?;
            return Ok(plates(&config, weights.metadata.get(key::TRAINING)));
        }
        if let Some((description, facts)) = Description::of_model_file(path)? {
            return Ok(whole(description, told(&facts)));
        }
        return Ok(detector(&SmokeModel::read(path)?));
    }
    let onnx = OnnxModel::read(path)?;
    match onnx.facts().get(key::METHOD) {
        Some(RefinerConfig::METHOD) => return Ok(refiner(&config_of(&onnx, path)?, None)),
        Some(PlateReaderConfig::METHOD) => return Ok(plates(&config_of(&onnx, path)?, None)),
        _ => (),
    }
    if let Some(description) = Description::of_onnx(&onnx, path)? {
        return Ok(whole(description, told(onnx.facts())));
    }
    let file = DetectorFile::from_onnx(onnx, path)?;
    let mut told = told(file.onnx.facts());
    if file.onnx.facts().get(key::NARROWED).is_some() {
        // How wide the layers are stands in the file's constants alone.
        told.push(("pruned", "yes; these are the counts of the network before pruning".to_owned()));
    }
    Ok(Described::new(&file.config, file.config.graph(), told))
}

/// A pruned model is narrower than its config says.
fn detector(model: &SmokeModel) -> Described {
    let told = told(&DetectorFile::facts(model, Target::default()));
    Described::new(&model.config, model.graph.clone(), told)
}

/// A detector whose network is run as one.
fn whole(description: Description, told: Vec<(&'static str, String)>) -> Described {
    let Description { input, graph, facts, .. } = description;
    Described { input, graph, facts: facts.into_iter().chain(told).collect() }
}

fn refiner(config: &RefinerConfig, training: Option<&String>) -> Described {
    let RefinerConfig { side, channels, fusion, .. } = config;
    let mut facts = vec![
        ("refiner", format!("refines each object, cut out at {side} x {side} pixels")),
        ("channels", format!("{channels:?}")),
        ("detector and refiner", correlation(&fusion.depths)),
    ];
    facts.extend(training.map(|training| ("training", training.clone())));
    Described { input: [*side; 2], graph: config.graph(), facts }
}

fn plates(config: &PlateReaderConfig, training: Option<&String>) -> Described {
    let PlateReaderConfig { side, channels, depths, .. } = config;
    let mut facts = vec![
        ("plate reader", format!("measures cars by their number plates, cut out at {side} x {side} pixels")),
        ("channels", format!("{channels:?}")),
        ("plates and boxes", correlation(depths)),
    ];
    facts.extend(training.map(|training| ("training", training.clone())));
    Described { input: [*side; 2], graph: config.graph(), facts }
}

fn correlation(depths: &DepthFusion) -> String {
    format!("errors correlated by {:.2}", depths.correlation)
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

fn facts(config: &SmokeConfig) -> Vec<(&'static str, String)> {
    let classes: Vec<&str> = config.classes.iter().map(|class| class.class.name()).collect();
    let [width, height] = config.input;
    let sizes = match config.backbone {
        Backbone::Dla34 => {
            [("channels", format!("{:?}", config.channels())), ("stem", format!("{:?}", config.stem).to_lowercase())]
        }
        other => [("backbone", other.name().to_owned()), ("neck channels", config.neck_width().to_string())],
    };
    let [first, second] = sizes;
    vec![
        ("input", format!("{width} x {height} pixels")),
        ("classes", classes.join(", ")),
        first,
        second,
        ("normalisation", format!("{:?}", config.norm).to_lowercase()),
        ("neck", format!("{:?}", config.neck).to_lowercase()),
        ("MSFE", format!("{:?}", config.msfe).to_lowercase()),
        ("depth", depth(&config.depth)),
    ]
}

fn depth(reference: &DepthReference) -> String {
    let DepthReference { mean_m, std_m, focal_px, error } = reference;
    let focal = focal_px.map_or(String::new(), |px| format!(" at a focal length of {px:.1} pixels of the input"));
    let bars = if error.is_some() { ", with error bars" } else { "" };
    format!("{mean_m:.2} m, give or take {std_m:.2} m{focal}{bars}")
}

fn row(stage: &StageCount) -> String {
    let gmacs = stage.macs as f64 / 1e9;
    format!("{:15} {:>12} {gmacs:>10.3}", stage.stage, grouped(stage.parameters))
}
