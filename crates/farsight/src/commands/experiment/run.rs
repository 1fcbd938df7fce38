//! Runs the cells of a plan that are not done yet, and writes what they say after each.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use farsight::shipped::{self, Family};
use farsight::{EngineOptions, ModelSource, Pipeline};
use farsight_core::Detection;
use farsight_data::annotations::DepthMap;
use farsight_data::{Dataset, DatasetError, open_labelled};
use farsight_eval::{Evaluation, FrameFiles, LabelSource};
use farsight_files::{read_text, write_atomically};
use farsight_graph::weights::Weights;
use farsight_methods::training::check;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use toml::{Table, Value};

use super::cell::{CellFolder, MIN_SCORE, Step, is_over};
use super::record::{self, Record};
use super::twins::{Split, Twins, prepare};
use crate::commands::Outcome;
use crate::experiment::plan::{Work, set, start_of};
use crate::experiment::results::CellResult;
use crate::experiment::statistics::{self, Judge};
use crate::experiment::{Cell, Experiment, Results, tables};
use crate::printer::{Printer, counted};
use crate::rangers::{CAMERA_HEIGHT_M, Ranger, RangerName, ranged_by_median};

/// What is to be run.
pub(crate) struct Job {
    pub(crate) plan: Experiment,
    pub(crate) data: PathBuf,
    /// Data that arms are judged on, where these are others.
    pub(crate) judge: Option<PathBuf>,
    /// Labels to render the data of, when they are missing.
    pub(crate) kitti: Option<PathBuf>,
    /// Folder of the cells.
    pub(crate) out: PathBuf,
    /// File of the results.
    pub(crate) results: PathBuf,
    /// Folder of the records of cells that are done.
    pub(crate) records: PathBuf,
    pub(crate) deadline: Option<Instant>,
    /// How the names of the cells start; empty for all.
    pub(crate) only: Vec<String>,
    /// What answers; its threads are training's, too, instead of the plan's.
    pub(crate) engine: EngineOptions,
}

impl Job {
    /// The data that arms are judged on.
    fn judged(&self) -> &Path {
        self.judge.as_deref().unwrap_or(&self.data)
    }
}

/// A job whose data are open.
struct Open<'a> {
    job: &'a Job,
    dataset: Arc<dyn Dataset>,
    split: Split,
    /// SHA-256 of the weights by the files that they are in; of those that are there.
    starts: BTreeMap<String, String>,
    judge: Judge,
}

/// Runs the cells; those of other processes are left out.
pub(crate) fn run(job: &Job, printer: &mut Printer) -> Result<Outcome> {
    let cells = job.plan.cells();
    let is_asked = |cell: &Cell| job.only.is_empty() || job.only.iter().any(|start| cell.name().starts_with(start));
    let asked: Vec<&Cell> = cells.iter().filter(|cell| is_asked(cell)).collect();
    ensure!(!asked.is_empty(), "no cell's name starts with {}", job.only.join(" or "));
    let parent = job.results.parent().filter(|parent| !parent.as_os_str().is_empty());
    fs::create_dir_all(parent.unwrap_or(Path::new("."))).with_context(|| format!("{}", job.results.display()))?;
    let mut open = open(job, printer)?;
    for cell in &cells {
        open.restore(cell)?;
    }
    let (mut elsewhere, mut worked) = (0, false);
    for cell in asked {
        // However little time there is, something comes forward.
        if worked && is_over(job.deadline) {
            return Ok(Outcome::Unfinished);
        }
        match open.run_cell(cell, printer)? {
            Ran::Whole => worked = true,
            Ran::Before => continue,
            Ran::Stopped => return Ok(Outcome::Unfinished),
            Ran::Elsewhere => {
                elsewhere += 1;
                continue;
            }
        }
        let results = open.results()?;
        results.write(&job.results)?;
        printer.line(&format!("{}: {}", cell.name(), tables::progress(&job.plan, &results)));
    }
    if !worked {
        // Cells may have come from elsewhere.
        open.results()?.write(&job.results)?;
    }
    if elsewhere > 0 {
        printer.status(&format!("{} in the hands of other processes", counted(elsewhere, "cell")));
    }
    Ok(Outcome::Done)
}

