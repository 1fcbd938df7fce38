//! One cell: a training, its answers, what they are worth. Every step is left out when its output is whole.

use std::fs::{self, File, TryLockError};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use farsight::object::detections;
use farsight::{EngineOptions, ModelSource, Pipeline, PipelineBuilder, Road, StageSource};
use farsight_core::Detection;
use farsight_data::Dataset;
use farsight_data::kitti::write_results;
use farsight_files::{read_text, write_atomically};
use farsight_graph::weights::Weights;
use farsight_methods::training::train;
use farsight_onnx::key;
use farsight_train::config::ValidateConfig;
use farsight_train::metrics::StepSummary;
use farsight_train::training::{Callback, FileOptions, Start, TrainError};
use serde_json::Value;
use toml::Table;

use crate::commands::train::progress::Progress;
use crate::printer::{Printer, counted};
use crate::side_by_side::in_order;

/// What a folder must belong to, so that nothing is mixed: one line of text.
const IDENTITY_FILE: &str = "identity.txt";
const CONFIG_FILE: &str = "cell.toml";
const LOCK_FILE: &str = "lock";
const RESULTS_FOLDER: &str = "results";

/// The least score of answers that are kept, where the plan names none: most networks have twice as many below it as
/// above, and records grow by them.
pub(super) const MIN_SCORE: f64 = 0.1;

/// Frames between two lines that say how far the answers have come.
const TOLD_EVERY: usize = 500;

/// Whether the time that was given is over.
pub(super) fn is_over(deadline: Option<Instant>) -> bool {
    deadline.is_some_and(|deadline| Instant::now() >= deadline)
}

/// How a step of a cell ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    Done,
    /// The time is over; the same step goes on from where it stopped.
    Stopped,
}

/// Whether two identities are the same but for a start that the expected one does not know.
pub(super) fn is_of(found: &str, expected: &str) -> bool {
    if found == expected {
        return true;
    }
    let [found, mut expected] = [found, expected].map(serde_json::from_str::<Value>);
    let (Ok(found), Ok(expected)) = (found, &mut expected) else {
        return false;
    };
    for at in ["/start", "/start/start", "/of/start"] {
        if let (Some(start), Some(unknown @ Value::Null)) = (found.pointer(at), expected.pointer_mut(at)) {
            *unknown = start.clone();
        }
    }
    found == *expected
}

/// The folder of a cell, held by this process.
pub(super) struct CellFolder {
    folder: PathBuf,
    /// Held while it is open, and let go when the process dies.
    _lock: File,
}

impl CellFolder {
    /// Takes the folder; none when another process has it. What is in it must be of the same `identity`.
    pub(super) fn take(folder: &Path, identity: &str) -> Result<Option<Self>> {
        let failed = || format!("{}: cannot be made", folder.display());
        fs::create_dir_all(folder.join(RESULTS_FOLDER)).with_context(failed)?;
        let lock = File::create(folder.join(LOCK_FILE)).with_context(failed)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Ok(None),
            Err(TryLockError::Error(error)) => return Err(error).with_context(failed),
        }
        let path = folder.join(IDENTITY_FILE);
        if path.exists() {
            let found = read_text(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
            let expected = "expected the plan, data, start and program of the cell that is there; or another --out";
            ensure!(is_of(&found, identity), "{}: a cell of another experiment; {expected}", folder.display());
        } else {
            write_atomically(&path, |file| file.write_all(identity.as_bytes()))?;
        }
        Ok(Some(Self { folder: folder.to_owned(), _lock: lock }))
    }

    /// The trained model.
    fn model(&self) -> PathBuf {
        Self::model_in(&self.folder)
    }

    /// The trained model of the cell in `folder`.
    pub(super) fn model_in(folder: &Path) -> PathBuf {
        folder.join("model.safetensors")
    }

    /// The folder of its answers.
    pub(super) fn results(&self) -> PathBuf {
        self.folder.join(RESULTS_FOLDER)
    }

    /// The file of the answers for a frame.
    pub(super) fn answer(&self, id: &str) -> PathBuf {
        self.results().join(format!("{id}.txt"))
    }

