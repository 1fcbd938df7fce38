//! `farsight range --shard`: some of the images, into the folder of their part.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use farsight::json::ModelRecord;

use super::answers::{is_lines, shown};
use super::job::Job;
use super::{Outcome, RangeArgs, outcome};
use crate::inputs::Inputs;
use crate::pipeline_args;
use crate::printer::{Printer, counted};
use crate::recording_file::RecordingArgs;
use crate::shard::manifest::{Join, Run};
use crate::shard::{Part, check_relative};

/// Runs the command for the part that is asked for.
pub(super) fn run(args: &RangeArgs, found: Inputs, printer: &mut Printer) -> Result<Outcome> {
    let Some(asked @ (shard, _)) = args.shard.asked() else { return Ok(Outcome::Done) };
    let outputs = [("--json", &args.json), ("--out", &args.out), ("--kitti", &args.kitti)];
    let outputs: Vec<_> = outputs.iter().filter_map(|(option, path)| Some((*option, path.as_deref()?))).collect();
    let RecordingArgs { mcap, rerun } = &args.recordings;
    ensure!(mcap.is_none() && rerun.is_none(), "a recording is one piece; expected --mcap and --rerun without --shard");
    ensure!(!outputs.is_empty(), "--shard writes files; expected --json FILE, --out or --kitti beside it");
    outputs.iter().try_for_each(|(option, path)| check_relative(option, path))?;
    let pipeline = args.open(found.images.len() / shard.count.max(1) + 1, printer)?;
    let items: Vec<String> = found.images.iter().map(|image| shown(image)).collect();
    let shared: Vec<PathBuf> = args.view.camera.calib.iter().cloned().collect();
    let run = Run::new(&items, &shared, Some(ModelRecord::from(pipeline.info())), shard.count);
    let Some(part) = Part::begin(asked, run, &items, |item| vec![found.images[item].clone()])? else {
        printer.note(&format!("part {shard} is there already"));
        return Ok(outcome(found.problems.len()));
    };
    let inside = |path: &Option<PathBuf>| path.as_deref().map(|path| part.output(path)).transpose();
    let args_inside =
        RangeArgs { json: inside(&args.json)?, out: inside(&args.out)?, kitti: inside(&args.kitti)?, ..args.clone() };
    let job = Job::new(&args_inside, found.images, printer)?.only(part.block());
    let failed = job.run(&pipeline, printer)?;
    pipeline_args::tell_of_camera(&pipeline, printer);
    let count = found.problems.len() + failed.len();
    let json = args.json.as_deref();
    part.finish(failed, |path| match json {
        Some(json) if same(path, json) => {
            if is_lines(json) {
                Join::Lines
            } else {
                Join::Array
            }
        }
        _ => Join::Own,
    })?;
    printer.note(&format!("part {shard} done, of {} in all", counted(items.len(), "image")));
    Ok(outcome(count))
}

/// Whether two relative paths have the same names.
fn same(a: &Path, b: &Path) -> bool {
    a.components().eq(b.components())
}
