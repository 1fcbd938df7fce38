//! From frames to tracks: pipeline, cameras, scene cuts, ego motion and tracker together.

use std::fmt;

use farsight_core::road::Road;
use farsight_core::{Box2d, Detection};
use farsight_track::{EgoMotion, Frame, Track, Tracker, TrackerOptions};

use super::ego::EgoFile;
use super::ego_height::EgoHeight;
use super::error::VideoError;
use super::frame_detector::{FrameDetector, size};
use super::scene_cut::SceneCut;
use super::source::{VideoFrame, VideoOptions, VideoSource};
use super::visual_ego::VisualEgo;
use crate::camera_source::CameraSource;
use crate::json::FrameRecord;
use crate::object::{DetectedObject, detections};
use crate::pipeline::Pipeline;
use crate::view::{View, ViewSource};

/// Detections of this share of the score that begins a track may continue one.
const LOW_SHARE: f64 = 0.4;

/// [`low_score`] of the score that begins a track where scores are probabilities.
pub const DEFAULT_LOW_SCORE: f64 = LOW_SHARE * 0.5;

/// The least score that a pipeline is to tell ([`crate::PipelineBuilder::low_score`]) where detections of `birth_score`
/// begin tracks.
pub fn low_score(birth_score: f64) -> f64 {
    LOW_SHARE * birth_score
}

/// Follows what a pipeline finds in the frames of one video. It knows nothing of files, and keeps no frame.
pub struct VideoTracker {
    detector: FrameDetector,
    ego: Option<Ego>,
    tracker: Tracker,
    scene_cut: SceneCut,
    image_size: Option<[usize; 2]>,
    told_ego: bool,
    height_m: Option<[f64; 2]>,
}

/// Where the camera's own motion comes from.
enum Ego {
    File(EgoFile),
    Pictures(Box<VisualEgo>),
}

/// What is known after a frame.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct TrackingResult {
    /// What `farsight track --json` writes of it.
    pub record: FrameRecord,
    /// The tracks of the record, in its order.
    pub tracks: Vec<Track>,
    /// How the camera moves, where that is known.
    pub ego: Option<EgoMotion>,
    /// How the frame was taken.
    pub view: View,
    /// What the user should hear.
    pub warnings: Vec<FrameWarning>,
}

impl TrackingResult {
    /// The tracks as detections, to draw or write them.
    pub fn detections(&self) -> Vec<Detection> {
        self.tracks.iter().map(Track::detection).collect()
    }
}

/// Something that is odd about a frame, and no error.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum FrameWarning {
    /// It has another size than the one before; all tracks begin anew.
    Size {
        /// The frame.
        place: String,
        /// Width and height before it, pixels.
        before: [usize; 2],
        /// Its width and height, pixels.
        now: [usize; 2],
        /// Whether the same calibration was taken for both.
        same_camera: bool,
    },
    /// The camera's motion is not known at its time, for the first time.
    NoEgo {
        /// The frame.
        place: String,
        /// Its time, seconds.
        time_s: f64,
    },
}

impl fmt::Display for FrameWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size { place, before: [width, height], now: [new_width, new_height], same_camera } => {
                let camera = if *same_camera { ", with the same calibration" } else { "" };
                write!(
                    f,
                    "{place}: {new_width}x{new_height} pixels after {width}x{height}; all tracks begin anew{camera}"
                )
            }
            Self::NoEgo { place, time_s } => {
                write!(f, "{place}: no ego motion at {time_s:.3} s; its speeds are relative only")
            }
        }
    }
}

impl VideoTracker {
    /// A tracker that has seen nothing. Detections begin tracks from the pipeline's usual score on
    /// ([`Pipeline::default_min_score`]).
    pub fn new(pipeline: Pipeline, views: impl Into<ViewSource>) -> Self {
        let birth_score = pipeline.default_min_score();
        let options = TrackerOptions { birth_score, low_score: low_score(birth_score), ..TrackerOptions::default() };
        Self {
            detector: FrameDetector::new(pipeline, views.into()),
            ego: None,
            tracker: Tracker::new(options),
            scene_cut: SceneCut::default(),
            image_size: None,
            told_ego: false,
            height_m: None,
        }
    }

    /// As it is, with other options of the tracker.
    #[must_use]
    pub fn with_options(mut self, options: TrackerOptions) -> Self {
        self.tracker = Tracker::new(options);
        self
    }

    /// As it is, with the camera's own motion, which gives speeds over the ground.
    #[must_use]
    pub fn with_ego(mut self, ego: EgoFile) -> Self {
        self.ego = Some(Ego::File(ego));
        self
    }

