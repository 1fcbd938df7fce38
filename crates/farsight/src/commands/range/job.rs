//! The images of one call, one after the other; what fails is told and the others are still done.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use farsight_core::duplicates::apart;
use farsight_core::{Box3d, Camera, Detection};
use farsight_data::kitti::write_results;
use farsight_data::read_image;
use farsight_files::write_atomically;
use farsight_infer::{Detector, UnfamiliarCamera};
use farsight_viz::{DrawOptions, Scene, picture};
use image::RgbImage;
use image::codecs::png::PngEncoder;
use indicatif::ProgressBar;

use super::RangeArgs;
use crate::camera_source::CameraSource;
use crate::inputs::identity;
use crate::names::output_names;
use crate::printer::Printer;
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
        for folder in [&args.out, &args.kitti].into_iter().flatten() {
            fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        }
        let job = Self { args, images, names, cameras, range_m: args.range.measure() };
        job.check_outputs(printer)?;
        Ok(job)
    }

    /// Pictures must not replace the images they are made from; outputs that were renamed are worth a word.
    fn check_outputs(&self, printer: &mut Printer) -> Result<()> {
        let inputs: Vec<PathBuf> = self.images.iter().map(|image| identity(image)).collect();
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

    /// Looks at every image and returns how many failed.
    ///
    /// An error when none could be done, or the JSON file could not be written.
    pub(super) fn run(&self, detector: &mut Detector, printer: &mut Printer) -> Result<usize> {
        let table = RangeTable::new(&self.names, self.range_m);
        printer.heading(&table.heading());
        let bar = if self.images.len() < MANY_IMAGES {
            ProgressBar::hidden()
        } else {
            ProgressBar::new(self.images.len() as u64)
        };
        let (mut done, mut found, mut warnings) = (Vec::new(), 0, BTreeMap::new());
        for (image, name) in self.images.iter().zip(&self.names) {
            match self.image(image, name, detector) {
                Ok((size, detections, unfamiliar)) => {
                    if let Some(camera) = unfamiliar {
                        *warnings.entry(camera.to_string()).or_insert(0) += 1;
                    }
                    bar.suspend(|| table.rows(name, &detections).iter().for_each(|row| printer.line(row)));
                    found += detections.len();
                    done.push(ImageJson::new(image, size, &detections, self.range_m));
                }
                Err(error) => bar.suspend(|| printer.failure(&error)),
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        for (warning, images) in warnings {
            printer.warning(&format!("{warning} ({})", counted(images, "image")));
        }
        self.finish(&done, found, printer)
    }

    fn finish(&self, done: &[ImageJson], found: usize, printer: &mut Printer) -> Result<usize> {
        let failed = self.images.len() - done.len();
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
    fn image(&self, path: &Path, name: &str, detector: &mut Detector) -> Result<Looked> {
        let image = read_image(path)?;
        let size = [image.width() as usize, image.height() as usize];
        let camera = self.cameras.camera(path, size)?;
        let detections = detector.detect(&image, &camera).with_context(|| path.display().to_string())?;
        let detections = apart(detections, self.args.max_overlap);
        if let Some(target) = self.picture_path(name) {
            self.write_picture(&target, &image, &camera, &detections)?;
        }
        if let Some(folder) = &self.args.kitti {
            write_results(&folder.join(format!("{name}.txt")), &detections)?;
        }
        Ok((image.dimensions(), detections, detector.spec().unfamiliar(size, &camera)))
    }

    fn write_picture(&self, target: &Path, image: &RgbImage, camera: &Camera, detections: &[Detection]) -> Result<()> {
        let options = DrawOptions { distance_m: self.range_m, ..DrawOptions::default() };
        let drawn = picture(image, &Scene { camera, detections, truth: &[] }, &options);
        Ok(write_atomically(target, |out| drawn.write_with_encoder(PngEncoder::new(out)).map_err(io::Error::other))?)
    }
}

/// `1 image`, `2 images`.
fn counted(count: usize, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}