    /// Trains, or goes on.
    pub(super) fn train(&self, config: &Table, deadline: Option<Instant>, printer: &mut Printer) -> Result<Step> {
        if self.model().exists() {
            return Ok(Step::Done);
        }
        let path = self.folder.join(CONFIG_FILE);
        let text = toml::to_string(config).context("the config of a cell")?;
        write_atomically(&path, |file| file.write_all(text.as_bytes()))?;
        let options = FileOptions { data: None, out: self.folder.clone(), resume: true };
        let mut callback = Timed { inner: Progress::new(printer, false), deadline };
        match train(&path, &options, &mut callback) {
            Ok(model) => {
                let expected = self.model();
                ensure!(model == expected, "{}: expected the model of a detector", model.display());
                Ok(Step::Done)
            }
            Err(TrainError::Stopped { .. }) => Ok(Step::Stopped),
            Err(error) => Err(error.into()),
        }
    }

    /// Steps of the training that is done.
    pub(super) fn steps(&self) -> Result<u64> {
        let path = self.model();
        let weights = Weights::read(&path)?;
        let facts = weights.metadata.get(key::TRAINING).map(|text| serde_json::from_str::<Value>(text));
        let steps = facts.transpose()?.and_then(|facts| facts.get("steps")?.as_u64());
        steps.with_context(|| format!("{}: does not say its steps", path.display()))
    }

    /// Lets the trained detector look at the frames that have no answer yet, alone.
    pub(super) fn look_trained(
        &self,
        dataset: &dyn Dataset,
        engine: &EngineOptions,
        min_score: f64,
        deadline: Option<Instant>,
        printer: &mut Printer,
    ) -> Result<Step> {
        let builder = Pipeline::builder().road(Road::Ignored).refiner(StageSource::Off).plates(StageSource::Off);
        let builder = builder.model(ModelSource::File(self.model())).engine_options(engine.clone());
        self.look(dataset, builder.min_score(min_score), deadline, printer)
    }

    /// Lets a pipeline look at the frames that have no answer yet.
    pub(super) fn look(
        &self,
        dataset: &dyn Dataset,
        builder: PipelineBuilder,
        deadline: Option<Instant>,
        printer: &mut Printer,
    ) -> Result<Step> {
        let open: Vec<(usize, String)> =
            dataset.ids().into_iter().enumerate().filter(|(_, id)| !self.answer(id).exists()).collect();
        if open.is_empty() {
            return Ok(Step::Done);
        }
        let pipeline = builder.images(open.len()).open()?;
        let (began, mut done) = (Instant::now(), 0);
        let detect = |index: usize| -> Result<Vec<Detection>> {
            let found = pipeline.detect(&dataset.image(index)?, &dataset.camera(index)?);
            Ok(detections(&found.with_context(|| dataset.origin(index))?))
        };
        let count = open.len();
        let look = |(index, id): (usize, String)| (id, detect(index));
        in_order(open, pipeline.side_by_side(), look, |(id, found)| {
            self.keep(&id, found?)?;
            done += 1;
            if done % TOLD_EVERY == 0 {
                let rate = done as f64 / began.elapsed().as_secs_f64();
                printer.status(&format!("{done} of {} looked at, {rate:.1}/s", counted(count, "frame")));
            }
            anyhow::Ok(if is_over(deadline) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        })?;
        Ok(if done == count { Step::Done } else { Step::Stopped })
    }

    /// Keeps these answers for a frame.
    pub(super) fn keep(&self, id: &str, mut found: Vec<Detection>) -> Result<()> {
        found.iter_mut().for_each(round);
        Ok(write_results(&self.answer(id), &found)?)
    }
}

/// To KITTI's digits, so that records are small: a tenth of a pixel, a centimetre, a hundredth of a radian.
fn round(detection: &mut Detection) {
    let to = |value: &mut f64, steps: f64| *value = (*value * steps).round() / steps;
    let Detection { box2d, box3d, score, .. } = detection;
    for value in [&mut box2d.x1, &mut box2d.y1, &mut box2d.x2, &mut box2d.y2] {
        to(value, 10.0);
    }
    let size = &mut box3d.dimensions;
    for value in [&mut size.length, &mut size.height, &mut size.width, &mut box3d.yaw] {
        to(value, 100.0);
    }
    for value in &mut box3d.location {
        to(value, 100.0);
    }
    to(score, 1000.0);
}

/// Tells how a training goes, and stops it when its time is over.
struct Timed<'a> {
    inner: Progress<'a>,
    deadline: Option<Instant>,
}

impl Callback for Timed<'_> {
    fn on_start(&mut self, start: Start) {
        self.inner.on_start(start);
    }

    fn on_step(&mut self, step: &StepSummary) {
        self.inner.on_step(step);
    }

    fn stops(&mut self) -> bool {
        is_over(self.deadline)
    }

    fn validate(&mut self, step: u64, model: &Path, config: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        self.inner.validate(step, model, config)
    }
}
