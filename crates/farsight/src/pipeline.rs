//! From an image and its camera to what is told.

use std::borrow::Cow;
use std::slice;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use farsight_core::box3d::Dimensions;
use farsight_core::road::{HeightConflict, Road};
use farsight_core::{Box3d, Camera, Detection, ObjectClass, ScalePrior};
use farsight_data::denoised;
use farsight_methods::{DetectError, UnfamiliarCamera};
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, StageTimes};
use image::RgbImage;

use crate::object::{DetectedObject, RangeKind};
use crate::stages::{Found, Settings, Stages};
use crate::view::View;

/// Which models a pipeline runs.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ModelInfo {
    /// Name of the detector, or its file.
    pub name: String,
    /// SHA-256 of the detector's weights; none where its file does not tell.
    pub weights_sha256: Option<String>,
    /// SHA-256 of the refiner's weights; none without one.
    pub refiner_sha256: Option<String>,
    /// SHA-256 of the plate reader's weights; none without one.
    pub plates_sha256: Option<String>,
}

/// Images that are taken to look down or up by what is seen in them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenPitches {
    /// How many.
    pub images: usize,
    /// The least and the most that one looks down, degrees; negative ones look up.
    pub least_deg: f64,
    /// The most.
    pub most_deg: f64,
}

/// Models ready to run on images: detector, second stages, suppression, road.
///
/// A clone is the same pipeline. Several threads may use it at once: each gets networks of its own, which share their
/// weights on every engine but ONNX Runtime.
#[derive(Clone)]
pub struct Pipeline {
    shared: Arc<Shared>,
}

struct Shared {
    settings: Settings,
    info: ModelInfo,
    disabled_stages: Vec<&'static str>,
    engine: String,
    has_error_bars: bool,
    /// Half the widths of the intervals that hold 50 and 90%, error bars.
    interval_sigmas: [f64; 2],
    /// What never runs: the networks of further threads are shared from it, and it knows the detector.
    template: Mutex<Stages>,
    /// Networks that no thread uses now.
    idle: Mutex<Vec<Stages>>,
    /// How many images contradict the height that was given, and the surest of them.
    doubt: Mutex<Option<(usize, HeightConflict)>>,
    pitches: Mutex<Option<SeenPitches>>,
}

impl Pipeline {
    pub(crate) fn new(
        stages: Stages,
        settings: Settings,
        info: ModelInfo,
        disabled_stages: Vec<&'static str>,
    ) -> Result<Self, EngineError> {
        let (engine, has_error_bars) = (stages.detector.engine().to_owned(), stages.has_error_bars());
        let interval_sigmas = stages.interval_sigmas();
        let template = Mutex::new(stages.share()?);
        let idle = Mutex::new(vec![stages]);
        Ok(Self {
            shared: Arc::new(Shared {
                settings,
                info,
                disabled_stages,
                engine,
                has_error_bars,
                interval_sigmas,
                template,
                idle,
                doubt: Mutex::default(),
                pitches: Mutex::default(),
            }),
        })
    }

    /// What is in `image`, taken by `camera`; highest score first.
    ///
    /// # Errors
    /// When the image has no pixels, the engine fails, or its answer does not fit the model.
    pub fn detect(&self, image: &RgbImage, camera: &Camera) -> Result<Vec<DetectedObject>, DetectError> {
        let (mut answers, _) = self.detect_batch(&[(image, camera)])?;
        Ok(answers.pop().unwrap_or_default())
    }

    /// [`Pipeline::detect`] for an image of which more is known, and the time of each stage. The networks see it as a
    /// pinhole would have taken it; boxes in the image are where `image` shows the objects. They stand on the road that
    /// `view` knows, unless the builder was told of another and if there are error bars.
    ///
    /// # Errors
    /// As [`Pipeline::detect`], and when `image` has another size than the one that `view` was made for.
    pub fn detect_view(&self, image: &RgbImage, view: &View) -> Result<(Vec<DetectedObject>, StageTimes), DetectError> {
        let (mut objects, times) = self.detect_straightened(image, view)?;
        for object in &mut objects {
            object.box2d = view.shown(&object.box2d);
        }
        Ok((objects, times))
    }

