//! Export of a detector of another method than SMOKE: one network, or several with samplers between them.

use anyhow::{Result, ensure};
use farsight::model_file::with_own;
use farsight_graph::model::Model;
use farsight_methods::detectors::{DetectorNetwork, NetworkForm, Part, from_model, part_path};
use farsight_methods::method::{DetectorMethod, ModelTaker};
use farsight_onnx::Target;
use farsight_runtime::{Tensor, probe};

use super::{ExportArgs, answer, check, half, keep, reference_engine, told, write_file};
use crate::commands::Outcome;
use crate::printer::Printer;

/// Large enough for the last map of an SSD.
const PROBE_SIZE: [usize; 2] = [320, 320];

/// Columns and rows of the grid that later parts are tried on, whatever their own are.
const PROBE_GRID: [usize; 2] = [24, 20];

/// Writes the model in the form that is asked for.
pub(super) fn run(args: &ExportArgs, target: Target, printer: &mut Printer) -> Result<Outcome> {
    with_own(&args.model, Export { args, target, printer })?
}

struct Export<'a> {
    args: &'a ExportArgs,
    target: Target,
    printer: &'a mut Printer,
}

impl ModelTaker for Export<'_> {
    type Answer = Result<Outcome>;

    fn take<C: DetectorMethod>(self, mut model: Model<C>) -> Result<Outcome> {
        let Self { args, target, printer } = self;
        check_options(args, C::NAME)?;
        if args.half {
            return half(model, args, printer);
        }
        model.weights.metadata.extend(told(args)?.into_iter().map(|(key, fact)| (key.to_owned(), fact)));
        let network = from_model(&model, NetworkForm::Deployable, target, &args.model)?;
        let engine = reference_engine(&network.first.onnx);
        let trained = from_model(&model, NetworkForm::AsTrained, engine.target(), &args.model)?;
        export(args, &network, &trained, printer)
    }
}

/// What is asked for and is of SMOKE alone.
fn check_options(args: &ExportArgs, name: &str) -> Result<()> {
    let path = args.model.display();
    let of_smoke = "is of SMOKE, whose config says the depth and the scores that a fit moves";
    for (option, is_there) in [
        ("--fit-on", args.fit_on.is_some()),
        ("--input", args.input.is_some()),
        ("--focal-range", args.focal_range.is_some()),
    ] {
        ensure!(!is_there, "{path}: {name}; {option} {of_smoke}");
    }
    ensure!(args.average_with.is_none(), "{path}: {name}; --average-with is of refiners");
    ensure!(
        !args.int8.int8,
        "{path}: {name}; --int8 alone chooses layers by what SMOKE's answers bear; --half --int8 measures the ranges of one network whatever its method, for --precision int8"
    );
    Ok(())
}

/// Checks the network against itself as it was trained, and writes it; later parts go into files beside it
/// ([`part_path`]).
fn export(
    args: &ExportArgs,
    network: &DetectorNetwork,
    trained: &DetectorNetwork,
    printer: &mut Printer,
) -> Result<Outcome> {
    let engine = reference_engine(&network.first.onnx);
    let answered = |part: &Part, size: [usize; 2]| -> Result<(Tensor, Vec<Tensor>, String)> {
        let input = probe::tensor(part.onnx.input().channels.unwrap_or(3), size);
        let (expected, reference) = answer(engine, part.onnx.clone(), &args.model, &input)?;
        Ok((input, expected, reference))
    };
    let (input, expected, reference) = answered(&trained.first, PROBE_SIZE)?;
    if network.later.is_empty() {
        return keep(&network.first.onnx, &input, &expected, &reference, &args.out, printer);
    }
    check(&network.first.onnx, &input, &expected, &reference, &args.out, printer)?;
    for (place, (part, trained)) in network.later.iter().zip(&trained.later).enumerate() {
        let (input, expected, reference) = answered(trained, PROBE_GRID)?;
        check(&part.onnx, &input, &expected, &reference, &part_path(&args.out, place + 1), printer)?;
    }
    // Nobody finds a first part without the others.
    for (place, part) in network.later.iter().enumerate() {
        write_file(&part.onnx, &part_path(&args.out, place + 1), printer)?;
    }
    write_file(&network.first.onnx, &args.out, printer)?;
    Ok(Outcome::Done)
}
