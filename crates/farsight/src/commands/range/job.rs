//! The images of one call, told one after the other; what fails is told and the others are still done.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};

use anyhow::{Error, Result, bail, ensure};
use farsight::camera_source::file_stem;
use farsight::json::{ImageRecord, ModelRecord};
use farsight::object::detections;
use farsight::{
    CameraSource, DetectedObject, ImageLimits, LoadedImage, Pipeline, RangeError, RangedImage, UnfamiliarCamera, View,
    ViewSource, draw_through_lens, load_image,
};
use farsight_data::ImageWarning;
use farsight_data::kitti::write_results;
use farsight_files::write_atomically;
use farsight_recordings::{RecordedFrame, RecordedObject};
use farsight_viz::picture_divisor;
use image::RgbImage;
use indicatif::ProgressBar;

use super::RangeArgs;
use super::answers::{Answer, AnswerFile, Answered, shown};
use super::format::{Answers, Format};
use crate::camera_args::with_hint;
use crate::inputs::identity;
use crate::names::output_names;
use crate::outputs;
use crate::printer::{Printer, counted, progress_bar};
use crate::recording_file::{RecordingArgs, Recordings};
use crate::side_by_side::in_order;

/// Fewer images than this need no progress bar: the table itself shows how far it is.
const MANY_IMAGES: usize = 5;

/// What came of one image.
struct ProcessedImage {
    image: RgbImage,
    view: View,
    record: ImageRecord,
    objects: Vec<DetectedObject>,
    /// A camera that the model does not know.
    unfamiliar: Option<UnfamiliarCamera>,
    /// What is odd about the file.
    warnings: Vec<ImageWarning>,
    /// Where the camera comes from and how the picture was drawn, where that is worth a word.
    notes: Vec<String>,
    /// Outputs that could not be written.
    unwritten: Vec<(PathBuf, anyhow::Error)>,
}

/// Everything but the detector.
pub(super) struct Job<'a> {
    args: &'a RangeArgs,
    images: Vec<PathBuf>,
    /// Names of the outputs, one for each image, all different.
    names: Vec<String>,
    views: ViewSource,
    format: Format,
    /// The images to look at, where others look at the rest.
    block: Option<Range<usize>>,
}

impl<'a> Job<'a> {
    /// Checks what can be checked before the first image, and makes the folders of the outputs.
    pub(super) fn new(args: &'a RangeArgs, images: Vec<PathBuf>, printer: &mut Printer) -> Result<Self> {
        let views = args.view.source(&images)?;
        if matches!(views.cameras(), CameraSource::Kitti) {
            printer.note("cameras from the calibration files of KITTI's layout (folder calib beside image_2)");
        }
        let names = output_names(&images);
        let format = args.format()?;
        let job = Self { args, images, names, views, format, block: None };
        let inputs: Vec<PathBuf> = job.images.iter().map(|image| identity(image)).collect();
        job.check_folders(&inputs)?;
        job.check_json(&inputs)?;
        job.check_names(&inputs, printer)?;
        [&args.out, &args.kitti].into_iter().flatten().try_for_each(|folder| outputs::make_folder(folder))?;
        Ok(job)
    }

    /// Looks at these of the images only, and may find that none of them can be done.
    pub(super) fn only(self, block: Range<usize>) -> Self {
        Self { block: Some(block), ..self }
    }

    /// How many images it looks at.
    pub(super) fn image_count(&self) -> usize {
        self.block.as_ref().map_or(self.images.len(), Range::len)
    }

    /// No labels, calibrations or images become results.
    fn check_folders(&self, inputs: &[PathBuf]) -> Result<()> {
        let folders: BTreeSet<&Path> = inputs.iter().filter_map(|image| image.parent()).collect();
        let layouts = folders.into_iter().filter(|folder| folder.ends_with("image_2"));
        let mut folders: Vec<PathBuf> = layouts.flat_map(outputs::layout_folders).collect();
        folders.extend(self.args.view.camera.calib.clone());
        if let Some(out) = &self.args.out {
            outputs::check_no_input(out, &folders)?;
        }
        self.args.kitti.as_ref().map_or(Ok(()), |kitti| outputs::check_results(kitti, &self.names, &folders))
    }

