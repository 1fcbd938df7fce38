//! `farsight eval --oracle`: what AP would be if some part of each matched detection were true.

use anyhow::{Context, Result};
use clap::ValueEnum;
use farsight_eval::oracle::{OraclePart, OracleRow, with_truth};
use farsight_eval::ranging::RangingOptions;
use farsight_eval::{Evaluation, FrameFiles, LabelSource};

use super::EvalArgs;

/// An [`OraclePart`] as it is written on the command line.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
pub(super) enum PartName {
    /// Its z, in the direction in which its centre is seen
    Depth,
    /// Where in the image its 3D centre is, at its own z
    #[value(alias = "center")]
    Centre,
    /// Height, width and length
    Size,
    /// Which way it faces
    Heading,
}

impl PartName {
    fn part(self) -> OraclePart {
        match self {
            Self::Depth => OraclePart::Depth,
            Self::Centre => OraclePart::Centre,
            Self::Size => OraclePart::Size,
            Self::Heading => OraclePart::Heading,
        }
    }
}

/// A row for each part that is asked for, and one for all of them together when there are several.
pub(super) fn rows(
    args: &EvalArgs,
    files: &FrameFiles,
    as_they_are: &Evaluation,
    labels: &LabelSource,
) -> Result<Vec<OracleRow>> {
    let mut parts: Vec<OraclePart> = Vec::new();
    for part in args.oracle.iter().map(|name| name.part()) {
        if !parts.contains(&part) {
            parts.push(part);
        }
    }
    let mut sets: Vec<Vec<OraclePart>> = parts.iter().map(|part| vec![*part]).collect();
    if parts.len() > 1 {
        sets.push(parts);
    }
    let options = RangingOptions { bootstrap: None, ..args.ranging_options(None) };
    let row = |parts: Vec<OraclePart>| {
        // What is odd about the files has been told.
        let (evaluation, _) = files.evaluate_changed(&options, |frame| with_truth(&frame, &parts, &options))?;
        let row = OracleRow::new(parts, &evaluation, as_they_are, &args.bootstrap());
        row.with_context(|| format!("{labels}: the labels changed while they were read"))
    };
    sets.into_iter().map(row).collect()
}