    /// [`Pipeline::detect_view`] with boxes where the pinhole sees the objects.
    pub(crate) fn detect_straightened(
        &self,
        image: &RgbImage,
        view: &View,
    ) -> Result<(Vec<DetectedObject>, StageTimes), DetectError> {
        let settings = self.shared.settings.of_view(view);
        let (mut answers, times) = self.straightened(&[(image, view)], &settings)?;
        Ok((answers.pop().unwrap_or_default(), times))
    }

    fn straightened(
        &self,
        images: &[(&RgbImage, &View)],
        settings: &Settings,
    ) -> Result<(Vec<Vec<DetectedObject>>, StageTimes), DetectError> {
        let straight = || images.iter().map(|(image, view)| view.straightened(image)).collect::<Result<Vec<_>, _>>();
        let (straight, straightening) = timed(straight);
        let straight = straight?;
        let cameras = images.iter().map(|(_, view)| view.camera());
        let seen: Vec<(&RgbImage, &Camera)> = straight.iter().map(|image| &**image).zip(cameras).collect();
        let (answers, times) = self.objects(&seen, settings)?;
        Ok((answers, StageTimes { warp: times.warp + straightening, ..times }))
    }

    /// [`Pipeline::detect_view`] for several images: an answer for each, in their order, and its share of the time. The
    /// engine sees those together that need inputs of one size and stand over the same road.
    pub fn detect_views(
        &self,
        images: &[(&RgbImage, &View)],
    ) -> Vec<Result<(Vec<DetectedObject>, StageTimes), DetectError>> {
        let mut groups: Vec<([usize; 2], Settings, Vec<usize>)> = Vec::new();
        for (place, (image, view)) in images.iter().enumerate() {
            let size = self.input_size([image.width() as usize, image.height() as usize], view.camera());
            let settings = self.shared.settings.of_view(view);
            match groups.iter_mut().find(|group| (group.0, group.1) == (size, settings)) {
                Some((.., places)) => places.push(place),
                None => groups.push((size, settings, vec![place])),
            }
        }
        let mut answers = Vec::new();
        for (_, settings, places) in groups {
            let group: Vec<(&RgbImage, &View)> = places.iter().map(|place| images[*place]).collect();
            answers.extend(places.into_iter().zip(self.seen_together(&group, &settings)));
        }
        answers.sort_by_key(|(place, _)| *place);
        answers.into_iter().map(|(_, answer)| answer).collect()
    }

    /// An answer for each; after an error each is seen alone, so that it is told of the image that it is about.
    fn seen_together(
        &self,
        images: &[(&RgbImage, &View)],
        settings: &Settings,
    ) -> Vec<Result<(Vec<DetectedObject>, StageTimes), DetectError>> {
        match self.straightened(images, settings) {
            Ok((answers, times)) => {
                let share = times.divided(images.len());
                let answers = answers.into_iter().zip(images).map(|(mut objects, (_, view))| {
                    for object in &mut objects {
                        object.box2d = view.shown(&object.box2d);
                    }
                    Ok((objects, share))
                });
                answers.collect()
            }
            Err(_) if images.len() > 1 => {
                images.iter().flat_map(|image| self.seen_together(slice::from_ref(image), settings)).collect()
            }
            Err(error) => vec![Err(error)],
        }
    }

    /// [`Pipeline::detect`] for several images that the detector's engine sees together, and the time of each stage for
    /// all of them. They must need inputs of one size ([`Pipeline::input_size`]).
    ///
    /// # Errors
    /// As [`Pipeline::detect`], and when the sizes differ.
    pub fn detect_batch(
        &self,
        images: &[(&RgbImage, &Camera)],
    ) -> Result<(Vec<Vec<DetectedObject>>, StageTimes), DetectError> {
        self.objects(images, &self.shared.settings)
    }