    fn check_json(&self, inputs: &[PathBuf]) -> Result<()> {
        let RangeArgs { pipeline, view, .. } = self.args;
        let Some(json) = self.args.json_file() else { return Ok(()) };
        let others = view.camera.calib.clone().into_iter().chain(pipeline.files());
        outputs::check_json(json, inputs.iter().cloned().chain(others))
    }

    /// Pictures must not replace the images they are made from; outputs that were renamed are worth a word.
    fn check_names(&self, inputs: &[PathBuf], printer: &mut Printer) -> Result<()> {
        for (image, name) in self.images.iter().zip(&self.names) {
            if let Some(picture) = self.picture_path(name) {
                let replaces = picture.exists() && inputs.contains(&identity(&picture));
                ensure!(!replaces, "{}: would be replaced by its picture; give another --out", picture.display());
            }
            if *name != file_stem(image) {
                printer.note(&format!("{}: called {name} here, another image has its name", image.display()));
            }
        }
        Ok(())
    }

    fn picture_path(&self, name: &str) -> Option<PathBuf> {
        self.args.out.as_ref().map(|folder| folder.join(format!("{name}.{}", self.args.picture_format.extension())))
    }

    fn rows_path(&self, name: &str) -> Option<PathBuf> {
        self.args.kitti.as_ref().map(|folder| folder.join(format!("{name}.txt")))
    }

    /// Whether anything is left of the work when nobody reads what is printed.
    fn writes_files(&self) -> bool {
        let RangeArgs { out, kitti, recordings: RecordingArgs { mcap, rerun }, .. } = self.args;
        self.args.json_file().is_some() || [out, kitti, mcap, rerun].into_iter().any(Option::is_some)
    }

