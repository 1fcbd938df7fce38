//! Folders of label and result files, read as the devkit reads them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::{fs, io};

use farsight_core::Label;
use farsight_data::DatasetError;
use farsight_data::kitti::{DevkitRow, Diagnostic, RowKind, rows_as_devkit};
use rayon::prelude::*;
use serde::Serialize;
use thiserror::Error;

use crate::label_source::{LabelSource, LabelledDataset};
use crate::ranging::RangingOptions;
use crate::{EvaluatedClass, Evaluation, Findings, Frame, Prediction};

/// Frames read at a time: enough to keep all threads busy, few enough that memory does not grow with the set.
const CHUNK: usize = 256;

/// Files looked at to tell a label folder from a result folder.
const PROBED_FILES: usize = 50;

/// Where people's label files usually lie, and their result files.
const USUAL_PLACES: [&str; 4] = ["training/label_2", "label_2", "data", "results/data"];

/// Kinds of findings about whole files.
const NOT_IN_SPLIT: &str = "result files of frames that are not in the split, left out";
const NOT_COMPARED: &str = "result files of frames that are not compared, left out";
const WITHOUT_LABELS: &str = "result files without a label file, left out";
const WITHOUT_RESULTS: &str =
    "frames without a result file, left out (their objects do not count as missed; give --split to demand all)";

/// Labels and a folder of results with the frames to evaluate.
#[derive(Debug, Clone)]
pub struct FrameFiles {
    labels: LabelSource,
    results: PathBuf,
    ids: Vec<String>,
    /// Frames that have files but take no part.
    left_out: Findings,
    /// Whether to tell what is odd about the labels.
    report_labels: bool,
    /// Whether to tell of detections whose class plays no part.
    report_classes: bool,
    scores: Scores,
    /// Whether all vehicles are one class ([`Frame::with_vehicles_as_cars`]).
    vehicles_as_cars: bool,
}

/// What the scores of detections are taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Scores {
    /// What the files say.
    #[default]
    AsGiven,
    /// The probability that the place is right as well, [`farsight_core::Detection::place_score`]: what ranks
    /// detections for AP in space.
    Place,
}

/// Folders or files that cannot be evaluated.
#[derive(Debug, Error)]
pub enum FilesError {
    /// There is no such folder.
    #[error("{}: no such folder; expected a folder of {what} files such as 000007.txt", path.display())]
    NoFolder {
        /// What was given.
        path: PathBuf,
        /// `label` or `result`.
        what: &'static str,
    },
    /// The folder holds no text files.
    #[error("{}: no .txt file in this folder; expected {what} files such as 000007.txt{}", path.display(), hint(inside.as_ref()))]
    NoFiles {
        /// What was given.
        path: PathBuf,
        /// `label` or `result`.
        what: &'static str,
        /// A folder inside that has some.
        inside: Option<PathBuf>,
    },
    /// The folder cannot be listed, or a file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The results have no scores.
    #[error(
        "{}: these are labels, not results: the rows have 15 fields; expected 16, the last one the score", path.display()
    )]
    LabelsAsResults {
        /// The folder given as results.
        path: PathBuf,
    },
    /// No frame has both files.
    #[error("no frame has a label file in {} and a result file in {}; file names must be the same, such as 000007.txt", labels.display(), results.display())]
    NothingInCommon {
        /// The label folder.
        labels: PathBuf,
        /// The result folder.
        results: PathBuf,
    },
    /// Something that is no folder.
    #[error("{}: this is a file; expected a folder of {what} files such as 000007.txt", path.display())]
    NotAFolder {
        /// What was given.
        path: PathBuf,
        /// `label` or `result`.
        what: &'static str,
    },
    /// Frames that must be evaluated lack a file.
    #[error("{count} of {total} frames of the {wanted_by} have no {what} file; the first is {}{}", expected.display(), remedy(what))]
    Incomplete {
        /// Who wants them: the `split` or the `comparison`.
        wanted_by: &'static str,
        /// `label` or `result`.
        what: &'static str,
        /// How many.
        count: usize,
        /// Of how many.
        total: usize,
        /// The first that is missing.
        expected: PathBuf,
    },
    /// A detection whose place cannot be judged.
    #[error(
        "{place}: no error bar; place scores need one in every row, the standard deviation of the distance in metres as 17th field"
    )]
    NoErrorBar {
        /// File and line.
        place: String,
    },
    /// Labels of a data set that cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A row that no figure should be made from.
    #[error("{place}")]
    Fatal {
        /// File, line and what is wrong.
        place: String,
    },
}

