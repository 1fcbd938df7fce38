//! The proof on real frames (docs/proof.md): the commands that its figures come from, in order.

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

/// Overfits eight frames; trains SMOKE and the improved SMOKE on the training frames; evaluates both on the validation frames.
pub(crate) fn proof(data: &Path) -> Result<(), String> {
    let libtorch = Libtorch::find_or_fetch()?;
    let out = root().join("runs/proof");
    let run = Run { libtorch: &libtorch, data, out: &out };
    run.train("overfit8")?;
    let seen = first_ids(data, "train", OVERFIT_FRAMES)?;
    run.range("overfit8", &seen, &["--out", &text(&out.join("pictures"))])?;
    // Found means a 2D overlap of 0.7 here.
    run.evaluate("overfit8", &seen, &["--ranging-overlap", "0.7"])?;

    let unseen = first_ids(data, "val", usize::MAX)?;
    for config in ["proof_smoke", "proof_smoke_imp"] {
        run.train(config)?;
        // Sixty-four frames make no confident network: at the usual limit of 0.25 it says nothing.
        let pictures = text(&out.join(config).join("pictures"));
        run.range(config, &unseen, &["--min-score", "0.1", "--out", &pictures])?;
        run.evaluate(config, &unseen, &[])?;
    }
    Ok(())
}

/// Where a proof takes its frames from and leaves its results.
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

    /// Evaluates the rows that [`Run::range`] wrote.
    fn evaluate(&self, config: &str, ids: &[String], more: &[&str]) -> Result<(), String> {
        let (labels, rows) = (text(&self.data.join("training/label_2")), text(&self.results(config)));
        let split = self.out.join(config).join("frames.txt");
        fs::write(&split, ids.join("\n") + "\n").map_err(|e| format!("{}: {e}", split.display()))?;
        let (split, json) = (text(&split), text(&self.out.join(config).join("eval.json")));
        eprintln!("\n== evaluate {config}");
        let arguments = ["eval", "--labels", &labels, "--results", &rows, "--split", &split, "--json", &json];
        farsight(self.libtorch, &[&arguments, more].concat())
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