    /// As [`VideoTracker::with_ego`], and the camera is as high above the road as its speed says in the first minute of
    /// `source` ([`EgoHeight`]): where nothing is known of the road, and unless it is a stream.
    ///
    /// # Errors
    /// When ffmpeg cannot be started.
    pub fn with_ego_of_film(
        mut self,
        ego: EgoFile,
        source: &VideoSource,
        options: &VideoOptions,
    ) -> Result<Self, VideoError> {
        let pipeline = self.detector.pipeline();
        let may = pipeline.has_error_bars() && !pipeline.is_road_chosen() && !source.is_live() && !options.realtime;
        if may {
            let view = |frame: &_| self.detector.view(frame).ok().filter(|view| view.road().is_none());
            self.height_m = EgoHeight::of_film(ego.clone(), source, options, view)?.height_m();
        }
        self.height_m = self.height_m.filter(|[height_m, _]| Road::below_by(*height_m).is_some());
        if let Some([height_m, _]) = self.height_m {
            self.detector = self.detector.above_road(height_m);
        }
        Ok(self.with_ego(ego))
    }

    /// Height of the camera above the road and its standard deviation, metres, where its speed tells it
    /// ([`VideoTracker::with_ego_of_film`]).
    pub fn height_m(&self) -> Option<[f64; 2]> {
        self.height_m
    }

    /// As it is, with the camera's own motion estimated from what it sees: the road and the standing world. Scale comes
    /// from the camera's height above the road: that of a calibration with its road ([`View::road`]), or `height_m`.
    /// Without one, as in frames that do not tell, speeds are relative.
    #[must_use]
    pub fn with_visual_ego(mut self, height_m: Option<f64>) -> Self {
        self.ego = Some(Ego::Pictures(Box::new(VisualEgo::new(height_m))));
        self
    }

    /// What looks at the frames. While one frame is followed, other threads may look at the next ones with it.
    pub fn detector(&self) -> &FrameDetector {
        &self.detector
    }

    /// Looks at the next frame and follows what is in it.
    ///
    /// # Errors
    /// When its camera is not known, the pipeline fails, or it is not later than the one before. The tracks are then as
    /// before, and the next frame may follow.
    pub fn update(&mut self, frame: &VideoFrame) -> Result<TrackingResult, VideoError> {
        let view = self.detector.view(frame)?;
        let objects = self.detector.detect(frame, &view)?;
        self.update_with(frame, view, &objects)
    }

    /// As [`VideoTracker::update`], for a frame in which these objects were found already; their boxes are those that
    /// the pinhole of `view` sees ([`View::straightened`]).
    ///
    /// # Errors
    /// When it is not later than the one before. The tracks are then as before.
    pub fn update_with(
        &mut self,
        frame: &VideoFrame,
        view: View,
        objects: &[DetectedObject],
    ) -> Result<TrackingResult, VideoError> {
        let VideoFrame { number, time_s, image, .. } = frame;
        let (mut warnings, image_size) = (Vec::new(), size(image));
        if let Some(before) = self.image_size.replace(image_size).filter(|before| *before != image_size) {
            let same_camera = matches!(self.detector.cameras(), CameraSource::Same(_) | CameraSource::OverRoad(..));
            warnings.push(FrameWarning::Size { place: frame.place(), before, now: image_size, same_camera });
        }
        let looks_cut = self.scene_cut.looks_cut(image);
        let mut detections = detections(objects);
        // What is all outside the image has no box in it.
        detections.retain(|one| one.box2d.width() > 0.0 && one.box2d.height() > 0.0 && one.box3d.depth_m() > 0.0);
        let motion = match &mut self.ego {
            None => None,
            Some(Ego::File(file)) => file.motion(*number, *time_s),
            Some(Ego::Pictures(pictures)) => {
                let boxes: Vec<Box2d> = detections.iter().map(|one| one.box2d).collect();
                pictures.motion(frame, &view, &boxes, looks_cut)
            }
        };
        let (camera, detections) = (view.camera(), &detections);
        let seen = Frame { time_s: *time_s, image_size, camera, detections, ego: motion, looks_cut };
        let tracks = self.tracker.update(&seen);
        let mut tracks = tracks.map_err(|source| VideoError::Track { place: frame.place(), source })?;
        for track in &mut tracks {
            track.box2d = view.shown(&track.box2d);
        }
        if matches!(self.ego, Some(Ego::File(_))) && motion.is_none() && !self.told_ego {
            self.told_ego = true;
            warnings.push(FrameWarning::NoEgo { place: frame.place(), time_s: *time_s });
        }
        let record = FrameRecord::new(*number, *time_s, &tracks, motion.as_ref());
        Ok(TrackingResult { record, tracks, ego: motion, view, warnings })
    }
}