fn hint(inside: Option<&PathBuf>) -> String {
    inside.map_or_else(String::new, |inside| format!("; there are some in {}: give that folder", inside.display()))
}

fn remedy(what: &str) -> &'static str {
    if what == "result" { " (a frame in which nothing was found needs an empty file)" } else { "" }
}

impl FrameFiles {
    /// Looks at labels and results; `split` names the frames to evaluate, otherwise all that have a result file.
    ///
    /// # Errors
    /// When a folder is not there or holds something else, a frame of the split lacks a file, or a data set has no
    /// labels.
    pub fn open(
        labels: impl Into<LabelSource>,
        results: &Path,
        split: Option<Vec<String>>,
    ) -> Result<Self, FilesError> {
        let labels = labels.into();
        let label_ids = label_ids(&labels)?;
        let result_ids = ids_in(results, "result")?;
        let results = results.to_owned();
        let mut left_out = Findings::default();
        let ids: Vec<String> = if let Some(ids) = split {
            require_all(&ids, &label_ids, ["split", "label"], &labels.place())?;
            require_all(&ids, &result_ids, ["split", "result"], &results)?;
            left_out = others(NOT_IN_SPLIT, &result_ids, &ids, &results);
            ids
        } else {
            for id in result_ids.difference(&label_ids) {
                left_out.add_file(WITHOUT_LABELS, || file(&results, id));
            }
            for id in label_ids.difference(&result_ids) {
                left_out.add_file(WITHOUT_RESULTS, || file(&labels.place(), id));
            }
            label_ids.intersection(&result_ids).cloned().collect()
        };
        if ids.is_empty() {
            return Err(FilesError::NothingInCommon { labels: labels.place(), results });
        }
        Self {
            labels,
            results,
            ids,
            left_out,
            report_labels: true,
            report_classes: true,
            scores: Scores::AsGiven,
            vehicles_as_cars: false,
        }
        .checked()
    }

    /// The same files, the scores taken for this.
    #[must_use]
    pub fn with_scores(self, scores: Scores) -> Self {
        Self { scores, ..self }
    }

    /// The same files, detections of classes that KITTI does not evaluate being nothing to tell: a model says what it
    /// has learnt to.
    #[must_use]
    pub fn with_any_classes(self) -> Self {
        Self { report_classes: false, ..self }
    }

    /// The same with all vehicles as one class, cars ([`Frame::with_vehicles_as_cars`]).
    #[must_use]
    pub fn with_vehicles_as_cars(self) -> Self {
        Self { vehicles_as_cars: true, report_classes: false, ..self }
    }

    /// The same frames with other results, to compare the two; what is odd about the labels is not told again.
    ///
    /// # Errors
    /// As [`FrameFiles::open`]; each of these frames must have a result.
    pub fn with_results(&self, results: &Path) -> Result<Self, FilesError> {
        let result_ids = ids_in(results, "result")?;
        require_all(&self.ids, &result_ids, ["comparison", "result"], results)?;
        let left_out = others(NOT_COMPARED, &result_ids, &self.ids, results);
        Self { results: results.to_owned(), left_out, report_labels: false, report_classes: true, ..self.clone() }
            .checked()
    }

    fn checked(self) -> Result<Self, FilesError> {
        if self.results_are_labels()? { Err(FilesError::LabelsAsResults { path: self.results }) } else { Ok(self) }
    }

    /// The frames, in the order of the evaluation.
    pub fn ids(&self) -> &[String] {
        &self.ids
    }

