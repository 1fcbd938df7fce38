//! Choosing what a pipeline is made of.

use std::path::{Path, PathBuf};

use farsight_core::Region;
use farsight_core::detection::DecodeOptions;
use farsight_core::road::Road;
use farsight_methods::Detector;
use farsight_methods::refiner::Effort;

use crate::detector::{self, OpenDetector, Timing};
use crate::object::RangeKind;
use crate::pipeline::{ModelInfo, Pipeline};
use crate::shipped::Family;
use crate::source::{ModelSource, StageSource};
use crate::stages::{Settings, Stages};
use crate::{Device, EngineKind, EngineOptions, Error, Precision, second_stage, shipped};

/// Two vehicles cannot overlap; what is told of them may, by the errors of their distances.
pub const MAX_OVERLAP: f64 = 0.1;

/// Cameras that look farther up or down see roads as no model here knows them, degrees.
pub const PITCHES_DEG: [f64; 2] = [-45.0, 60.0];

/// What errors call the plate reader.
pub const PLATE_READER: &str = "the plate reader";

/// What errors call the road plane.
pub const ROAD: &str = "the road plane";

/// Chooses what a [`Pipeline`] is made of; what is not chosen is as `farsight range` has it.
#[derive(Debug, Clone, Default)]
pub struct PipelineBuilder {
    model: ModelSource,
    engine: EngineOptions,
    second_stage_engine: Option<EngineKind>,
    second_stage_precision: Option<Precision>,
    refiner: StageSource,
    plates: StageSource,
    road: Option<Road>,
    pitch_rad: Option<f64>,
    region: Region,
    decode: DecodeOptions,
    low_score: Option<f64>,
    max_overlap: Option<f64>,
    range: RangeKind,
    timing: Timing,
    images: Option<usize>,
    effort: Effort,
    keeps_noise: bool,
}

impl Pipeline {
    /// The models that come with the library, on the engine that is always there.
    ///
    /// # Errors
    /// When the engine fails, for want of memory for instance.
    pub fn shipped() -> Result<Self, Error> {
        Self::builder().open()
    }

    /// The detector at `path`, a file that `farsight train`, `farsight import` or `farsight export` wrote. With the
    /// shipped weights it gets all that [`Pipeline::shipped`] has.
    ///
    /// # Errors
    /// When the file is no detector, or the engine fails.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        Self::builder().model(ModelSource::from_word(path.as_ref())).open()
    }

    /// Chooses model, engine and stages.
    pub fn builder() -> PipelineBuilder {
        PipelineBuilder::default()
    }
}

impl PipelineBuilder {
    /// The detector; farsight-w by default.
    #[must_use]
    pub fn model(self, model: ModelSource) -> Self {
        Self { model, ..self }
    }

    /// What runs all networks; rten by default.
    #[must_use]
    pub fn engine(mut self, kind: EngineKind) -> Self {
        self.engine.kind = kind;
        self
    }

    /// Engine, library, threads and precision at once.
    #[must_use]
    pub fn engine_options(self, engine: EngineOptions) -> Self {
        Self { engine, ..self }
    }

    /// The engine's shared library, or the folder that it is in; looked for by default.
    #[must_use]
    pub fn engine_library(mut self, library: impl Into<PathBuf>) -> Self {
        self.engine.library = Some(library.into());
        self
    }

    /// Threads of each network; one for each core by default, and at most that.
    #[must_use]
    pub fn threads(mut self, threads: usize) -> Self {
        self.engine.threads = Some(threads);
        self
    }

    /// In which numbers the engine computes; single precision by default.
    #[must_use]
    pub fn precision(mut self, precision: Precision) -> Self {
        self.engine.precision = precision;
        self
    }

    /// Another engine for refiner and plate reader, in single precision unless another is chosen for them; its library
    /// is looked for.
    #[must_use]
    pub fn second_stage_engine(self, kind: EngineKind) -> Self {
        Self { second_stage_engine: Some(kind), ..self }
    }