    fn objects(
        &self,
        images: &[(&RgbImage, &Camera)],
        settings: &Settings,
    ) -> Result<(Vec<Vec<DetectedObject>>, StageTimes), DetectError> {
        let (answers, times) = self.detections(images, settings)?;
        let objects = |Found { detections, pitch_rad }| {
            let object = |one| DetectedObject::new(one, settings.range, self.shared.interval_sigmas);
            detections.into_iter().map(|one| object(one).with_pitch(pitch_rad)).collect()
        };
        Ok((answers.into_iter().map(objects).collect(), times))
    }

    /// What is found before it is put onto a road, with error bars that leave out what all vehicles share
    /// ([`Pipeline::scale`]); for what looks at many images at once, such as [`farsight_core::road::RoadPlane::of`].
    ///
    /// # Errors
    /// As [`Pipeline::detect`].
    pub fn detect_off_road(&self, image: &RgbImage, camera: &Camera) -> Result<Vec<Detection>, DetectError> {
        let settings = Settings { road: Road::Ignored, scale: ScalePrior::default(), ..self.shared.settings };
        let (mut answers, _) = self.detections(&[(image, camera)], &settings)?;
        Ok(answers.pop().unwrap_or_default().detections)
    }

    fn detections(
        &self,
        images: &[(&RgbImage, &Camera)],
        settings: &Settings,
    ) -> Result<(Vec<Found>, StageTimes), DetectError> {
        let smooth = |image| if settings.denoise { denoised(image) } else { Cow::Borrowed(image) };
        let (smooth, smoothing) = timed(|| images.iter().map(|(image, _)| smooth(image)).collect::<Vec<_>>());
        let images: Vec<(&RgbImage, &Camera)> =
            smooth.iter().zip(images).map(|(image, (_, camera))| (&**image, *camera)).collect();
        let mut stages = self.shared.stages()?;
        // After an error the networks are as good as before: what they keep from run to run is only memory.
        let answer = stages.detect_batch(&images, settings);
        self.shared.keep_height_conflicts(std::mem::take(&mut stages.height_conflicts));
        self.shared.keep_pitches(std::mem::take(&mut stages.pitches_rad));
        locked(&self.shared.idle).push(stages);
        let (answers, times) = answer.map_err(|error| error.of_model(&self.shared.info.name))?;
        answers.iter().try_for_each(|found| check_answer_of_all(&found.detections, &self.shared.info.name))?;
        Ok((answers, StageTimes { warp: times.warp + smoothing, ..times }))
    }

    /// What is known of the factor that the distances of all vehicles share.
    pub fn scale(&self) -> ScalePrior {
        self.shared.settings.scale
    }

    /// Of the images so far, how many contradict the height of the camera that was given, and the one that does so most
    /// surely: vehicles on it would have sizes that none has.
    pub fn height_conflict(&self) -> Option<(usize, HeightConflict)> {
        *locked(&self.shared.doubt)
    }

    /// Of the images so far, those that look down or up by what is seen in them, where nobody said how far.
    pub fn seen_pitches(&self) -> Option<SeenPitches> {
        *locked(&self.shared.pitches)
    }

    /// What is made for the weights that come with the library and was left out for others: second stages and the road,
    /// as far as nothing was said of them.
    pub fn disabled_stages(&self) -> &[&'static str] {
        &self.shared.disabled_stages
    }

    /// What to tell of [`Pipeline::disabled_stages`], if there are any.
    pub fn disabled_stages_note(&self) -> Option<String> {
        let (model, stages) = (&self.shared.info.name, self.disabled_stages().join(", "));
        let note = format!("{model}: not the shipped weights, so without what is made for those: {stages}");
        (!stages.is_empty()).then_some(note)
    }

    /// Which models it runs.
    pub fn info(&self) -> &ModelInfo {
        &self.shared.info
    }

    /// Name of the engine that runs the detector.
    pub fn engine(&self) -> &str {
        &self.shared.engine
    }

