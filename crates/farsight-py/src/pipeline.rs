//! The pipeline, and its answers.

use std::path::{Path, PathBuf};

use farsight::builder::PITCHES_DEG;
use farsight::{
    CameraSource, CameraSourceError, Device, Effort, EngineKind, EngineOptions, Exif, ImageLimits, LoadedImage,
    ModelSource, PipelineBuilder, Precision, ViewSource, load_image, model_file,
};
use farsight_core::Region;
use farsight_core::road::Road;
use farsight_data::decode_image;
use image::RgbImage;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::camera::{ViewArgument, views};
use crate::errors;
use crate::picture::from_bytes;
use crate::track::{Video, Wanted};

/// More threads than any computer has cores are a mistake.
const MAX_THREADS: usize = 1024;

/// Of one image: the JSON of `farsight range`, the upright pixels, warnings.
type Answer<'py> = (String, Bound<'py, PyBytes>, Vec<String>);

/// A model on an engine.
#[pyclass(frozen, module = "farsight._farsight")]
pub(crate) struct Pipeline {
    inner: farsight::Pipeline,
    /// What there is to tell of the model.
    notes: Vec<String>,
    builder: PipelineBuilder,
    /// Height of the camera above the road, metres, where it is known.
    above_road: Option<f64>,
}

fn no_height(height_m: f64) -> PyErr {
    let [lowest_m, highest_m] = Road::HEIGHTS_M;
    PyValueError::new_err(format!("above_road is {height_m}; expected metres, from {lowest_m} to {highest_m}"))
}

#[pymethods]
impl Pipeline {
    #[new]
    #[allow(clippy::too_many_arguments, reason = "those of Python's class")]
    fn new(
        py: Python<'_>,
        model: PathBuf,
        engine: &str,
        engine_path: Option<PathBuf>,
        precision: &str,
        device: &str,
        threads: Option<usize>,
        region: &str,
        above_road: Option<f64>,
        pitch: Option<f64>,
        effort: &str,
        denoise: bool,
    ) -> PyResult<Self> {
        let options = EngineOptions {
            kind: kind(engine)?,
            library: engine_path,
            threads,
            precision: numbers(precision)?,
            device: place(device)?,
            side_by_side: None,
        };
        if threads.is_some_and(|threads| !(1..=MAX_THREADS).contains(&threads)) {
            return Err(PyValueError::new_err(format!("threads: expected a number from 1 to {MAX_THREADS}")));
        }
        let region: Region =
            region.parse().map_err(|expected| PyValueError::new_err(format!("region {region:?}: {expected}")))?;
        let road =
            above_road.map(|height_m| Road::below_by(height_m).ok_or_else(|| no_height(height_m))).transpose()?;
        if let Some(degrees) = pitch.filter(|degrees| !(PITCHES_DEG[0]..=PITCHES_DEG[1]).contains(degrees)) {
            let [least, most] = PITCHES_DEG;
            return Err(PyValueError::new_err(format!("pitch is {degrees}; expected degrees, from {least} to {most}")));
        }
        let effort = iterations(effort)?;
        let unhashed = model_file::hash_note(&model);
        let builder = farsight::Pipeline::builder().model(ModelSource::from_word(model)).engine_options(options);
        let builder =
            road.into_iter().fold(builder.region(region), PipelineBuilder::road).effort(effort).denoise(denoise);
        let builder = pitch.map(f64::to_radians).into_iter().fold(builder, PipelineBuilder::pitch);
        let inner = py.detach(|| builder.open()).map_err(|error| errors::pipeline(&error))?;
        let notes = unhashed.into_iter().chain(inner.disabled_stages_note()).collect();
        Ok(Self { inner, notes, builder, above_road })
    }

