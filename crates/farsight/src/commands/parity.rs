//! `farsight parity`: an engine's answers against stored reference tensors.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use farsight::detector::open_network;
use farsight_files::write_atomically;
use farsight_graph::weights::{WeightTensor, Weights};
use farsight_runtime::probe::largest_difference;
use farsight_runtime::{Runner, Tensor, TensorView};
use serde::Serialize;

use super::Outcome;
use super::export::TOLERANCE;
use crate::outputs;
use crate::pipeline_args::{EngineArgs, tell_unhashed};
use crate::printer::Printer;

/// Name of the input among the reference tensors.
const INPUT: &str = "input";

/// Arguments of `farsight parity`.
#[derive(Debug, Args)]
pub(crate) struct ParityArgs {
    /// An ONNX file of `farsight export`, or a model that `farsight train` or `farsight import` wrote
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Reference tensors: `input` `[batch, 3, height, width]`, `cls_logits` and `reg_raw`
    #[arg(long, value_name = "FILE.safetensors")]
    golden: PathBuf,
    /// The largest difference that counts as the same
    #[arg(long, value_name = "X", default_value_t = TOLERANCE, value_parser = tolerance, allow_negative_numbers = true)]
    tolerance: f32,
    /// Write the differences to FILE
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    engine: EngineArgs,
}

/// What is written to the JSON file.
#[derive(Debug, Serialize)]
struct Parity {
    model: String,
    golden: String,
    engine: String,
    tolerance: f32,
    within: bool,
    outputs: Vec<Output>,
    /// Reference tensors that are no outputs of the model.
    not_compared: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Output {
    name: String,
    /// Null where the maps cannot be compared: sizes differ, or a value is not a number.
    largest_difference: Option<f32>,
    within: bool,
}

fn tolerance(text: &str) -> Result<f32, String> {
    let tolerance = text.parse().ok().filter(|tolerance: &f32| tolerance.is_finite() && *tolerance >= 0.0);
    tolerance.ok_or_else(|| "expected 0 or a positive number".to_owned())
}

/// Runs the command.
pub(crate) fn run(args: &ParityArgs, printer: &mut Printer) -> Result<Outcome> {
    if let Some(json) = &args.json {
        outputs::check_json(json, [args.model.as_path(), &args.golden])?;
    }
    tell_unhashed([args.model.clone()], printer);
    let golden = Weights::read(&args.golden)?;
    args.engine.tell_threads(printer);
    let mut runner = open_network(&args.engine.options()?, &args.model)?;
    let parity = compare(args, &golden, &mut *runner).with_context(|| args.golden.display().to_string())?;
    for Output { name, largest_difference, within } in &parity.outputs {
        let difference = largest_difference.map_or_else(|| "cannot be compared".to_owned(), |d| format!("{d:.1e}"));
        printer.line(&format!("{name:10} {difference:>8}  {}", if *within { "same" } else { "DIFFERENT" }));
    }
    if let Some(path) = &args.json {
        write_atomically(path, |out| {
            serde_json::to_writer_pretty(&mut *out, &parity)?;
            writeln!(out)
        })?;
    }
    Ok(if parity.within { Outcome::Done } else { Outcome::Told })
}

fn compare(args: &ParityArgs, golden: &Weights, runner: &mut dyn Runner) -> Result<Parity> {
    let input = golden.tensors.get(INPUT).with_context(|| format!("no tensor \"{INPUT}\""))?;
    let &[batch @ 1..=usize::MAX, 3, height, width] = &input.shape[..] else {
        bail!(
            "tensor \"{INPUT}\" has the shape {:?}; expected [batch, 3, height, width], at least one image",
            input.shape
        )
    };
    let answer = |runner: &mut dyn Runner, item| {
        let view = TensorView { shape: &[1, 3, height, width], values: part(input, item, batch) };
        runner.run(&[(farsight_onnx::INPUT, view)])
    };
    let answers = (0..batch).map(|item| answer(runner, item)).collect::<Result<Vec<Vec<Tensor>>, _>>()?;
    let mut outputs = Vec::new();
    for (place, info) in runner.outputs().iter().enumerate() {
        if let Some(expected) = golden.tensors.get(&info.name) {
            let apart = |(item, answer): (usize, &Vec<Tensor>)| {
                largest_difference(&answer[place].values, part(expected, item, batch))
            };
            let largest = answers.iter().enumerate().map(apart).fold(0.0, f32::max);
            let largest_difference = largest.is_finite().then_some(largest);
            let name = info.name.clone();
            outputs.push(Output { name, largest_difference, within: largest <= args.tolerance });
        }
    }
    let names: Vec<&str> = runner.outputs().iter().map(|output| output.name.as_str()).collect();
    ensure!(!outputs.is_empty(), "none of the network's outputs {names:?} among its tensors");
    let known = |name: &str| name == INPUT || outputs.iter().any(|output| output.name == name);
    Ok(Parity {
        model: args.model.display().to_string(),
        golden: args.golden.display().to_string(),
        engine: runner.engine().to_owned(),
        tolerance: args.tolerance,
        within: outputs.iter().all(|output| output.within),
        not_compared: golden.tensors.keys().filter(|name| !known(name)).cloned().collect(),
        outputs,
    })
}

/// One image's share of a tensor whose first axis is the batch.
fn part(tensor: &WeightTensor, item: usize, batch: usize) -> &[f32] {
    let share = tensor.values.len() / batch;
    &tensor.values[item * share..][..share]
}
