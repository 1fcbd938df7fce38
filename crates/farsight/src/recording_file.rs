//! The files of `--mcap` and `--rerun`, which appear when they are whole.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use farsight_files::Scratch;
use farsight_recordings::{McapRecording, RecordedFrame, RerunRecording};

use crate::inputs::identity;
use crate::outputs;

/// The options of recordings.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct RecordingArgs {
    /// Write a recording for Foxglove and ROS 2 to FILE (MCAP)
    #[arg(long, value_name = "FILE")]
    pub(crate) mcap: Option<PathBuf>,
    /// Write a recording for rerun to FILE (.rrd); needs a program that was built with the feature `rerun`
    #[arg(long, value_name = "FILE")]
    pub(crate) rerun: Option<PathBuf>,
}

/// The recordings of one call.
#[derive(Default)]
pub(crate) struct Recordings(Vec<RecordingFile>);

impl Recordings {
    /// Begins those that are asked for; they must be none of the `inputs`.
    pub(crate) fn begin(args: &RecordingArgs, inputs: impl IntoIterator<Item = PathBuf>) -> Result<Self> {
        let RecordingArgs { mcap, rerun } = args;
        let inputs: Vec<PathBuf> = inputs.into_iter().collect();
        for path in mcap.iter().chain(rerun) {
            outputs::check_file(path)?;
            let is_input = path.exists() && inputs.iter().any(|input| identity(input) == identity(path));
            ensure!(!is_input, "{}: an input; expected another file for the recording", path.display());
        }
        let mcap = mcap.iter().map(|path| RecordingFile::mcap(path));
        let rerun = rerun.iter().map(|path| RecordingFile::rerun(path));
        Ok(Self(mcap.chain(rerun).collect::<Result<_>>()?))
    }

    /// Whether none is asked for.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Adds an image and what was found in it to each.
    pub(crate) fn add(&mut self, frame: &RecordedFrame<'_>) -> Result<()> {
        self.0.iter_mut().try_for_each(|file| file.add(frame))
    }

    /// Makes the files appear.
    pub(crate) fn finish(self) -> Result<()> {
        self.0.into_iter().try_for_each(RecordingFile::finish)
    }
}

/// A recording being written.
struct RecordingFile {
    path: PathBuf,
    scratch: Scratch,
    recording: Recording,
}

enum Recording {
    Mcap(Box<McapRecording<BufWriter<File>>>),
    Rerun(RerunRecording),
}

impl RecordingFile {
    fn mcap(path: &Path) -> Result<Self> {
        let (scratch, file) = Scratch::file(path).with_context(|| unwritable(path))?;
        let recording = McapRecording::new(BufWriter::new(file)).with_context(|| unwritable(path))?;
        Ok(Self { path: path.to_owned(), scratch, recording: Recording::Mcap(Box::new(recording)) })
    }

    fn rerun(path: &Path) -> Result<Self> {
        // It opens the file by its name.
        let (scratch, _) = Scratch::file(path).with_context(|| unwritable(path))?;
        let recording = RerunRecording::create(scratch.path()).with_context(|| unwritable(path))?;
        Ok(Self { path: path.to_owned(), scratch, recording: Recording::Rerun(recording) })
    }

    fn add(&mut self, frame: &RecordedFrame<'_>) -> Result<()> {
        let added = match &mut self.recording {
            Recording::Mcap(recording) => recording.add(frame),
            Recording::Rerun(recording) => recording.add(frame),
        };
        added.with_context(|| unwritable(&self.path))
    }

    fn finish(self) -> Result<()> {
        let Self { path, scratch, recording } = self;
        let failed = || unwritable(&path);
        match recording {
            Recording::Mcap(recording) => recording.finish().with_context(failed)?.flush().with_context(failed)?,
            Recording::Rerun(recording) => recording.finish().with_context(failed)?,
        }
        scratch.persist().with_context(failed)
    }
}

fn unwritable(path: &Path) -> String {
    format!("{}: cannot be written", path.display())
}
