//! `farsight eval --data --shard`: a model looks at some of the frames. They are judged when all parts are merged.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use farsight::json::ModelRecord;
use farsight_data::open_labelled;

use super::modelled::{looked_at_already, open, write_results_of};
use super::{EvalArgs, Outcome, judge};
use crate::outputs;
use crate::printer::{Printer, counted};
use crate::shard::manifest::{Join, Run};
use crate::shard::merged::Parts;
use crate::shard::{Part, check_relative};

impl EvalArgs {
    /// The data and the folder of results, which both must be named to divide the work.
    fn divided(&self) -> Result<(&Path, &Path)> {
        let Some(data) = &self.data else {
            bail!("--shard divides what a model looks at, and judging files takes seconds; expected --data DIR");
        };
        let Some(results) = &self.results else {
            bail!("--shard keeps the model's results in the parts; expected --results DIR");
        };
        let outputs =
            [("--results", self.results.as_ref()), ("--json", self.json.as_ref()), ("--report", self.report.as_ref())];
        outputs.iter().try_for_each(|(option, path)| path.map_or(Ok(()), |path| check_relative(option, path)))?;
        ensure!(self.explain.is_none(), "--explain is about one frame; expected no --shard");
        Ok((data, results))
    }
}

/// Looks at the frames of the part that is asked for.
pub(super) fn run(args: &EvalArgs, printer: &mut Printer) -> Result<Outcome> {
    let Some(asked @ (shard, _)) = args.shard.asked() else { return Ok(Outcome::Done) };
    let (data, results) = args.divided()?;
    let dataset = open_labelled(data, args.split.as_deref())?;
    let pipeline = open(args, dataset.len() / shard.count.max(1) + 1, printer)?;
    let ids = dataset.ids();
    let shared: Vec<PathBuf> = args.split.iter().filter(|split| split.is_file()).cloned().collect();
    let run = Run {
        interval_sigmas: Some(pipeline.interval_sigmas()),
        ..Run::new(&ids, &shared, Some(ModelRecord::from(pipeline.info())), shard.count)
    };
    let files = |item: usize| vec![PathBuf::from(dataset.origin(item))];
    let Some(part) = Part::begin(asked, run, &ids, files)? else {
        printer.note(&format!("part {shard} is there already"));
        return Ok(Outcome::Done);
    };
    let folder = part.output(results)?;
    outputs::make_folder(&folder)?;
    let done = write_results_of(&pipeline, &*dataset, part.block(), &folder, printer)?;
    let done: BTreeSet<&String> = done.iter().collect();
    let failed: Vec<String> = ids[part.block()].iter().filter(|id| !done.contains(id)).cloned().collect();
    let outcome = if failed.is_empty() { Outcome::Done } else { Outcome::Told };
    part.finish(failed, |_| Join::Own)?;
    let count = counted(done.len(), "frame");
    printer.status(&format!("part {shard}: {count} looked at by {}; `farsight merge` judges them", pipeline.engine()));
    Ok(outcome)
}

/// Judges the results of all `parts`, which lie below `folder`; other outputs go there, too.
pub(in crate::commands) fn merged(
    args: EvalArgs,
    folder: &Path,
    parts: &Parts,
    printer: &mut Printer,
) -> Result<Outcome> {
    let (data, results) = args.divided()?;
    let dataset = open_labelled(data, args.split.as_deref())
        .with_context(|| format!("{}: the labels are needed to judge what the parts found", data.display()))?;
    let ids = dataset.ids();
    ensure!(ids == parts.items(), "{}: not the frames that the parts have; expected the same data", data.display());
    let failed: BTreeSet<&str> = parts.failed().into_iter().collect();
    let done: Vec<String> = ids.into_iter().filter(|id| !failed.contains(id.as_str())).collect();
    ensure!(!done.is_empty(), "nothing was evaluated: {} failed", counted(failed.len(), "frame"));
    let source = looked_at_already(&args, dataset, folder.join(results), done, parts.interval_sigmas());
    let inside = |path: &Option<PathBuf>| path.as_ref().map(|path| folder.join(path));
    let args = EvalArgs { json: inside(&args.json), report: inside(&args.report), ..args };
    args.check_outputs()?;
    judge(&args, source, printer)
}