    /// In which numbers refiner and plate reader compute; by default in those of the detector on its engine.
    #[must_use]
    pub fn second_stage_precision(self, precision: Precision) -> Self {
        Self { second_stage_precision: Some(precision), ..self }
    }

    /// Refines what was found.
    #[must_use]
    pub fn refiner(self, refiner: StageSource) -> Self {
        Self { refiner, ..self }
    }

    /// How much the refiner does for each object; [`Effort::Normal`] by default.
    #[must_use]
    pub fn effort(self, effort: Effort) -> Self {
        Self { effort, ..self }
    }

    /// Whether images with much noise are smoothed before the networks see them ([`farsight_data::denoised`]); they are
    /// by default.
    #[must_use]
    pub fn denoise(self, denoise: bool) -> Self {
        Self { keeps_noise: !denoise, ..self }
    }

    /// What measures vehicles by their number plates.
    #[must_use]
    pub fn plates(self, plates: StageSource) -> Self {
        Self { plates, ..self }
    }

    /// What is known of the road under the camera; by default that there is one for the shipped weights, and nothing
    /// for others.
    #[must_use]
    pub fn road(self, road: Road) -> Self {
        Self { road: Some(road), ..self }
    }

    /// How far down the camera looks, radians: between its optical axis and the road. By default what is seen tells.
    /// For cameras whose calibration says nothing of it, and pipelines with a refiner.
    #[must_use]
    pub fn pitch(self, pitch_rad: f64) -> Self {
        Self { pitch_rad: Some(pitch_rad), ..self }
    }

    /// The part of the world that the images are from, by the sizes of its vehicles; anywhere by default. For a refiner
    /// that was fitted by regions.
    #[must_use]
    pub fn region(self, region: Region) -> Self {
        Self { region, ..self }
    }

    /// What has a lower score is not told; 0.5 by default, 0.25 where scores are no probabilities.
    #[must_use]
    pub fn min_score(mut self, min_score: f64) -> Self {
        self.decode.min_score = Some(min_score);
        self
    }

    /// What has a score from this on is told, too, as far as the work for the [least score](Self::min_score) brings it:
    /// such detections continue tracks, and none is worth a closer look.
    #[must_use]
    pub fn low_score(self, low_score: f64) -> Self {
        Self { low_score: Some(low_score), ..self }
    }

    /// At most so many detections an image, of a model whose scores are no probabilities; 50 by default.
    #[must_use]
    pub fn max_detections(mut self, max_detections: usize) -> Self {
        self.decode.max_detections = max_detections;
        self
    }

    /// Of what overlaps by more than this (intersection over union) as seen from above, the best stays; [`MAX_OVERLAP`]
    /// by default, 1 keeps all.
    #[must_use]
    pub fn max_overlap(self, max_overlap: f64) -> Self {
        Self { max_overlap: Some(max_overlap), ..self }
    }

    /// Which distance is told; the depth by default.
    #[must_use]
    pub fn range(self, range: RangeKind) -> Self {
        Self { range, ..self }
    }

    /// How many images there are, one by default: of many, neighbouring ones are best looked at side by side, by
    /// [`Pipeline::side_by_side`] threads. The answers are the same.
    #[must_use]
    pub fn images(self, images: usize) -> Self {
        Self { images: Some(images), ..self }
    }

    /// Width and height of the network's input, pixels, whatever the model was made for: only the time is right then.
    #[must_use]
    pub fn input_size(mut self, size: [usize; 2]) -> Self {
        self.timing.input = Some(size);
        self
    }

    /// Whether the regression head is computed everywhere, as other programs do, instead of where something is: slower,
    /// the same answers.
    #[must_use]
    pub fn dense_head(mut self, dense: bool) -> Self {
        self.timing.dense_head = dense;
        self
    }

    /// Reads the models and starts the engines.
    ///
    /// # Errors
    /// When a file is no such model, an engine is not there or fails, plates or road are asked for with a model without
    /// error bars, or a region with a refiner that knows none.
    pub fn open(&self) -> Result<Pipeline, Error> {
        let engine = self.engine.clone().for_images(self.images.unwrap_or(1));
        let chosen = Self { engine, ..self.clone() };
        chosen.assembled(detector::open(&chosen.model, &chosen.engine, chosen.timing)?)
    }