    /// Reads one frame and tells what is odd about its files.
    ///
    /// # Errors
    /// When a file cannot be read or holds a row that the devkit would misread.
    pub fn read(&self, id: &str) -> Result<(Frame, Findings), FilesError> {
        let mut findings = Findings::default();
        let labels = labels_of(&self.labels, id, &mut findings)?;
        if !self.report_labels {
            findings = Findings::default();
        }
        let predictions = rows(&self.results, id, RowKind::Result, &mut findings)?;
        for read in &predictions {
            if self.report_classes && EvaluatedClass::of(&read.row.label.class).is_none() {
                let place = || format!("{}:{}: {:?}", file(&self.results, id), read.line, read.row.label.class.name());
                findings.add("detections of classes that KITTI does not evaluate", place);
            }
        }
        let frame = Frame {
            id: id.to_owned(),
            labels,
            predictions: predictions.into_iter().map(|read| self.prediction(id, read)).collect::<Result<_, _>>()?,
        };
        let frame = if self.vehicles_as_cars { frame.with_vehicles_as_cars() } else { frame };
        Ok((frame, findings))
    }

    fn prediction(&self, id: &str, read: DevkitRow) -> Result<Prediction, FilesError> {
        let line = read.line;
        let mut prediction = Prediction::from(read);
        if self.scores == Scores::Place {
            let no_error_bar = || FilesError::NoErrorBar { place: format!("{}:{line}", file(&self.results, id)) };
            prediction.detection.score = prediction.detection.place_score().ok_or_else(no_error_bar)?;
        }
        Ok(prediction)
    }

    /// Reads and evaluates all frames, on all threads. No file is kept: memory grows with what an [`Evaluation`] keeps
    /// of a frame.
    ///
    /// # Errors
    /// As [`FrameFiles::read`].
    pub fn evaluate(&self, options: &RangingOptions) -> Result<(Evaluation, Findings), FilesError> {
        self.evaluate_changed(options, |frame| frame)
    }

    /// As [`FrameFiles::evaluate`], each frame being changed first.
    ///
    /// # Errors
    /// As [`FrameFiles::read`].
    pub fn evaluate_changed(
        &self,
        options: &RangingOptions,
        change: impl Fn(Frame) -> Frame + Sync,
    ) -> Result<(Evaluation, Findings), FilesError> {
        let mut evaluation = Evaluation::new(options.clone());
        let mut findings = self.left_out.clone();
        for ids in self.ids.chunks(CHUNK) {
            let evaluated: Vec<_> = ids.par_iter().map(|id| self.evaluate_frame(id, options, &change)).collect();
            for frame in evaluated {
                let (frame, found) = frame?;
                evaluation.append(frame);
                findings.append(found);
            }
        }
        Ok((evaluation, findings))
    }

    fn evaluate_frame(
        &self,
        id: &str,
        options: &RangingOptions,
        change: impl Fn(Frame) -> Frame,
    ) -> Result<(Evaluation, Findings), FilesError> {
        let (frame, findings) = self.read(id)?;
        let mut evaluation = Evaluation::new(options.clone());
        evaluation.add(&change(frame));
        Ok((evaluation, findings))
    }

    /// Whether rows of the first files all break off for want of a score.
    fn results_are_labels(&self) -> Result<bool, FilesError> {
        let mut dropped = 0;
        for id in self.ids.iter().take(PROBED_FILES) {
            let path = PathBuf::from(file(&self.results, id));
            let bytes = farsight_files::read_file(&path, farsight_files::MAX_TEXT)
                .map_err(|source| FilesError::Read { path, source })?;
            let read = rows_as_devkit(&String::from_utf8_lossy(&bytes), RowKind::Result);
            if !read.rows.is_empty() {
                return Ok(false);
            }
            let lacks_score = |diagnostic: &Diagnostic| matches!(diagnostic, Diagnostic::DroppedRow { fields: 15, .. });
            dropped += read.diagnostics.iter().filter(|(_, diagnostic)| lacks_score(diagnostic)).count();
        }
        Ok(dropped > 0)
    }
}

