//! The file of `--mcap`, which appears when it is whole.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};
use farsight_recordings::{McapRecording, Moment};
use tempfile::{NamedTempFile, TempPath};

use crate::inputs::identity;
use crate::outputs;

/// A recording being written.
pub(crate) struct RecordingFile {
    path: PathBuf,
    scratch: TempPath,
    recording: McapRecording<BufWriter<File>>,
}

impl RecordingFile {
    /// Begins a recording at `path`, which must be none of the `inputs`.
    pub(crate) fn begin(path: &Path, inputs: impl IntoIterator<Item = PathBuf>) -> Result<Self> {
        outputs::check_file(path)?;
        let is_input = path.exists() && inputs.into_iter().any(|input| identity(&input) == identity(path));
        ensure!(!is_input, "{}: an input; expected another file for the recording", path.display());
        let (file, scratch) = scratch_beside(path)?.into_parts();
        let recording = McapRecording::new(BufWriter::new(file)).with_context(|| unwritable(path))?;
        Ok(Self { path: path.to_owned(), scratch, recording })
    }

    /// Adds an image and what was found in it.
    pub(crate) fn add(&mut self, moment: &Moment<'_>) -> Result<()> {
        self.recording.add(moment).with_context(|| unwritable(&self.path))
    }

    /// Makes the file appear.
    pub(crate) fn finish(self) -> Result<()> {
        let Self { path, scratch, recording } = self;
        let mut out = recording.finish().with_context(|| unwritable(&path))?;
        out.flush().and_then(|()| out.get_ref().sync_all()).with_context(|| unwritable(&path))?;
        drop(out);
        scratch.persist(&path).map_err(|error| anyhow!(error.error)).with_context(|| unwritable(&path))
    }
}

fn unwritable(path: &Path) -> String {
    format!("{}: cannot be written", path.display())
}

/// A file beside its target, with the rights that new files have.
fn scratch_beside(target: &Path) -> Result<NamedTempFile> {
    let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.prefix(".recording").tempfile_in(folder).with_context(|| unwritable(target))
}
