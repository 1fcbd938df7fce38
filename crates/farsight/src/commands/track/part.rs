//! `farsight track --shard`: some of several videos, each followed by itself.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use farsight::json::ModelRecord;

use super::{Outcome, TrackArgs, follow, open};
use crate::names::output_names;
use crate::printer::{Printer, counted};
use crate::recording_file::RecordingArgs;
use crate::shard::manifest::{Join, Run};
use crate::shard::{Part, ShardArgs, check_relative};

/// Follows the videos of the part that is asked for. The outputs of each go to a folder of its name.
pub(super) fn run(args: &TrackArgs, printer: &mut Printer) -> Result<Outcome> {
    let Some(asked @ (shard, _)) = args.shard.asked() else { return Ok(Outcome::Done) };
    let TrackArgs { inputs, json, tracks, kitti_tracking, out, recordings, .. } = args;
    let RecordingArgs { mcap, rerun } = recordings;
    ensure!(
        inputs.len() > 1 || shard.count == 1,
        "{}: one video, and tracks go through all of it; with --shard expected several films or folders of images",
        inputs.first().map_or_else(String::new, |input| input.display().to_string())
    );
    let outputs = [
        ("--json", json),
        ("--tracks", tracks),
        ("--kitti-tracking", kitti_tracking),
        ("--mcap", mcap),
        ("--rerun", rerun),
        ("--out", out),
    ];
    let outputs: Vec<_> = outputs.into_iter().filter_map(|(option, path)| Some((option, path.as_ref()?))).collect();
    ensure!(!outputs.is_empty(), "--shard writes files; expected --json FILE, --tracks, --mcap or --out beside it");
    outputs.iter().try_for_each(|(option, path)| check_relative(option, path))?;
    let pipeline = open(args, printer)?;
    let items: Vec<String> = inputs.iter().map(|input| input.to_string_lossy().into_owned()).collect();
    let shared: Vec<PathBuf> =
        args.view.camera.calib.iter().cloned().chain(args.ego_file().map(Path::to_owned)).collect();
    let run = Run::new(&items, &shared, Some(ModelRecord::from(pipeline.info())), shard.count);
    let Some(part) = Part::begin(asked, run, &items, |item| vec![inputs[item].clone()])? else {
        printer.note(&format!("part {shard} is there already"));
        return Ok(Outcome::Done);
    };
    let names = output_names(inputs);
    let (mut failed, mut outcome) = (Vec::new(), Outcome::Done);
    for item in part.block() {
        let inside = |path: &Option<PathBuf>| {
            path.as_ref().map(|path| part.output(&PathBuf::from(&names[item]).join(path))).transpose()
        };
        let one = TrackArgs {
            inputs: vec![inputs[item].clone()],
            json: inside(json)?,
            tracks: inside(tracks)?,
            kitti_tracking: inside(kitti_tracking)?,
            recordings: RecordingArgs { mcap: inside(mcap)?, rerun: inside(rerun)? },
            out: inside(out)?,
            shard: ShardArgs::default(),
            ..args.clone()
        };
        match follow(&one, Some(&pipeline), printer) {
            Ok(Outcome::Done) => {}
            Ok(_) => outcome = Outcome::Told,
            Err(error) => {
                printer.failure(&error.context(items[item].clone()));
                let folder = part.folder().join(&names[item]);
                fs::remove_dir_all(&folder).with_context(|| format!("{}: cannot be removed", folder.display()))?;
                failed.push(items[item].clone());
                outcome = Outcome::Told;
            }
        }
    }
    part.finish(failed, |_| Join::Own)?;
    printer.note(&format!("part {shard} done, of {} in all", counted(items.len(), "video")));
    Ok(outcome)
}
