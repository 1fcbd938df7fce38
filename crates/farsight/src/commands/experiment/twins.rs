//! The data of an experiment: a folder that is there, or twins of KITTI's frames that are rendered first.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use farsight_data::Frame;
use farsight_data::kitti::read_split;
use farsight_files::{Scratch, write_atomically};
use farsight_synth::{SceneConfig, SceneStream};

use crate::commands::synth;
use crate::experiment::plan::Data;
use crate::printer::Printer;

/// Names of the frames that arms learn from, and of those that they are judged on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Split {
    pub(super) train: Vec<String>,
    pub(super) evaluate: Vec<String>,
}

fn split_file(root: &Path, name: &str) -> PathBuf {
    root.join("ImageSets").join(format!("{name}.txt"))
}

/// Renders what is missing in the folder `root`, and says which frames are for what; those to judge on are of `judged`.
pub(super) fn prepare(
    data: &Data,
    [root, judged]: [&Path; 2],
    kitti: Option<&Path>,
    printer: &mut Printer,
) -> Result<Split> {
    ensure!(
        data.held_out == 0 || judged == root,
        "data.held_out is {}, of frames in {}; expected no other folder to judge on",
        data.held_out,
        root.display()
    );
    if !root.exists() {
        let kitti = kitti.with_context(|| {
            format!("{}: no such folder; --kitti names the labels to render its twins of", root.display())
        })?;
        render(data, root, kitti, printer)?;
    }
    let ids = |root: &Path, name: &str| Ok::<_, anyhow::Error>(read_split(&split_file(root, name))?);
    let mut split = Split { train: ids(root, &data.train)?, evaluate: ids(judged, &data.evaluate)? };
    if data.held_out > 0 {
        let frames = split.train.len();
        ensure!(data.held_out < frames, "data.held_out is {}; expected fewer than the {frames} frames", data.held_out);
        split.evaluate = split.train.split_off(frames - data.held_out);
    }
    if let Some(frames) = data.evaluate_frames {
        let all = split.evaluate.len();
        ensure!(frames <= all, "data.evaluate_frames is {frames}; expected at most the {all} of the split");
        // Evenly over the split, whose neighbours are often of one drive.
        split.evaluate = (0..frames).map(|at| split.evaluate[at * all / frames].clone()).collect();
    }
    ensure!(!split.train.is_empty() && !split.evaluate.is_empty(), "{}: a split has no frames", root.display());
    Ok(split)
}

/// Twins as they were rendered, frame by frame.
pub(super) struct Twins {
    stream: SceneStream,
    labels: PathBuf,
    calibrations: PathBuf,
}

impl Twins {
    /// Twins of the labels in the folder `kitti`, as [`prepare`] renders them.
    pub(super) fn new(kitti: &Path, seed: u64) -> Self {
        let training = kitti.join("training");
        let stream = SceneStream { config: SceneConfig::default(), seed };
        Self { stream, labels: training.join("label_2"), calibrations: training.join("calib") }
    }

    /// The twin of the frame `id`, with all that the renderer knows of it.
    pub(super) fn frame(&self, id: &str) -> Result<Frame> {
        synth::twin(&self.stream, [&self.labels, &self.calibrations], id)
    }
}

/// Renders to a folder beside `root` first, so that what was interrupted is not taken for the whole.
fn render(data: &Data, root: &Path, kitti: &Path, printer: &mut Printer) -> Result<()> {
    let name = root.file_name().with_context(|| format!("{}: expected a folder with a name", root.display()))?;
    let unfinished = root.with_file_name(format!("{}.unfinished", name.to_string_lossy()));
    if unfinished.exists() {
        fs::remove_dir_all(&unfinished).with_context(|| format!("{}: cannot be removed", unfinished.display()))?;
    }
    let names: BTreeSet<&str> = [data.train.as_str(), data.evaluate.as_str()].into();
    let ids = names.iter().map(|name| Ok(read_split(&split_file(kitti, name))?)).collect::<Result<Vec<_>>>()?;
    let all: BTreeSet<&String> = ids.iter().flatten().collect();
    printer.status(&format!("{}: rendering {} twins", root.display(), all.len()));
    let scratch = Scratch::temporary_folder().context("no place for a list of frames")?;
    let listed = scratch.path().join("frames.txt");
    let text = all.into_iter().fold(String::new(), |text, id| text + id + "\n");
    write_atomically(&listed, |file| file.write_all(text.as_bytes()))?;
    synth::run(&synth::SynthArgs::twins(&unfinished, kitti, &listed, data.twin_seed), printer)?;
    for (name, ids) in names.into_iter().zip(ids) {
        let text = ids.join("\n") + "\n";
        write_atomically(&split_file(&unfinished, name), |file| file.write_all(text.as_bytes()))?;
    }
    fs::rename(&unfinished, root).with_context(|| format!("{}: cannot be made", root.display()))
}