    /// Whether it was told what is known of the road, whatever is known of single cameras.
    pub(crate) fn is_road_chosen(&self) -> bool {
        self.shared.settings.is_road_chosen
    }

    /// Which distance it tells.
    pub fn range(&self) -> RangeKind {
        self.shared.settings.range
    }

    /// How many threads use it best at the same time, when there are images for all of them.
    pub fn side_by_side(&self) -> usize {
        self.shared.settings.side_by_side
    }

    /// Whether what it finds has error bars.
    pub fn has_error_bars(&self) -> bool {
        self.shared.has_error_bars
    }

    /// Half the widths of its 50 and 90% intervals, error bars.
    pub fn interval_sigmas(&self) -> [f64; 2] {
        self.shared.interval_sigmas
    }

    /// The classes that it knows.
    pub fn classes(&self) -> Vec<ObjectClass> {
        locked(&self.shared.template).detector.classes().iter().map(|known| known.class.clone()).collect()
    }

    /// The score that counts unless another is asked for: 0.5 where scores are probabilities.
    pub fn default_min_score(&self) -> f64 {
        locked(&self.shared.template).default_min_score()
    }

    /// Width and height, pixels, of the network's input for an image of `image_size` taken by `camera`.
    pub fn input_size(&self, image_size: [usize; 2], camera: &Camera) -> [usize; 2] {
        locked(&self.shared.template).detector.input_size(image_size, camera)
    }

    /// What to tell the user of `camera` (of an image of `image_size`), if the model never saw one like it.
    pub fn unfamiliar(&self, image_size: [usize; 2], camera: &Camera) -> Option<UnfamiliarCamera> {
        locked(&self.shared.template).detector.unfamiliar(image_size, camera)
    }
}

impl Shared {
    /// Networks for this thread: idle ones, or new sharers of the same weights.
    fn stages(&self) -> Result<Stages, EngineError> {
        let idle = locked(&self.idle).pop();
        idle.map_or_else(|| locked(&self.template).share(), Ok)
    }

    fn keep_pitches(&self, pitches_rad: Vec<f64>) {
        let mut kept = locked(&self.pitches);
        for degrees in pitches_rad.into_iter().map(f64::to_degrees) {
            let before = kept.unwrap_or(SeenPitches { images: 0, least_deg: degrees, most_deg: degrees });
            *kept = Some(SeenPitches {
                images: before.images + 1,
                least_deg: before.least_deg.min(degrees),
                most_deg: before.most_deg.max(degrees),
            });
        }
    }

    fn keep_height_conflicts(&self, doubts: Vec<HeightConflict>) {
        let mut kept = locked(&self.doubt);
        for doubt in doubts {
            let (images, surest) = kept.unwrap_or((0, doubt));
            let is_surer = doubt.seen_m[1] < surest.seen_m[1];
            *kept = Some((images + 1, if is_surer { doubt } else { surest }));
        }
    }
}

/// What is farther away or larger than this, metres, is no answer: cameras see a hundredth of it.
const MAX_ANSWER_M: f64 = 1e6;

fn check_answer_of_all(found: &[Detection], model: &str) -> Result<(), DetectError> {
    found.iter().try_for_each(|one| check_answer(one, model))
}

/// Refuses an answer that no sound network gives.
fn check_answer(found: &Detection, model: &str) -> Result<(), DetectError> {
    let Box3d { location, dimensions: Dimensions { length, height, width }, .. } = found.box3d;
    let dimensions = [length, height, width];
    let numbers = location.iter().chain(&dimensions).chain(&found.range_sigma_m).chain([&found.score]);
    if numbers.into_iter().all(|number| number.abs() <= MAX_ANSWER_M) {
        return Ok(());
    }
    Err(DetectError::Absurd {
        model: model.to_owned(),
        class: found.class.clone(),
        location,
        dimensions,
        limit: MAX_ANSWER_M,
    })
}

/// What the lock guards; nothing that a panic could leave half done is done under it.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
