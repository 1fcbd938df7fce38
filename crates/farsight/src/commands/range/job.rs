//! The images of one call, one after the other; what fails is told and the others are still done.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use farsight_core::nms::bev_nms;
use farsight_core::{Box3d, Camera, Detection};
use farsight_data::kitti::write_results;
use farsight_data::read_image;
use farsight_files::write_atomically;
use farsight_methods::UnfamiliarCamera;
use farsight_viz::{DrawOptions, Scene, picture};
use image::RgbImage;
use image::codecs::png::PngEncoder;
use indicatif::ProgressBar;

use super::RangeArgs;
use crate::camera_source::CameraSource;
use crate::inputs::identity;
use crate::names::output_names;
use crate::outputs;
use crate::pipeline::Pipeline;
use crate::printer::{Printer, counted};
use crate::range_json::{self, ImageJson};
use crate::range_table::RangeTable;

/// Fewer images than this need no progress bar: the table itself shows how far it is.
const MANY_IMAGES: usize = 5;

/// The size of an image, what is in it, and a camera that the model does not know.
type Looked = ((u32, u32), Vec<Detection>, Option<UnfamiliarCamera>);

/// Everything but the detector.
pub(super) struct Job<'a> {
    args: &'a RangeArgs,
    images: Vec<PathBuf>,
    /// Names of the outputs, one for each image, all different.
    names: Vec<String>,
    cameras: CameraSource,
    range_m: fn(&Box3d) -> f64,
}

impl<'a> Job<'a> {
    /// Checks what can be checked before the first image, and makes the folders of the outputs.
    pub(super) fn new(args: &'a RangeArgs, images: Vec<PathBuf>, printer: &mut Printer) -> Result<Self> {
        let cameras = CameraSource::new(&args.camera, &images)?;
        if matches!(cameras, CameraSource::Kitti) {
            printer.note("cameras from the calibration files of KITTI's layout (folder calib beside image_2)");
        }
        let names = output_names(&images);
        let job = Self { args, images, names, cameras, range_m: args.range.measure() };
        let inputs: Vec<PathBuf> = job.images.iter().map(|image| identity(image)).collect();
        job.check_folders(&inputs)?;
        job.check_json(&inputs)?;
        job.check_names(&inputs, printer)?;
        [&args.out, &args.kitti].into_iter().flatten().try_for_each(|folder| outputs::make_folder(folder))?;
        Ok(job)
    }

    /// No labels, calibrations or images become results.
    fn check_folders(&self, inputs: &[PathBuf]) -> Result<()> {
        let folders: BTreeSet<&Path> = inputs.iter().filter_map(|image| image.parent()).collect();
        let layouts = folders.into_iter().filter(|folder| folder.ends_with("image_2"));
        let mut folders: Vec<PathBuf> = layouts.flat_map(outputs::layout_folders).collect();
        folders.extend(self.args.camera.calib.clone());
        if let Some(out) = &self.args.out {
            outputs::check_no_input(out, &folders)?;
        }
        self.args.kitti.as_ref().map_or(Ok(()), |kitti| outputs::check_results(kitti, &self.names, &folders))
    }

    fn check_json(&self, inputs: &[PathBuf]) -> Result<()> {
        let RangeArgs { json, model, second_look, camera, .. } = self.args;
        let Some(json) = json else { return Ok(()) };
        let others = [model.as_deref(), camera.calib.as_deref()].into_iter().flatten().chain(second_look.files());
        outputs::check_json(json, inputs.iter().map(PathBuf::as_path).chain(others))
    }

    /// Pictures must not replace the images they are made from; outputs that were renamed are worth a word.
    fn check_names(&self, inputs: &[PathBuf], printer: &mut Printer) -> Result<()> {
        for (image, name) in self.images.iter().zip(&self.names) {
            if let Some(picture) = self.picture_path(name) {
                let replaces = picture.exists() && inputs.contains(&identity(&picture));
                ensure!(!replaces, "{}: would be replaced by its picture; give another --out", picture.display());
            }
            if *name != crate::names::stem(image) {
                printer.note(&format!("{}: called {name} here, another image has its name", image.display()));
            }
        }
        Ok(())
    }

    fn picture_path(&self, name: &str) -> Option<PathBuf> {
        self.args.out.as_ref().map(|folder| folder.join(format!("{name}.png")))
    }

