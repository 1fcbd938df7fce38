//! `farsight eval-tracks`: how good tracks are.

mod told;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use farsight_core::ObjectClass;
use farsight_eval::tracks::{
    GroundTruthFrame, JudgedSequence, TracksReport, differences, differences_text, judge, page, read_sequence, rows,
    text,
};
use farsight_files::{MeasuredTable, write_atomically};

use super::Outcome;
use crate::outputs;
use crate::printer::Printer;
use told::told;

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
    /// Write the figures as a table to FILE (JSON), for documents to quote (`farsight measure --docs`)
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
    /// Write a page to FILE (HTML) with the course of each track beside the truth, the worst first
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &EvalTracksArgs, printer: &mut Printer) -> Result<Outcome> {
    for json in args.json.iter().chain(&args.table) {
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
    if let Some(path) = &args.table {
        let command = "farsight eval-tracks --labels LABELS --tracks TRACKS";
        let mut table = MeasuredTable::new(command, ["what", "figure"]);
        table.rows = rows(&report).into_iter().map(Vec::from).collect();
        table.write(path)?;
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