/// How a cell ended.
enum Ran {
    Whole,
    /// It was done already.
    Before,
    /// The time was over first.
    Stopped,
    /// Another process works on it.
    Elsewhere,
}

fn open<'a>(job: &'a Job, printer: &mut Printer) -> Result<Open<'a>> {
    // Before anything is rendered or trained.
    for cell in job.plan.cells().iter().filter(|cell| job.plan.work(cell) == Work::Training) {
        check(&job.plan.config(cell), Path::new(&format!("arms.{}", cell.arm)))?;
    }
    let split = prepare(&job.plan.data, [&job.data, job.judged()], job.kitti.as_deref(), printer)?;
    fs::create_dir_all(&job.out).with_context(|| format!("{}: cannot be made", job.out.display()))?;
    let dataset = frames(job.judged(), &job.out.join("evaluate.txt"), &split.evaluate)?;
    let start = |path: PathBuf| -> Result<(String, String)> {
        Ok((path.display().to_string(), Weights::read(&path)?.sha256()))
    };
    // Without a start no cell is trained from it; those that were are compared by their records all the same.
    let there = job.plan.start_files().into_iter().filter(|path| path.exists());
    let starts = there.map(start).collect::<Result<_>>()?;
    Ok(Open { job, dataset, split, starts, judge: Judge::default() })
}

/// SHA-256 of the weights of a shipped detector and of its refiner.
fn hashes(family: Family) -> Result<[String; 2]> {
    Ok([family.weights_sha256().to_owned(), shipped::refiner(family)?.weights.sha256()])
}

/// These frames of the data in `root`. They are kept as a `list` of their own, as frames that are held out are no
/// split.
fn frames(root: &Path, list: &Path, ids: &[String]) -> Result<Arc<dyn Dataset>> {
    let text = ids.join("\n") + "\n";
    write_atomically(list, |file| file.write_all(text.as_bytes()))?;
    Ok(open_labelled(root, Some(list))?)
}

/// What was found in the frame `id`.
fn found(files: &FrameFiles, id: &str) -> Result<Vec<Detection>> {
    let (frame, _) = files.read(id)?;
    Ok(frame.predictions.into_iter().map(|prediction| prediction.detection).collect())
}

