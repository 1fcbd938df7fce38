//! `farsight doctor`: what this machine has, and what would help.

mod machine;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use farsight::Library;
use farsight::detector::has_libtorch;
use farsight::libraries::data_folder;
use farsight_graph::model::{METHOD_KEY, NetworkConfig};
use farsight_graph::weights::Weights;
use farsight_methods::camera_estimator::CameraEstimatorConfig;
use farsight_methods::description::Description;
use farsight_methods::plate_reader::PlateReaderConfig;
use farsight_methods::refiner::RefinerConfig;
use farsight_onnx::{OnnxModel, key};
use serde::Serialize;

use super::Outcome;
use crate::printer::Printer;
use machine::Machine;

/// Arguments of `farsight doctor`.
#[derive(Debug, Args)]
pub(crate) struct DoctorArgs {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The findings, as they are printed.
#[derive(Debug, Serialize)]
struct Diagnosis {
    version: &'static str,
    machine: Machine,
    engines: Vec<EngineState>,
    models: Vec<ModelState>,
    advice: Vec<String>,
}

#[derive(Debug, Serialize)]
struct EngineState {
    name: &'static str,
    ready: bool,
    /// Version of a library that was loaded.
    version: Option<String>,
    /// Where that library lies.
    path: Option<PathBuf>,
    /// How it was found, or why it is not ready.
    note: String,
}

#[derive(Debug, Serialize)]
struct ModelState {
    /// What of the path is no text is replaced, as JSON has no other way.
    path: String,
    kind: ModelKind,
    /// What is wrong with it; null for a good one.
    problem: Option<String>,
}

/// What a file in a folder of models is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum ModelKind {
    Detector,
    Refiner,
    PlateReader,
    CameraEstimator,
}

/// Runs the command.
pub(crate) fn run(args: &DoctorArgs, printer: &mut Printer) -> Result<Outcome> {
    let machine = Machine::here();
    let engines = engines();
    let diagnosis = Diagnosis {
        version: env!("CARGO_PKG_VERSION"),
        advice: advice(&engines, &machine),
        machine,
        engines,
        models: models(),
    };
    if args.json {
        printer.line(&serde_json::to_string_pretty(&diagnosis)?);
    } else {
        print(&diagnosis, printer);
    }
    Ok(Outcome::Done)
}

fn print(diagnosis: &Diagnosis, printer: &mut Printer) {
    let Diagnosis { machine, engines, models, advice, .. } = diagnosis;
    printer.heading("machine");
    printer.line(&format!("  {} {}, {} threads", machine.os, machine.architecture, machine.threads));
    printer.line(&format!("  instruction sets  {}", machine.instruction_sets.join(" ")));
    printer.heading("engines");
    for EngineState { name, ready, version, path, note } in engines {
        let state = if *ready { "ready" } else { "-" };
        let facts = version.iter().cloned().chain(path.iter().map(|path| path.display().to_string()));
        let facts: Vec<String> = facts.chain([note.clone()]).collect();
        printer.line(&format!("  {name:12} {state:6} {}", facts.join(", ")));
    }
    printer.heading("models");
    if models.is_empty() {
        printer.line("  none here, in ./models or in your data folder");
    }
    for ModelState { path, kind, problem } in models {
        let kind = match kind {
            ModelKind::Detector => "",
            ModelKind::Refiner => " (a refiner)",
            ModelKind::PlateReader => " (a plate reader)",
            ModelKind::CameraEstimator => " (a camera estimator)",
        };
        printer.line(&format!("  {path}{kind}{}", problem.as_ref().map_or_else(String::new, |p| format!(": {p}"))));
    }
    for line in advice {
        printer.note(line);
    }
}

fn engines() -> Vec<EngineState> {
    let built_in =
        |name, ready, note: &str| EngineState { name, ready, version: None, path: None, note: note.to_owned() };
    let mut engines = vec![built_in("rten", true, "built in")];
    engines.extend(Library::ALL.iter().map(|library| library_state(*library)));
    engines.push(if has_libtorch() {
        built_in("libtorch", true, "built in")
    } else {
        built_in("libtorch", false, "needs a build with `--features train` (`cargo xtask run ...`)")
    });
    engines
}

fn library_state(library: Library) -> EngineState {
    let missing =
        |path, error: String| EngineState { name: library.name(), ready: false, version: None, path, note: error };
    let found = match library.find(None) {
        Ok(found) => found,
        Err(error) => return missing(None, error.to_string()),
    };
    match library.version(&found.path) {
        Ok(version) => EngineState {
            name: library.name(),
            ready: true,
            version: Some(version),
            path: Some(found.path),
            note: format!("through {}", found.through),
        },
        Err(error) => missing(Some(found.path), error.to_string()),
    }
}

/// Models in the current folder, in `models` there, and in the user's data folder.
fn models() -> Vec<ModelState> {
    let own = data_folder().map(|folder| folder.join("models"));
    let folders = [PathBuf::from("."), PathBuf::from("models")].into_iter().chain(own);
    let mut paths: Vec<PathBuf> = folders
        .filter_map(|folder| fs::read_dir(folder).ok())
        .flatten()
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "onnx" || extension == "safetensors"));
    paths.sort();
    paths.iter().filter_map(|path| model_state(path)).collect()
}

/// Nothing of a checkpoint, which goes on with a training and is no model.
fn model_state(path: &Path) -> Option<ModelState> {
    // What is no safetensors file has no such facts, and its reader says what is wrong with it.
    let facts = Weights::read_metadata(path).unwrap_or_default();
    if facts.contains_key(key::PROGRESS) {
        return None;
    }
    // What says no method of ours is a detector that is broken.
    let method = facts.get(METHOD_KEY).map(String::as_str);
    let kind = match method {
        Some(RefinerConfig::METHOD) => ModelKind::Refiner,
        Some(PlateReaderConfig::METHOD) => ModelKind::PlateReader,
        Some(CameraEstimatorConfig::METHOD) => ModelKind::CameraEstimator,
        _ => ModelKind::Detector,
    };
    let read = if path.extension().is_some_and(|extension| extension == "onnx") {
        OnnxModel::read(path).map(drop).map_err(anyhow::Error::from)
    } else {
        Description::of_model_file(path).map(drop).map_err(anyhow::Error::from)
    };
    Some(ModelState { path: path.display().to_string(), kind, problem: read.err().map(|error| error.to_string()) })
}

fn advice(engines: &[EngineState], machine: &Machine) -> Vec<String> {
    let ready = |name: &str| engines.iter().any(|engine| engine.name == name && engine.ready);
    let mut advice = Vec::new();
    if !ready("onnxruntime") && !ready("openvino") {
        advice.push(
            "rten needs nothing and is slower than ONNX Runtime; `farsight engine install onnxruntime` fetches that with pip"
                .to_owned(),
        );
    }
    if cfg!(target_arch = "x86_64") && !machine.has("avx2") {
        advice.push("without AVX2 every engine is slow on this CPU".to_owned());
    }
    if machine.has("avx512bf16") && !ready("openvino") {
        advice.push(
            "this CPU computes in bfloat16; OpenVINO makes use of it (`farsight engine install openvino`)".to_owned(),
        );
    }
    advice
}
