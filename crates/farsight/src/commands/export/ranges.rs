//! `farsight export --int8 --half`: the ranges of a network's maps, measured on images and kept in its model file.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use farsight::camera_source::{CameraSource, KITTI_HFOV_DEG};
use farsight::detector::open_detector;
use farsight::model_file::{SHIPPED_PLATES, shipped_refiner, with_own};
use farsight::second_stage::refiner;
use farsight::shipped::{self, Family};
use farsight::{Camera, EngineOptions, ModelSource};
use farsight_core::detection::DecodeOptions;
use farsight_data::{Exif, read_image};
use farsight_graph::graph::Role;
use farsight_graph::model::{Model, NetworkConfig};
use farsight_graph::quantize::{RANGES_KEY, StoredRanges, layers_of};
use farsight_graph::transform::Network;
use farsight_methods::Detector;
use farsight_methods::method::{DetectorMethod, ModelTaker};
use farsight_methods::plate_reader::{PlateReader, PlateReaderModel};
use farsight_methods::refiner::{Refiner, RefinerModel};
use farsight_methods::roi::RoiRunner;
use farsight_onnx::{Facts, Target, int8_outputs};
use farsight_runtime::{Calibration, Runner};
use image::RgbImage;

use super::ExportArgs;
use crate::commands::Outcome;
use crate::inputs;
use crate::printer::{Printer, counted, progress_bar};

/// What shows an image to a network as a pipeline does.
type Look = Box<dyn FnMut(&RgbImage, &Camera) -> Result<()>>;

/// What a refiner is shown is what a pipeline with this least score would show it.
const MIN_SCORE: f64 = 0.1;

/// Runs the command.
pub(super) fn run(args: &ExportArgs, printer: &mut Printer) -> Result<Outcome> {
    let path = args.model.as_path();
    let family = shipped_refiner(path);
    if path == Path::new(SHIPPED_PLATES) {
        return measured(&shipped::plates()?, args, printer, |runner, model| plates(runner, model, args));
    }
    if let Some(family) = family {
        let look = |runner, model: &RefinerModel| refiner_behind(runner, model, Path::new(family.name()));
        return measured(&shipped::refiner(family)?, args, printer, look);
    }
    if RefinerModel::is_one(path) {
        let look = |runner, model: &RefinerModel| refiner_behind(runner, model, &args.detector);
        return measured(&RefinerModel::read(path)?, args, printer, look);
    }
    if PlateReaderModel::is_one(path) {
        return measured(&PlateReaderModel::read(path)?, args, printer, |runner, model| plates(runner, model, args));
    }
    with_own(path, Ranges { args, printer })?
}

/// Measures the ranges of a detector.
struct Ranges<'a> {
    args: &'a ExportArgs,
    printer: &'a mut Printer,
}

impl ModelTaker for Ranges<'_> {
    type Answer = Result<Outcome>;

    fn take<C: DetectorMethod>(self, model: Model<C>) -> Result<Outcome> {
        let Self { args, printer } = self;
        let is_one = Network::new(&model).parts(C::OUTPUTS).len() == 1;
        let path = args.model.display();
        ensure!(is_one, "{path}: {}, two networks with a sampler between them; --int8 is for one network", C::NAME);
        measured(&model, args, printer, |runner, model| {
            let whole = model.config.clone().detector(runner, Vec::new(), None);
            Ok(detector(whole.context("a network in one part")?))
        })
    }
}