/// Result files of frames that were not asked for.
fn others(kind: &'static str, there: &BTreeSet<String>, wanted: &[String], results: &Path) -> Findings {
    let wanted: BTreeSet<&String> = wanted.iter().collect();
    let mut left_out = Findings::default();
    for id in there.iter().filter(|id| !wanted.contains(id)) {
        left_out.add_file(kind, || file(results, id));
    }
    left_out
}

/// Names of the frames that have labels.
fn label_ids(labels: &LabelSource) -> Result<BTreeSet<String>, FilesError> {
    match labels {
        LabelSource::Folder(folder) => ids_in(folder, "label"),
        LabelSource::Dataset(LabelledDataset { dataset, .. }) if !dataset.is_labelled() => {
            Err(DatasetError::Unlabelled { name: dataset.name() }.into())
        }
        LabelSource::Dataset(LabelledDataset { indices, .. }) => Ok(indices.keys().cloned().collect()),
    }
}

/// The labels of one frame; what is odd about their file goes to `findings`.
fn labels_of(labels: &LabelSource, id: &str, findings: &mut Findings) -> Result<Vec<Label>, FilesError> {
    match labels {
        LabelSource::Folder(folder) => {
            Ok(rows(folder, id, RowKind::Label, findings)?.into_iter().map(|read| read.row.label).collect())
        }
        LabelSource::Dataset(LabelledDataset { dataset, indices }) => {
            let index = indices.get(id).copied();
            Ok(index.map(|index| dataset.labels(index)).transpose()?.unwrap_or_default())
        }
    }
}

/// Reads one file; what is odd about it goes to `findings`.
fn rows(folder: &Path, id: &str, kind: RowKind, findings: &mut Findings) -> Result<Vec<DevkitRow>, FilesError> {
    let path = PathBuf::from(file(folder, id));
    let bytes = farsight_files::read_file(&path, farsight_files::MAX_TEXT)
        .map_err(|source| FilesError::Read { path: path.clone(), source })?;
    let read = rows_as_devkit(&String::from_utf8_lossy(&bytes), kind);
    for (line, diagnostic) in &read.diagnostics {
        let place = || format!("{}:{line}: {diagnostic}", path.display());
        if diagnostic.is_fatal() {
            return Err(FilesError::Fatal { place: place() });
        }
        findings.add(diagnostic.kind(), place);
    }
    Ok(read.rows)
}

fn file(folder: &Path, id: &str) -> String {
    folder.join(format!("{id}.txt")).display().to_string()
}

fn ids_in(folder: &Path, what: &'static str) -> Result<BTreeSet<String>, FilesError> {
    if folder.is_file() {
        return Err(FilesError::NotAFolder { path: folder.to_owned(), what });
    }
    if !folder.is_dir() {
        return Err(FilesError::NoFolder { path: folder.to_owned(), what });
    }
    let ids = text_files(folder)?;
    if ids.is_empty() {
        let usual = USUAL_PLACES.iter().map(|place| folder.join(place));
        let inside = usual.into_iter().find(|place| text_files(place).is_ok_and(|ids| !ids.is_empty()));
        return Err(FilesError::NoFiles { path: folder.to_owned(), what, inside });
    }
    Ok(ids)
}

fn text_files(folder: &Path) -> Result<BTreeSet<String>, FilesError> {
    let error = |source| FilesError::Read { path: folder.to_owned(), source };
    let mut ids = BTreeSet::new();
    for entry in fs::read_dir(folder).map_err(error)? {
        let path = entry.map_err(error)?.path();
        if path.extension().is_some_and(|extension| extension == "txt") {
            ids.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
        }
    }
    Ok(ids)
}

fn require_all(
    ids: &[String],
    there: &BTreeSet<String>,
    [wanted_by, what]: [&'static str; 2],
    folder: &Path,
) -> Result<(), FilesError> {
    let mut missing = ids.iter().filter(|id| !there.contains(*id));
    let Some(first) = missing.next() else { return Ok(()) };
    let count = 1 + missing.count();
    let expected = PathBuf::from(file(folder, first));
    Err(FilesError::Incomplete { wanted_by, what, count, total: ids.len(), expected })
}
