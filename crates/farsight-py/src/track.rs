//! Videos, followed frame by frame.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use farsight::video::{EgoFile, VideoError, VideoFrames, VideoOptions, VideoSource, VideoTracker, low_score};
use farsight::{CameraSource, PipelineBuilder, TrackerOptions};
use pyo3::exceptions::{PyFileNotFoundError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::camera::{ViewArgument, views};
use crate::errors;

/// The score that begins a track, where it must be known before the model is; as for `farsight track`.
const USUAL_MIN_SCORE: f64 = 0.5;

/// Of one frame: the JSON of `farsight track`, pixels, width and height, projection.
type Answer<'py> = (String, Bound<'py, PyBytes>, [u32; 2], [[f64; 4]; 3]);

/// A video being followed.
#[pyclass(frozen, module = "farsight._farsight")]
pub(crate) struct Video {
    state: Mutex<State>,
}

struct State {
    frames: VideoFrames,
    tracker: VideoTracker,
    /// Frames that were followed.
    done: u64,
}

/// What of a video is wanted.
pub(crate) struct Wanted {
    /// A video, or images.
    pub(crate) source: Vec<PathBuf>,
    pub(crate) fps: Option<f64>,
    pub(crate) view: ViewArgument,
    /// A file, or "auto".
    pub(crate) ego: Option<PathBuf>,
    /// Of the camera above the road, metres.
    pub(crate) height_m: Option<f64>,
    pub(crate) min_score: Option<f64>,
    pub(crate) realtime: bool,
    pub(crate) ffmpeg: PathBuf,
}

impl Video {
    /// Begins to follow, with a pipeline of its own: it tells lower scores, which continue tracks.
    pub(crate) fn open(builder: &PipelineBuilder, wanted: Wanted) -> PyResult<Self> {
        let Wanted { source, fps, view, ego, height_m, min_score, realtime, ffmpeg } = wanted;
        let source = source_of(source, fps)?;
        let views = views(view, || CameraSource::of_images(source.images()))?;
        let is_auto = ego.as_deref() == Some(Path::new("auto"));
        let ego = ego.as_deref().filter(|_| !is_auto).map(EgoFile::read).transpose();
        let ego = ego.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let low = low_score(min_score.unwrap_or(USUAL_MIN_SCORE));
        let builder = min_score.into_iter().fold(builder.clone().low_score(low), PipelineBuilder::min_score);
        let pipeline = builder.open().map_err(|error| errors::pipeline(&error))?;
        let birth_score = min_score.unwrap_or_else(|| pipeline.default_min_score());
        let options = TrackerOptions { birth_score, low_score: low.min(birth_score), ..TrackerOptions::default() };
        let tracker = VideoTracker::new(pipeline, views).with_options(options);
        let reading = VideoOptions { ffmpeg, realtime, ..VideoOptions::default() };
        let tracker = match ego {
            Some(ego) => tracker.with_ego_of_film(ego, &source, &reading).map_err(|error| video_error(&error))?,
            None if is_auto => tracker.with_visual_ego(height_m),
            None => tracker,
        };
        let frames = source.frames(&reading).map_err(|error| video_error(&error))?;
        Ok(Self { state: Mutex::new(State { frames, tracker, done: 0 }) })
    }
}

#[pymethods]
impl Video {
    /// The next frame that can be followed, none at the end, and warnings.
    fn next_frame<'py>(&self, py: Python<'py>) -> PyResult<(Option<Answer<'py>>, Vec<String>)> {
        let (followed, warnings) = py.detach(|| {
            let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
            state.next()
        })?;
        let answer = |one: TrackingResult| (one.json, PyBytes::new(py, &one.pixels), one.size, one.projection);
        Ok((followed.map(answer), warnings))
    }

    /// Frames that were left out to keep up.
    #[getter]
    fn dropped(&self, py: Python<'_>) -> u64 {
        py.detach(|| self.state.lock().unwrap_or_else(PoisonError::into_inner).frames.dropped())
    }
}

struct TrackingResult {
    json: String,
    pixels: Vec<u8>,
    size: [u32; 2],
    projection: [[f64; 4]; 3],
}

impl State {
    /// A frame that fails before any was followed ends it; later ones are warned of and left out.
    fn next(&mut self) -> PyResult<(Option<TrackingResult>, Vec<String>)> {
        let mut warnings = Vec::new();
        while let Some(frame) = self.frames.next() {
            let followed = frame.and_then(|frame| Ok((self.tracker.update(&frame)?, frame.image)));
            let (followed, image) = match followed {
                Ok(followed) => followed,
                Err(error) if self.done > 0 => {
                    warnings.push(error.to_string());
                    continue;
                }
                Err(error) => return Err(video_error(&error)),
            };
            self.done += 1;
            warnings.extend(followed.warnings.iter().map(ToString::to_string));
            let json = serde_json::to_string(&followed.record);
            let json = json.map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
            let (size, projection) = ([image.width(), image.height()], followed.view.camera().projection);
            return Ok((Some(TrackingResult { json, pixels: image.into_raw(), size, projection }), warnings));
        }
        Ok((None, warnings))
    }
}

fn source_of(mut paths: Vec<PathBuf>, fps: Option<f64>) -> PyResult<VideoSource> {
    if paths.len() == 1 {
        return VideoSource::open(paths.swap_remove(0), fps).map_err(|error| video_error(&error));
    }
    let Some(fps) = fps.filter(|fps| fps.is_finite() && *fps > 0.0) else {
        return Err(PyValueError::new_err("images have no times; expected fps, their number in a second"));
    };
    Ok(VideoSource::Images { files: paths, fps })
}

fn video_error(error: &VideoError) -> PyErr {
    match error {
        VideoError::CameraSource(error) => errors::camera(error),
        VideoError::NoFfmpeg(_) => PyFileNotFoundError::new_err(error.to_string()),
        VideoError::Ffmpeg { .. } | VideoError::Detect { .. } => PyRuntimeError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}