    /// A pipeline around a detector of another making; refiner, plate reader and road are used where they are chosen.
    ///
    /// # Errors
    /// As [`PipelineBuilder::open`].
    pub fn open_with(&self, detector: Box<dyn Detector>) -> Result<Pipeline, Error> {
        let name = PathBuf::from(detector.method());
        self.assembled(OpenDetector { detector, name, weights_sha256: None })
    }

    fn assembled(&self, opened: OpenDetector) -> Result<Pipeline, Error> {
        let family = opened.family();
        let is_shipped = family.is_some();
        let second = self.second_engine();
        let refiner =
            second_stage::model(&self.refiner, is_shipped, || shipped::refiner(family.unwrap_or(Family::FarsightS)))?;
        // It takes every plate for a European one.
        let has_plates = family == Some(Family::FarsightS) && self.refiner == StageSource::Default;
        let plates = second_stage::model(&self.plates, has_plates, shipped::plates)?;
        let info = ModelInfo {
            name: opened.name.to_string_lossy().into_owned(),
            weights_sha256: opened.weights_sha256,
            refiner_sha256: refiner.as_ref().map(|model| model.weights.sha256()),
            plates_sha256: plates.as_ref().map(|model| model.weights.sha256()),
        };
        let stages = Stages {
            detector: opened.detector,
            refiner: refiner
                .map(|model| Ok::<_, Error>(second_stage::refiner(&model, &second)?.with_effort(self.effort)))
                .transpose()?,
            plate_reader: plates.map(|model| second_stage::plate_reader(&model, &second)).transpose()?,
            height_conflicts: Vec::new(),
            pitches_rad: Vec::new(),
        };
        let needs_error_bars =
            [(PLATE_READER, self.plates.is_asked_for()), (ROAD, self.road.is_some_and(|road| road != Road::Ignored))];
        if let Some((stage, _)) = needs_error_bars.into_iter().find(|(_, is_asked_for)| *is_asked_for)
            && !stages.has_error_bars()
        {
            return Err(Error::NoErrorBars { model: opened.name, stage });
        }
        let scale = stages.refiner.as_ref().and_then(|refiner| refiner.scale(self.region));
        if scale.is_none() && self.region != Region::World {
            return Err(Error::NoRegions { model: opened.name, region: self.region });
        }
        let usual_road = if is_shipped { Road::Below } else { Road::Ignored };
        let settings = Settings {
            decode: self.decode,
            low_score: self.low_score,
            max_overlap: self.max_overlap.unwrap_or(MAX_OVERLAP),
            road: self.road.unwrap_or(usual_road),
            is_road_chosen: self.road.is_some(),
            pitch_rad: self.pitch_rad,
            scale: scale.unwrap_or_default(),
            range: self.range,
            denoise: !self.keeps_noise,
            side_by_side: self.engine.side_by_side.unwrap_or(1),
        };
        let made_for_shipped = [
            ("refiner", self.refiner == StageSource::Default),
            ("plate reader", self.plates == StageSource::Default),
            ("road plane", self.road.is_none()),
        ];
        let disabled_stages = made_for_shipped.into_iter().filter(|(_, is_unsaid)| *is_unsaid && !is_shipped);
        Ok(Pipeline::new(stages, settings, info, disabled_stages.map(|(stage, _)| stage).collect())?)
    }

    /// The engine of the second stages. A library that is named is that of the detector's engine.
    fn second_engine(&self) -> EngineOptions {
        let engine = match self.second_stage_engine {
            Some(kind) if kind != self.engine.kind => EngineOptions {
                kind,
                library: None,
                precision: Precision::F32,
                device: Device::Cpu,
                ..self.engine.clone()
            },
            _ => self.engine.clone(),
        };
        EngineOptions { precision: self.second_stage_precision.unwrap_or(engine.precision), ..engine }
    }
}