/// Shows the images to the network of `model` through `look`, and writes its file with the ranges that were seen.
fn measured<C: NetworkConfig>(
    model: &Model<C>,
    args: &ExportArgs,
    printer: &mut Printer,
    look: impl FnOnce(Box<dyn Runner>, &Model<C>) -> Result<Look>,
) -> Result<Outcome> {
    let folder = args.int8.calibration.clone().context("--int8 needs --calibration DIR")?;
    let is_fitted = args.fit_on.is_some() || args.cascade_on.is_some();
    let is_changed = is_fitted || args.average_with.is_some() || args.input.is_some();
    ensure!(
        !is_changed && !args.tells_facts(),
        "--int8 --half measures ranges and changes nothing else of the model; expected --calibration and --out alone beside it"
    );
    let images = Images::find(&folder)?;
    let network = Network::deployable(model)?;
    let layers = layers_of(&network.graph, &int8_outputs::<C>());
    let facts = Facts::new(model, Target::Portable);
    let threads = args.int8.engine.options()?.usable_threads();
    let calibration = Calibration::new(&network, &layers, C::OUTPUTS, &facts, threads)?;
    let mut look = look(Box::new(calibration.try_clone()?), model)?;
    let bar = progress_bar(images.len());
    for index in 0..images.len() {
        let (image, camera) = images.read(index)?;
        look(&image, &camera).with_context(|| images.paths[index].display().to_string())?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let ranges = calibration.ranges(args.int8.observer());
    // The rest of the header stays as it is: numbers that are read and written again may lose their last digit.
    let mut weights = model.weights.clone();
    weights.metadata.insert(RANGES_KEY.to_owned(), StoredRanges::new(&network.graph, &ranges).to_text());
    let unused = model.graph.parameters.iter().filter(|parameter| parameter.role == Role::Unused);
    unused.for_each(|parameter| drop(weights.tensors.remove(&parameter.name)));
    weights.write_half(&args.out)?;
    printer.line(&format!(
        "{}: half-precision numbers, and ranges for 8 bits of {} convolutions, from {} ({})",
        args.out.display(),
        layers.len(),
        counted(images.len(), "image"),
        args.int8.observer_name()
    ));
    Ok(Outcome::Done)
}

/// Images like those that a network will see, and their cameras where the folder has them.
pub(super) struct Images {
    paths: Vec<PathBuf>,
    cameras: Option<CameraSource>,
}

impl Images {
    /// Those in `folder`.
    pub(super) fn find(folder: &Path) -> Result<Self> {
        let found = inputs::find(&[folder.to_owned()]);
        if let Some(problem) = found.problems.first().filter(|_| found.images.is_empty()) {
            bail!("{problem}");
        }
        let cameras = CameraSource::of_layout(&found.images);
        Ok(Self { paths: found.images, cameras })
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.paths.len()
    }

    /// The image at a place, and its camera.
    pub(super) fn read(&self, index: usize) -> Result<(RgbImage, Camera)> {
        let path = &self.paths[index];
        let image = read_image(path)?;
        let size @ [width, height] = [image.width() as usize, image.height() as usize];
        let camera = match &self.cameras {
            Some(cameras) => cameras.camera(path, size, &Exif::NONE)?,
            None => Camera::from_hfov(KITTI_HFOV_DEG, width, height)?,
        };
        Ok((image, camera))
    }
}

fn detector(mut detector: Box<dyn Detector>) -> Look {
    Box::new(move |image, camera| {
        detector.detect_batch(&[(image, camera)], &DecodeOptions::default())?;
        Ok(())
    })
}

/// The refiner of `model` at what the detector called `first` finds.
fn refiner_behind(runner: Box<dyn Runner>, model: &RefinerModel, first: &Path) -> Result<Look> {
    let mut detector = open_detector(&ModelSource::from_word(first), &EngineOptions::default())?;
    let mut refiner = Refiner::new(RoiRunner::new(runner), model.config.clone());
    let options = DecodeOptions { min_score: Some(MIN_SCORE), ..DecodeOptions::default() };
    Ok(Box::new(move |image, camera| {
        let (mut found, _) = detector.detect_batch(&[(image, camera)], &options)?;
        let found = found.pop().unwrap_or_default();
        refiner.refined(image, camera, found, detector.classes(), MIN_SCORE, MIN_SCORE)?;
        Ok(())
    }))
}

/// The plate reader of `model` at what detector and refiner of its family find.
fn plates(runner: Box<dyn Runner>, model: &PlateReaderModel, args: &ExportArgs) -> Result<Look> {
    let engine = EngineOptions::default();
    let mut detector = open_detector(&ModelSource::from_word(&args.detector), &engine)?;
    let mut refiner = refiner(&shipped::refiner(Family::FarsightS)?, &engine)?;
    let mut reader = PlateReader::new(RoiRunner::new(runner), model.config.clone());
    let options = DecodeOptions { min_score: Some(MIN_SCORE), ..DecodeOptions::default() };
    Ok(Box::new(move |image, camera| {
        let (mut found, _) = detector.detect_batch(&[(image, camera)], &options)?;
        let found = found.pop().unwrap_or_default();
        let found = refiner.refined(image, camera, found, detector.classes(), MIN_SCORE, MIN_SCORE)?;
        reader.measured(image, camera, found)?;
        Ok(())
    }))
}
