//! A first training, from frames to pictures.

use std::fs;
use std::path::{Path, PathBuf};

use crate::libtorch::Libtorch;
use crate::{farsight, root};

/// Frames that the overfit run is fitted to, as `limit` in its config says.
const OVERFIT_FRAMES: usize = 8;

/// Trains the compact network on eight frames, ranges them and draws them.
pub(crate) fn quickstart(data: &Path) -> Result<(), String> {
    let libtorch = Libtorch::find_or_fetch()?;
    let out = root().join("runs/quickstart");
    let run = Run { libtorch: &libtorch, data, out: &out };
    let ids = first_ids(data, "train", OVERFIT_FRAMES)?;
    run.train("overfit8")?;
    run.range("overfit8", &ids, &["--out", &text(&out.join("pictures"))])?;
    eprintln!(
        "\nThe pictures are in {}. This network is overfitted to these {OVERFIT_FRAMES} frames: it shows that the line works, not how well it ranges.",
        out.join("pictures").display()
    );
    Ok(())
}

/// Where a run takes its frames from and leaves its results.
struct Run<'a> {
    libtorch: &'a Libtorch,
    data: &'a Path,
    out: &'a Path,
}

impl Run<'_> {
    /// Trains `configs/{config}.toml`, or goes on with a training that was interrupted.
    fn train(&self, config: &str) -> Result<(), String> {
        let (file, data, out) =
            (text(&root().join(format!("configs/{config}.toml"))), text(self.data), text(&self.out.join(config)));
        eprintln!("\n== train {config}");
        farsight(self.libtorch, &["train", "--config", &file, "--data", &data, "--out", &out, "--resume"])
    }

    /// Ranges the frames `ids`; KITTI rows go to `results/data` in the run's folder.
    fn range(&self, config: &str, ids: &[String], more: &[&str]) -> Result<(), String> {
        let (model, rows) = (text(&self.out.join(config).join("model.safetensors")), text(&self.results(config)));
        let images: Vec<String> =
            ids.iter().map(|id| text(&self.data.join(format!("training/image_2/{id}.png")))).collect();
        eprintln!("\n== range {config}");
        let images = images.iter().map(String::as_str);
        let arguments: Vec<&str> = ["range"]
            .into_iter()
            .chain(images)
            .chain(["--model", &model, "--kitti", &rows])
            .chain(more.iter().copied())
            .collect();
        farsight(self.libtorch, &arguments)
    }

    fn results(&self, config: &str) -> PathBuf {
        self.out.join(config).join("results")
    }
}

/// The first `count` frames of a split.
fn first_ids(data: &Path, split: &str, count: usize) -> Result<Vec<String>, String> {
    let path = data.join(format!("ImageSets/{split}.txt"));
    let text = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(text.split_whitespace().take(count).map(str::to_owned).collect())
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}
