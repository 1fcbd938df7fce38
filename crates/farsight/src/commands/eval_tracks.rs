//! `farsight eval-tracks`: how good tracks are.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use farsight::json::{FrameRecord, TrackRecord};
use farsight_core::{Box2d, Box3d, Dimensions, ObjectClass};
use farsight_eval::tracks::{
    GroundTruthFrame, JudgedSequence, MAX_FRAMES, PredictedFrame, PredictedTrack, TracksReport, differences, differences_text,
    judge, page, read_sequence, text,
};
use farsight_files::{read_text, write_atomically};

use super::Outcome;
use crate::outputs;
use crate::printer::Printer;

/// Arguments of `farsight eval-tracks`.
#[derive(Debug, Args)]
pub(crate) struct EvalTracksArgs {
    /// Labels in the format of KITTI's tracking benchmark: a file, or a folder with one file a sequence (`label_02`);
    /// velocities are taken from the folder `velocity_02` beside it, as `farsight synth --sequence` writes it
    #[arg(long, value_name = "DIR|FILE")]
    labels: PathBuf,
    /// What `farsight track --json` wrote: a file, or a folder with one file a sequence (0000.jsonl for 0000.txt)
    #[arg(long, value_name = "DIR|FILE")]
    tracks: PathBuf,
    /// Other tracks of the same sequences to compare with
    #[arg(long, value_name = "DIR|FILE")]
    against: Option<PathBuf>,
    /// The class that is judged
    #[arg(long, value_name = "CLASS", default_value = "Car")]
    class: String,
    /// Write all figures to FILE as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a page to FILE (HTML) with the course of each track beside the truth, the worst first
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &EvalTracksArgs, printer: &mut Printer) -> Result<Outcome> {
    if let Some(json) = &args.json {
        outputs::check_json(json, [&args.labels, &args.tracks].into_iter().chain(&args.against))?;
    }
    if let Some(page) = &args.report {
        outputs::check_kind(page, "json", "a name in .html")?;
    }
    let truth = truth(&args.labels)?;
    let class = ObjectClass::from_name(&args.class);
    let sequences = judged(&truth, &class, &args.tracks)?;
    let report = TracksReport::new(&sequences);
    printer.line(text(&report).trim_end());
    let compared = match &args.against {
        None => None,
        Some(against) => {
            let other = TracksReport::new(&judged(&truth, &class, against)?);
            let found = differences(&report, &other);
            printer.line(&format!("\nagainst {}, means over the sequences:", against.display()));
            printer.line(differences_text(&found).trim_end());
            Some(found)
        }
    };
    if let Some(path) = &args.report {
        write_atomically(path, |file| file.write_all(page(&report, &sequences).as_bytes()))?;
    }
    if let Some(path) = &args.json {
        let value = serde_json::json!({"all": report.figures(), "against": compared});
        let text = serde_json::to_string_pretty(&value)? + "\n";
        write_atomically(path, |file| file.write_all(text.as_bytes()))?;
    }
    Ok(Outcome::Done)
}

/// Sequences by their names.
fn truth(labels: &Path) -> Result<Vec<(String, Vec<GroundTruthFrame>)>> {
    let files = if labels.is_dir() {
        let entries = fs::read_dir(labels).with_context(|| format!("{}: cannot be listed", labels.display()))?;
        let mut files: Vec<PathBuf> = entries.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
        files.retain(|file| file.extension().is_some_and(|extension| extension == "txt"));
        files.sort();
        files
    } else {
        vec![labels.to_owned()]
    };
    ensure!(!files.is_empty(), "{}: no .txt in this folder; expected labels of sequences", labels.display());
    let sequence = |file: &PathBuf| {
        let name = name(file);
        let beside = file.parent().and_then(Path::parent).unwrap_or(Path::new(".")).join("velocity_02");
        let velocities = beside.join(format!("{name}.csv"));
        let velocities = velocities.is_file().then_some(velocities);
        Ok((name, read_sequence(file, velocities.as_deref())?))
    };
    files.iter().map(sequence).collect()
}

fn name(file: &Path) -> String {
    file.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Each sequence with its tracks.
fn judged(
    truth: &[(String, Vec<GroundTruthFrame>)],
    class: &ObjectClass,
    tracks: &Path,
) -> Result<Vec<JudgedSequence>> {
    let of_sequence = |(name, frames): &(String, Vec<GroundTruthFrame>)| {
        let file = if tracks.is_dir() { tracks.join(format!("{name}.jsonl")) } else { tracks.to_owned() };
        Ok(judge(name, class, frames, &told(&file)?))
    };
    ensure!(
        tracks.is_dir() || truth.len() == 1,
        "{}: a file for {} sequences; expected a folder with one file a sequence",
        tracks.display(),
        truth.len()
    );
    truth.iter().map(of_sequence).collect()
}

/// The lines of a file by the numbers of their frames.
fn told(path: &Path) -> Result<Vec<Option<PredictedFrame>>> {
    let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let mut frames = Vec::new();
    for (line, number) in text.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty()) {
        let record: FrameRecord =
            serde_json::from_str(line).with_context(|| format!("{}:{number}: no frame of tracks", path.display()))?;
        let place = usize::try_from(record.frame).ok().filter(|place| *place < MAX_FRAMES);
        let place = place.with_context(|| {
            format!("{}:{number}: frame {}; expected one below {MAX_FRAMES}", path.display(), record.frame)
        })?;
        if frames.len() <= place {
            frames.resize(place + 1, None);
        }
        let tracks = record.tracks.iter().map(told_track).collect();
        frames[place] = Some(PredictedFrame { time_s: record.time_s, tracks });
    }
    Ok(frames)
}

fn told_track(track: &TrackRecord) -> PredictedTrack {
    let [x1, y1, x2, y2] = track.box2d;
    let [height, width, length] = track.dimensions_hwl;
    let dimensions = Dimensions { height, width, length };
    let speed = track.speed_mps.flatten().zip(track.speed_sigma_mps.flatten());
    PredictedTrack {
        id: track.id,
        class: ObjectClass::from_name(&track.class),
        box2d: Box2d::new(x1, y1, x2, y2),
        box3d: Box3d { dimensions, location: track.location, yaw: track.rotation_y },
        range_sigma_m: Some(track.range_sigma_m),
        closing_mps: track.closing_mps.zip(track.closing_sigma_mps).map(|(mps, sigma)| [mps, sigma]),
        ttc_s: track.ttc_s,
        ttc_interval_s: track.ttc_interval_s,
        speed_mps: speed.map(|(mps, sigma)| [mps, sigma]),
    }
}
