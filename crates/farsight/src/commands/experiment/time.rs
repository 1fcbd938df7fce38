//! `farsight experiment time`: how long each arm takes for an image, engine by engine, in turns.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use farsight::{ModelSource, Pipeline, PipelineBuilder, Road, StageSource, shipped};
use farsight_files::Scratch;

use crate::commands::Outcome;
use crate::commands::bench::{WARM_UP, cores, median, pass};
use crate::experiment::plan::Work;
use crate::experiment::times::{ArmTime, Times};
use crate::experiment::{Cell, Experiment};
use crate::pipeline_args::{self, EngineArgs, EngineName};
use crate::printer::{Printer, counted};
use crate::{outputs, untrained};

/// Times that each arm has its turn on each engine.
const ROUNDS: usize = 5;

/// Arguments of `farsight experiment time`.
#[derive(Debug, Args)]
#[command(after_help = "\
farsight experiment time configs/experiments/table1.toml
farsight experiment time configs/experiments/table1.toml --engines openvino --cells runs/table1")]
pub(crate) struct TimeArgs {
    /// The plan, TOML
    #[arg(value_name = "FILE")]
    plan: PathBuf,
    /// What runs the networks, in single precision
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["rten", "onnxruntime", "openvino"])]
    engines: Vec<EngineName>,
    /// Threads of the networks [default: one for each core]
    #[arg(long, value_name = "N", value_parser = pipeline_args::threads)]
    threads: Option<usize>,
    /// Folder of the cells: an arm that was trained there is timed with its weights; others have random ones
    #[arg(long, value_name = "DIR")]
    cells: Option<PathBuf>,
    /// Image to look at [default: a scene that comes with the program, 1242x375 JPEG]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    /// How often an image is looked at in each turn
    #[arg(long, value_name = "N", default_value_t = 10)]
    runs: usize,
    /// File of the times, JSON [default: docs/results/NAME-times.json]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// An arm on an engine.
struct Candidate {
    arm: String,
    engine: String,
    trained: bool,
    pipeline: Pipeline,
    rounds_ms: Vec<f64>,
    objects: usize,
}

/// Runs the command.
pub(crate) fn run(args: &TimeArgs, printer: &mut Printer) -> Result<Outcome> {
    ensure!(args.runs > 0, "--runs is 0; expected at least one");
    let plan = Experiment::read(&args.plan)?;
    let out = args.out.clone().unwrap_or_else(|| format!("docs/results/{}-times.json", plan.name).into());
    outputs::check_json(&out, args.image.iter().map(PathBuf::as_path))?;
    let folder = Scratch::temporary_folder().context("no folder for the scene")?;
    let image = match &args.image {
        Some(image) => image.clone(),
        None => shipped::write_scenes(folder.path())?.join("000000.jpg"),
    };
    let mut candidates = Vec::new();
    for (arm, cell) in first_cells(&plan) {
        for &engine in &args.engines {
            let opened = open(args, &plan, &cell, engine, folder.path()).with_context(|| arm.clone())?;
            if let Some((pipeline, trained)) = opened {
                let engine = pipeline.engine().to_owned();
                candidates.push(Candidate {
                    arm: arm.clone(),
                    engine,
                    trained,
                    pipeline,
                    rounds_ms: Vec::new(),
                    objects: 0,
                });
            }
        }
    }
    for candidate in &candidates {
        for _ in 0..WARM_UP {
            pass(&image, 1, &candidate.pipeline)?;
        }
    }
    for round in 0..ROUNDS {
        printer.status(&format!("round {} of {ROUNDS}, {}", round + 1, counted(candidates.len(), "network")));
        for candidate in &mut candidates {
            let passes = (0..args.runs).map(|_| pass(&image, 1, &candidate.pipeline)).collect::<Result<Vec<_>>>()?;
            candidate.rounds_ms.push(median(passes.iter().map(|pass| 1e3 * pass.times.total().as_secs_f64())));
            candidate.objects = passes.iter().map(|pass| pass.objects).max().unwrap_or(0);
        }
    }
    let (width, height) = image::image_dimensions(&image).with_context(|| image.display().to_string())?;
    let times = Times {
        image: [width as usize, height as usize],
        cores: cores(),
        threads: args.threads,
        arms: candidates.iter().map(Candidate::time).collect(),
    };
    for line in times.rows(&plan) {
        printer.line(&line);
    }
    times.write(&out)?;
    printer.line(&out.display().to_string());
    Ok(Outcome::Done)
}

/// The first cell of each arm, in the order of the plan.
fn first_cells(plan: &Experiment) -> Vec<(String, Cell)> {
    let mut cells: BTreeMap<String, Cell> = BTreeMap::new();
    for cell in plan.cells() {
        cells.entry(cell.arm.clone()).or_insert(cell);
    }
    plan.arms().into_iter().filter_map(|arm| Some((arm.clone(), cells.remove(&arm)?))).collect()
}

/// What looks in an arm, and whether it has learnt; none of a ranger, which takes no time to speak of.
fn open(
    args: &TimeArgs,
    plan: &Experiment,
    cell: &Cell,
    engine: EngineName,
    folder: &Path,
) -> Result<Option<(Pipeline, bool)>> {
    let options = EngineArgs { engine, threads: args.threads, ..EngineArgs::default() }.options()?;
    let alone = || Pipeline::builder().road(Road::Ignored).refiner(StageSource::Off).plates(StageSource::Off);
    let trained = args.cells.as_ref().map(|cells| cells.join(cell.name()).join("model.safetensors"));
    let (builder, trained): (PipelineBuilder, bool) = match (plan.work(cell), trained.filter(|path| path.is_file())) {
        (Work::Ranging { .. }, _) => return Ok(None),
        (Work::Shipped(family), _) => (Pipeline::builder().model(ModelSource::Shipped(family)), true),
        (Work::Training, Some(path)) => (alone().model(ModelSource::File(path)), true),
        (Work::Training, None) => {
            let path = folder.join(format!("{}.toml", cell.arm));
            let text = toml::to_string(&plan.config(cell)).context("the config of an arm")?;
            fs::write(&path, text).with_context(|| format!("{}: cannot be written", path.display()))?;
            (alone().model(untrained::network(&path, options.kind.target())?), false)
        }
    };
    Ok(Some((builder.engine_options(options).images(1).open()?, trained)))
}

impl Candidate {
    fn time(&self) -> ArmTime {
        let rounded = |ms: f64| (ms * 100.0).round() / 100.0;
        let [least, most] = [f64::min, f64::max].map(|of| self.rounds_ms.iter().copied().fold(self.rounds_ms[0], of));
        ArmTime {
            arm: self.arm.clone(),
            engine: self.engine.clone(),
            ms: rounded(median(self.rounds_ms.iter().copied())),
            range_ms: [rounded(least), rounded(most)],
            objects: self.objects,
            trained: self.trained,
        }
    }
}