impl Open<'_> {
    /// The training config of a cell with its data.
    fn config(&self, cell: &Cell) -> Table {
        let mut config = self.job.plan.config(cell);
        set(&mut config, "data", "root", Value::String(self.job.data.display().to_string()));
        set(&mut config, "data", "split", Value::String(self.job.plan.data.train.clone()));
        // Those that are held out are the last ones.
        set(&mut config, "data", "limit", Value::Integer(self.split.train.len() as i64));
        if let Some(before) = self.job.plan.before(cell) {
            let model = CellFolder::model_in(&self.folder(&before));
            set(&mut config, "train", "start_from", Value::String(model.display().to_string()));
        }
        if let Some(threads) = self.job.engine.threads {
            set(&mut config, "train", "threads", Value::Integer(threads as i64));
        }
        config
    }

    /// What must be the same for a cell to go on: where its answers come from, frames and program. The start is null
    /// where its file is not there.
    fn identity(&self, cell: &Cell) -> Result<String> {
        let identity = match self.job.plan.work(cell) {
            Work::Training => self.identity_of_training(cell),
            Work::Ranging { of, by } => serde_json::json!({
                "of": self.identity_of_training(&of),
                "ranger": by.word(),
                "camera_height_m": CAMERA_HEIGHT_M,
            }),
            Work::Shipped(family) => serde_json::json!({
                "shipped": family.name(),
                "weights": hashes(family)?,
                "twin_seed": self.job.plan.data.twin_seed,
                "evaluate": self.split.evaluate.join(" "),
                "program": env!("CARGO_PKG_VERSION"),
            }),
        };
        Ok(serde_json::to_string(&identity)? + "\n")
    }

    fn identity_of_training(&self, cell: &Cell) -> serde_json::Value {
        let mut config = self.job.plan.config(cell);
        let start = match (self.job.plan.before(cell), start_of(&config)) {
            (Some(before), _) => self.identity_of_training(&before),
            (None, Some(file)) => self.starts.get(file).map(String::as_str).into(),
            (None, None) => "nothing".into(),
        };
        for (table, field) in [("train", "threads"), ("train", "checkpoint_steps"), ("train", "log_steps")] {
            if let Some(Value::Table(table)) = config.get_mut(table) {
                table.remove(field);
            }
        }
        config.remove("validate");
        let Split { train, evaluate } = &self.split;
        let mut identity = serde_json::json!({
            "config": config,
            "twin_seed": self.job.plan.data.twin_seed,
            "train": train.join(" "),
            "evaluate": evaluate.join(" "),
            "start": start,
            "program": env!("CARGO_PKG_VERSION"),
        });
        if let Some(score) = self.job.plan.min_score(cell) {
            identity["min_score"] = score.into();
        }
        identity
    }

    fn folder(&self, cell: &Cell) -> PathBuf {
        self.job.out.join(cell.name())
    }

    fn run_cell(&mut self, cell: &Cell, printer: &mut Printer) -> Result<Ran> {
        if !self.measured(cell).exists()
            && self.job.plan.work(cell) == Work::Training
            && let Some(start) = start_of(&self.config(cell))
        {
            let is_there = match self.job.plan.before(cell) {
                Some(_) => Path::new(start).exists(),
                None => self.starts.contains_key(start),
            };
            let expected = "no such file; expected the weights that it starts from";
            ensure!(is_there, "{}: {start}: {expected}", cell.name());
        }
        let identity = self.identity(cell)?;
        let Some(folder) = CellFolder::take(&self.folder(cell), &identity)? else {
            return Ok(Ran::Elsewhere);
        };
        if self.measured(cell).exists() {
            return Ok(Ran::Before);
        }
        printer.status(&format!("{}: {}", cell.name(), self.job.plan.title(&cell.arm)));
        let Some(steps) = self.answer(cell, &folder, printer).with_context(|| cell.name())? else {
            return Ok(Ran::Stopped);
        };
        let metrics = statistics::metrics(&self.evaluation(&folder.results())?)?;
        let result = CellResult { arm: cell.arm.clone(), seed: cell.seed, steps, metrics };
        self.keep(cell, &result)?;
        let record = Record::of(&folder, &identity, result, &self.split.evaluate)?;
        record.write(&record::path(&self.job.records, cell))?;
        Ok(Ran::Whole)
    }

    /// Makes the answers of a cell. How many steps were trained for them; none when the time was over first.
    fn answer(&self, cell: &Cell, folder: &CellFolder, printer: &mut Printer) -> Result<Option<u64>> {
        let Job { deadline, ref engine, .. } = *self.job;
        let min_score = self.job.plan.min_score(cell).unwrap_or(MIN_SCORE);
        let looked = match self.job.plan.work(cell) {
            Work::Training => {
                if folder.train(&self.config(cell), deadline, printer)? == Step::Stopped {
                    return Ok(None);
                }
                let looked = folder.look_trained(&*self.dataset, engine, min_score, deadline, printer)?;
                return Ok((looked == Step::Done).then_some(folder.steps()?));
            }
            Work::Ranging { of, by: RangerName::MedianDepth } => self.range_by_depth(folder, &of).map(|()| Step::Done),
            Work::Ranging { of, by } => self.range(folder, &of, by).map(|()| Step::Done),
            Work::Shipped(family) => {
                let builder = Pipeline::builder().model(ModelSource::Shipped(family)).engine_options(engine.clone());
                folder.look(&*self.dataset, builder.min_score(min_score), deadline, printer)
            }
        };
        Ok((looked? == Step::Done).then_some(0))
    }

    /// The answers of another cell, to be given other distances.
    fn to_range(&self, of: &Cell) -> Result<FrameFiles> {
        ensure!(self.measured(of).exists(), "ranges the answers of {}; expected that cell to be done", of.name());
        self.answers(&self.folder(of).join("results"))
    }

    /// Gives the answers of another cell the distances of a ranger.
    fn range(&self, folder: &CellFolder, of: &Cell, by: RangerName) -> Result<()> {
        let files = self.to_range(of)?;
        let ranger = match Ranger::geometric(by, CAMERA_HEIGHT_M) {
            Some(ranger) => ranger,
            None => self.fitted(of.seed)?,
        };
        for (index, id) in self.dataset.ids().into_iter().enumerate() {
            folder.keep(&id, ranger.ranged(found(&files, &id)?, &self.dataset.camera(index)?))?;
        }
        Ok(())
    }

    /// Gives the answers of another cell the distances of the true depth, which the renderer knows.
    fn range_by_depth(&self, folder: &CellFolder, of: &Cell) -> Result<()> {
        let files = self.to_range(of)?;
        let kitti = self.job.kitti.as_deref();
        let kitti = kitti.context("the true depth is rendered; expected --kitti, whose twins the data are")?;
        let twins = Twins::new(kitti, self.job.plan.data.twin_seed);
        let open: Vec<_> =
            self.dataset.ids().into_iter().enumerate().filter(|(_, id)| !folder.answer(id).exists()).collect();
        open.into_par_iter().try_for_each(|(index, id)| {
            let twin = twins.frame(&id)?;
            let is_twin = self.dataset.image(index)? == twin.image;
            ensure!(is_twin, "{}: not the twin of its frame in {}", self.dataset.origin(index), kitti.display());
            let depth: &DepthMap = twin.annotation().context("a rendered frame without depth")?;
            folder.keep(&id, ranged_by_median(found(&files, &id)?, &twin.camera, depth, twin.image_size()))
        })
    }

    /// The ranger that learns, from the frames that arms learn from.
    fn fitted(&self, seed: u64) -> Result<Ranger> {
        let dataset = frames(&self.job.data, &self.job.out.join("train.txt"), &self.split.train)?;
        let frame = |index| Ok((dataset.camera(index)?, dataset.labels(index)?));
        let frames = (0..dataset.len()).map(frame).collect::<Result<Vec<_>, DatasetError>>()?;
        Ranger::fitted(&frames, seed).with_context(|| format!("{}: no object to learn from", dataset.name()))
    }

    /// Takes a cell that is done elsewhere from its record, where it is not in the folder.
    fn restore(&self, cell: &Cell) -> Result<()> {
        let path = record::path(&self.job.records, cell);
        if !path.exists() || self.measured(cell).exists() {
            return Ok(());
        }
        let record = Record::read(&path, &self.identity(cell)?)?;
        if let Some(folder) = CellFolder::take(&self.folder(cell), &record.identity)? {
            record.unpack(&folder).with_context(|| path.display().to_string())?;
            self.keep(cell, &record.measured)?;
        }
        Ok(())
    }

    /// Says that a cell is done.
    fn keep(&self, cell: &Cell, result: &CellResult) -> Result<()> {
        let text = serde_json::to_string(result)? + "\n";
        Ok(write_atomically(&self.measured(cell), |file| file.write_all(text.as_bytes()))?)
    }

    /// The file that says that a cell is done, and what it gave.
    fn measured(&self, cell: &Cell) -> PathBuf {
        self.folder(cell).join("measured.json")
    }

    /// Answers beside the labels.
    fn answers(&self, results: &Path) -> Result<FrameFiles> {
        let ids = Some(self.split.evaluate.clone());
        Ok(FrameFiles::open(LabelSource::from(&self.dataset), results, ids)?.with_any_classes())
    }

    fn evaluation(&self, results: &Path) -> Result<Evaluation> {
        statistics::evaluation(&self.answers(results)?)
    }

    /// Every cell of the folder that is done, whoever did it, and the comparisons that they allow.
    fn results(&mut self) -> Result<Results> {
        let mut cells = Vec::new();
        for cell in self.job.plan.cells() {
            let path = self.measured(&cell);
            if !path.exists() {
                continue;
            }
            let text = read_text(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
            cells.push(serde_json::from_str(&text).with_context(|| format!("{}: no result", path.display()))?);
            if !self.judge.has(&cell) {
                let evaluation = self.evaluation(&self.folder(&cell).join("results"))?;
                self.judge.keep(cell, evaluation);
            }
        }
        let plan = &self.job.plan;
        Ok(Results { cells, arms: self.judge.arms(plan)?, comparisons: self.judge.comparisons(plan)? })
    }
}