    /// Begins to follow what is in a video, or in images.
    #[allow(clippy::too_many_arguments, reason = "those of Python's method")]
    fn track(
        &self,
        py: Python<'_>,
        source: Vec<PathBuf>,
        fps: Option<f64>,
        view: ViewArgument,
        ego: Option<PathBuf>,
        min_score: Option<f64>,
        realtime: bool,
        ffmpeg: PathBuf,
    ) -> PyResult<Video> {
        let height_m = self.above_road;
        let wanted = Wanted { source, fps, view, ego, height_m, min_score, realtime, ffmpeg };
        py.detach(|| Video::open(&self.builder, wanted))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.inner.info().name
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    #[getter]
    fn classes(&self) -> Vec<String> {
        self.inner.classes().iter().map(ToString::to_string).collect()
    }

    /// Looks at an image file.
    fn range_path<'py>(&self, py: Python<'py>, path: PathBuf, view: ViewArgument) -> PyResult<Answer<'py>> {
        let done = py.detach(|| {
            let image = load_image(&path, ImageLimits::default()).map_err(|error| errors::image(&error))?;
            let views = views(view, || CameraSource::of_images(std::slice::from_ref(&path)))?;
            self.look(&path, image, &views)
        })?;
        Ok(done.answer(py))
    }

    /// Looks at an image file in memory, called `name` in the answer.
    fn range_bytes<'py>(
        &self,
        py: Python<'py>,
        bytes: &[u8],
        name: PathBuf,
        view: ViewArgument,
    ) -> PyResult<Answer<'py>> {
        let views = views(view, || Ok(CameraSource::Exif))?;
        let done = py.detach(|| {
            let image = decode_image(bytes, &name, ImageLimits::default()).map_err(|error| errors::image(&error))?;
            self.look(&name, image, &views)
        })?;
        Ok(done.answer(py))
    }

    /// Looks at pixels, red, green, blue, row by row.
    fn range_pixels<'py>(
        &self,
        py: Python<'py>,
        pixels: &[u8],
        size: [u32; 2],
        name: PathBuf,
        view: ViewArgument,
    ) -> PyResult<Answer<'py>> {
        let views = views(view, || Err(CameraSourceError::Unknown))?;
        let pixels = from_bytes(pixels, size)?;
        let image = LoadedImage { pixels, exif: Exif::NONE, warnings: Vec::new() };
        let done = py.detach(|| self.look(&name, image, &views))?;
        Ok(done.answer(py))
    }
}

/// An image that was looked at.
struct ProcessedImage {
    json: String,
    pixels: RgbImage,
    warnings: Vec<String>,
}

impl ProcessedImage {
    fn answer(self, py: Python<'_>) -> Answer<'_> {
        (self.json, PyBytes::new(py, self.pixels.as_raw()), self.warnings)
    }
}

impl Pipeline {
    fn look(&self, path: &Path, image: LoadedImage, views: &ViewSource) -> PyResult<ProcessedImage> {
        let ranged = self.inner.range_image(path, &image, views).map_err(|error| errors::range(&error))?;
        let json = serde_json::to_string(&ranged.record).map_err(|error| PyValueError::new_err(error.to_string()))?;
        let unfamiliar = ranged.unfamiliar.map(|warning| warning.to_string());
        let LoadedImage { pixels, warnings, .. } = image;
        let odd = warnings.iter().map(|warning| format!("{}: {warning}", path.display()));
        Ok(ProcessedImage { json, pixels, warnings: odd.chain(unfamiliar).collect() })
    }
}

fn kind(name: &str) -> PyResult<EngineKind> {
    EngineKind::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
        PyValueError::new_err(format!("engine: no engine \"{name}\"; expected rten, onnxruntime or openvino"))
    })
}

fn place(name: &str) -> PyResult<Device> {
    Device::ALL.into_iter().find(|device| device.name() == name).ok_or_else(|| {
        PyValueError::new_err(format!("device: no device \"{name}\"; expected cpu, cuda, tensorrt or gpu"))
    })
}

fn iterations(name: &str) -> PyResult<Effort> {
    let told = || format!("effort: no effort \"{name}\"; expected fast, normal or best");
    Effort::ALL.into_iter().find(|effort| effort.name() == name).ok_or_else(|| PyValueError::new_err(told()))
}

fn numbers(name: &str) -> PyResult<Precision> {
    match name {
        "f32" => Ok(Precision::F32),
        "bf16" => Ok(Precision::Bf16),
        "int8" => Ok(Precision::Int8),
        _ => Err(PyValueError::new_err(format!("precision: no precision \"{name}\"; expected f32, bf16 or int8"))),
    }
}