    fn rows_path(&self, name: &str) -> Option<PathBuf> {
        self.args.kitti.as_ref().map(|folder| folder.join(format!("{name}.txt")))
    }

    /// Whether anything is left of the work when nobody reads what is printed.
    fn writes_files(&self) -> bool {
        [&self.args.out, &self.args.kitti, &self.args.json].into_iter().any(Option::is_some)
    }

    /// Looks at every image and returns how many failed.
    ///
    /// An error when none could be done, or the JSON file could not be written.
    pub(super) fn run(&self, pipeline: &mut Pipeline, printer: &mut Printer) -> Result<usize> {
        let table = RangeTable::new(&self.names, self.range_m);
        printer.heading(&table.heading());
        let bar = if self.images.len() < MANY_IMAGES {
            ProgressBar::hidden()
        } else {
            ProgressBar::new(self.images.len() as u64)
        };
        let (mut done, mut found, mut failed, mut warnings) = (Vec::new(), 0, 0, BTreeMap::new());
        for (image, name) in self.images.iter().zip(&self.names) {
            match self.image(image, name, pipeline) {
                Ok((size, detections, unfamiliar)) => {
                    if let Some(camera) = unfamiliar {
                        *warnings.entry(camera.to_string()).or_insert(0) += 1;
                    }
                    bar.suspend(|| table.rows(name, &detections).iter().for_each(|row| printer.line(row)));
                    found += detections.len();
                    done.push(ImageJson::new(image, size, &detections, self.range_m));
                }
                Err(error) => {
                    failed += 1;
                    bar.suspend(|| {
                        printer.failure(&error);
                        self.remove_outputs(name, printer);
                    });
                }
            }
            bar.inc(1);
            if printer.reader_is_gone() && !self.writes_files() {
                break;
            }
        }
        bar.finish_and_clear();
        for (warning, images) in warnings {
            printer.warning(&format!("{warning} ({})", counted(images, "image")));
        }
        self.finish(&done, found, failed, printer)
    }

    fn finish(&self, done: &[ImageJson], found: usize, failed: usize, printer: &mut Printer) -> Result<usize> {
        if done.is_empty() {
            bail!("nothing was done: {} failed", counted(failed, "image"));
        }
        if let Some(path) = &self.args.json {
            range_json::write(path, done)?;
        }
        let failures = if failed > 0 { format!("; {} failed", counted(failed, "image")) } else { String::new() };
        printer.status(&format!("{} found in {}{failures}", counted(found, "object"), counted(done.len(), "image")));
        Ok(failed)
    }

    /// The size of one image, what is in it, and what is odd about its camera, after its files are written.
    fn image(&self, path: &Path, name: &str, pipeline: &mut Pipeline) -> Result<Looked> {
        let image = read_image(path)?;
        let size = [image.width() as usize, image.height() as usize];
        let camera = self.cameras.camera(path, size)?;
        let detections = pipeline.detect(&image, &camera).with_context(|| path.display().to_string())?;
        let detections = bev_nms(detections, self.args.max_overlap);
        if let Some(target) = self.picture_path(name) {
            self.write_picture(&target, &image, &camera, &detections)?;
        }
        if let Some(target) = self.rows_path(name) {
            write_results(&target, &detections)?;
        }
        Ok((image.dimensions(), detections, pipeline.detector().unfamiliar(size, &camera)))
    }

    /// What an earlier run found in an image must not be taken for an answer of this one, in which it failed.
    fn remove_outputs(&self, name: &str, printer: &mut Printer) {
        let outputs = [self.picture_path(name), self.rows_path(name)].into_iter().flatten();
        for path in outputs.filter(|path| path.is_file()) {
            match fs::remove_file(&path) {
                Ok(()) => printer.note(&format!("{}: removed, as its image failed", path.display())),
                Err(error) => {
                    printer.error(&format!("{}: not of this run, cannot be removed: {error}", path.display()));
                }
            }
        }
    }

    fn write_picture(&self, target: &Path, image: &RgbImage, camera: &Camera, detections: &[Detection]) -> Result<()> {
        let options = DrawOptions { distance_m: self.range_m, ..DrawOptions::default() };
        let drawn = picture(image, &Scene { camera, detections, truth: &[] }, &options);
        Ok(write_atomically(target, |out| drawn.write_with_encoder(PngEncoder::new(out)).map_err(io::Error::other))?)
    }
}