    /// Looks at every image, neighbouring ones side by side, and returns those that failed.
    ///
    /// An error when none could be done, or an output could not be written; the others are done before.
    pub(super) fn run(&self, pipeline: &Pipeline, printer: &mut Printer) -> Result<Vec<String>> {
        let mut left = self.left_by_earlier_run(pipeline)?;
        let block = self.block.clone().unwrap_or(0..self.images.len());
        let is_done: Vec<bool> =
            self.images.iter().zip(&self.names).map(|(image, name)| self.is_done(image, name, &left)).collect();
        let todo: Vec<bool> = is_done.iter().zip(0..).map(|(done, place)| !done && block.contains(&place)).collect();
        let skipped = is_done.iter().filter(|done| **done).count();
        if skipped > 0 {
            printer.note(&format!("{} left out, whose answers are there (--resume)", counted(skipped, "image")));
        }
        let mut file = self.begin_file(&mut left, &todo)?;
        let mut recordings = self.begin_recordings()?;
        let mut answers = Answers::new(self.format, &self.names);
        let count = todo.iter().filter(|todo| **todo).count();
        let bar = if count < MANY_IMAGES { ProgressBar::hidden() } else { progress_bar(count) };
        let mut tally = Tally { skipped, ..Tally::default() };
        let places = (0..self.images.len()).filter(|place| todo[*place]);
        let look = |place: usize| (place, self.image(&self.images[place], &self.names[place], pipeline));
        in_order(places, pipeline.side_by_side(), look, |(place, looked)| {
            let (image, name) = (&self.images[place], &self.names[place]);
            bar.suspend(|| match looked {
                Ok(looked) => {
                    Self::tell(&looked, image, &mut tally, printer);
                    answers.print(name, &looked.objects, &looked.record, printer)?;
                    if let Err(error) = record(&mut recordings, &looked, tally.done) {
                        printer.failure(&error);
                        tally.unwritten += 1;
                        recordings = Recordings::default();
                    }
                    tally.done += 1;
                    // The other outputs of this image and the next ones are still made.
                    if let Some(Err(error)) = file.as_mut().map(|file| file.add(looked.record)) {
                        printer.failure(&error);
                        tally.unwritten += 1;
                        file = None;
                    }
                    anyhow::Ok(())
                }
                Err(error) => {
                    tally.failed.push(shown(image));
                    printer.failure(&error);
                    [self.picture_path(name), self.rows_path(name)]
                        .into_iter()
                        .flatten()
                        .for_each(|path| remove(&path, printer));
                    Ok(())
                }
            })?;
            bar.inc(1);
            let is_in_vain = printer.reader_is_gone() && !self.writes_files();
            anyhow::Ok(if is_in_vain { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        })?;
        bar.finish_and_clear();
        for (warning, images) in &tally.warnings {
            printer.warning(&format!("{warning} ({})", counted(*images, "image")));
        }
        if tally.done > 0 {
            answers.finish(printer);
        }
        self.finish(file, &tally, printer)?;
        recordings.finish()?;
        Ok(tally.failed)
    }

    fn begin_recordings(&self) -> Result<Recordings> {
        let RangeArgs { recordings, view, pipeline, .. } = self.args;
        Recordings::begin(recordings, self.images.iter().chain(&view.camera.calib).cloned().chain(pipeline.files()))
    }

    /// The answers of an earlier run, where this one goes on with it.
    fn left_by_earlier_run(&self, pipeline: &Pipeline) -> Result<Answered> {
        match self.args.json_file().filter(|_| self.args.resume) {
            Some(json) => AnswerFile::left_by_earlier_run(json, &ModelRecord::from(pipeline.info())),
            None => Ok(Answered::new()),
        }
    }

    /// Whether all that is asked for of an image is there.
    fn is_done(&self, image: &Path, name: &str, left: &Answered) -> bool {
        let is_there = |path: Option<PathBuf>| path.is_none_or(|path| path.is_file());
        self.args.resume
            && (self.args.json_file().is_none() || left.contains_key(&shown(image)))
            && is_there(self.picture_path(name))
            && is_there(self.rows_path(name))
    }

    /// Begins the file of all answers with those that stay: of images that are done, and of others that are not asked
    /// for now.
    fn begin_file(&self, left: &mut Answered, todo: &[bool]) -> Result<Option<AnswerFile>> {
        let Some(json) = self.args.json_file() else { return Ok(None) };
        let mut kept = Vec::new();
        for (image, &todo) in self.images.iter().zip(todo) {
            kept.extend(left.remove(&shown(image)).filter(|_| !todo));
        }
        let mut others: Vec<Answer> = left.drain().map(|(_, answer)| answer).collect();
        others.sort_by(|a, b| a.image.cmp(&b.image));
        others.extend(kept);
        AnswerFile::begin(json, others).map(Some)
    }

    /// What is to be said of an image beside its rows.
    fn tell(looked: &ProcessedImage, image: &Path, tally: &mut Tally, printer: &mut Printer) {
        if let Some(camera) = &looked.unfamiliar {
            *tally.warnings.entry(camera.to_string()).or_insert(0) += 1;
        }
        for warning in &looked.warnings {
            printer.warning(&format!("{}: {warning}", image.display()));
        }
        for note in &looked.notes {
            // Photos of one camera share theirs.
            if tally.noted.insert(note.clone()) {
                printer.note(&format!("{}: {note}", image.display()));
            }
        }
        for (path, error) in &looked.unwritten {
            printer.failure(error);
            remove(path, printer);
        }
        tally.unwritten += looked.unwritten.len();
        tally.found += looked.objects.len();
    }

    fn finish(&self, file: Option<AnswerFile>, tally: &Tally, printer: &mut Printer) -> Result<()> {
        let Tally { done, found, unwritten, skipped, .. } = *tally;
        let failed = tally.failed.len();
        if done + skipped == 0 && self.block.is_none() {
            file.into_iter().for_each(AnswerFile::discard);
            bail!("nothing was done: {} failed", counted(failed, "image"));
        }
        if let Some(file) = file {
            file.finish(&self.images)?;
        }
        let failures = if failed > 0 { format!("; {} failed", counted(failed, "image")) } else { String::new() };
        printer.status(&format!("{} found in {}{failures}", counted(found, "object"), counted(done, "image")));
        ensure!(unwritten == 0, "{} could not be written", counted(unwritten, "output"));
        Ok(())
    }

    /// Looks at one image and writes its files.
    fn image(&self, path: &Path, name: &str, pipeline: &Pipeline) -> Result<ProcessedImage> {
        let loaded = load_image(path, ImageLimits::default())?;
        let image = &loaded.pixels;
        let ranged = pipeline.range_image(path, &loaded, &self.views).map_err(|error| match error {
            RangeError::Camera(error) => with_hint(error),
            error => Error::from(error).context(path.display().to_string()),
        })?;
        let RangedImage { view, objects, record, unfamiliar, .. } = ranged;
        let (mut notes, mut unwritten) = (Vec::new(), Vec::new());
        let size = [image.width() as usize, image.height() as usize];
        if let Some(estimate) = view.estimate() {
            let ([narrow, wide], hfov_deg) = (estimate.hfov_interval_deg(size[0]), estimate.hfov_deg(size[0]));
            notes.push(format!("camera estimated from the image: --hfov {hfov_deg:.0} ({narrow:.0} to {wide:.0})"));
        } else if let Some(Ok(found)) = self.views.cameras().from_exif(path, size, &loaded.exif) {
            notes.push(format!("camera from EXIF data ({}): --hfov {:.1}", found.how, found.hfov_deg));
        }
        if let Some(target) = self.picture_path(name) {
            let divisor = picture_divisor([image.width(), image.height()]);
            if divisor > 1 {
                notes.push(format!("a large image, drawn at 1/{divisor} of its size"));
            }
            unwritten.extend(self.write_picture(&target, image, &view, &objects).err().map(|error| (target, error)));
        }
        if let Some(target) = self.rows_path(name) {
            unwritten.extend(write_results(&target, &detections(&objects)).err().map(|error| (target, error.into())));
        }
        let LoadedImage { pixels: image, warnings, .. } = loaded;
        Ok(ProcessedImage { image, view, record, objects, unfamiliar, warnings, notes, unwritten })
    }

    fn write_picture(&self, target: &Path, image: &RgbImage, view: &View, objects: &[DetectedObject]) -> Result<()> {
        let drawn = draw_through_lens(image, view.camera(), view.lens(), objects, self.args.range.kind());
        Ok(write_atomically(target, |out| self.args.picture_format.write(&drawn, out))?)
    }
}

/// Records image number `place`, at a second each.
fn record(recordings: &mut Recordings, looked: &ProcessedImage, place: usize) -> Result<()> {
    if recordings.is_empty() {
        return Ok(());
    }
    let found = RecordedObject::from_detections(&detections(&looked.objects));
    // Recordings tell of a pinhole.
    let image = looked.view.straightened(&looked.image)?;
    recordings.add(&RecordedFrame { time_s: place as f64, image: &image, camera: looked.view.camera(), found: &found })
}

/// What is counted over all images.
#[derive(Default)]
struct Tally {
    done: usize,
    /// Images whose answers were there.
    skipped: usize,
    found: usize,
    /// Images that failed.
    failed: Vec<String>,
    unwritten: usize,
    /// Images for each warning about their cameras.
    warnings: BTreeMap<String, usize>,
    /// Notes that were printed.
    noted: BTreeSet<String>,
}

/// What an earlier run found in an image must not be taken for an answer of this one, in which it failed.
fn remove(output: &Path, printer: &mut Printer) {
    if !output.is_file() {
        return;
    }
    match fs::remove_file(output) {
        Ok(()) => printer.note(&format!("{}: removed, as its image failed", output.display())),
        Err(error) => printer.error(&format!("{}: not of this run, cannot be removed: {error}", output.display())),
    }
}
