//! The refiner at what was found ([`crate::refiner::geometry`]).

use crate::refiner::cascade::ITERATIONS;
use crate::refiner::geometry::{Crop, INPUT_CHANNELS, OUTPUT_CHANNELS, Refinement, input_rules};
use crate::refiner::{Effort, RefinerConfig, ScoreTrace};
use farsight_core::nms::{SAME_OBJECT_OVERLAP, class_nms, soft_suppression};
use farsight_core::{Box2d, Camera, ClassReference, Detection, Region, ScalePrior};
use farsight_data::network_input_in;
use farsight_runtime::EngineError;
use image::RgbImage;

use crate::roi::RoiRunner;
use crate::roi::runner::BATCH;

/// Test-time augmentation by the mirror image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flip {
    /// The cut-out.
    Off,
    /// The cut-out and its mirror image; the answer is the mean of both.
    Averaged,
}

type Answer = [f64; OUTPUT_CHANNELS];

/// A cut-out to look at.
#[derive(Debug, Clone, Copy)]
struct Shot {
    crop: Crop,
    /// The answer for it, where it is known; then only its mirror image is looked at.
    known: Option<Answer>,
    /// Whether the mean with the answer for its mirror image counts.
    mirrored: bool,
}

/// What was seen of an object.
#[derive(Debug, Clone, Copy)]
struct Seen {
    crop: Crop,
    answer: Answer,
    refinement: Refinement,
}

/// Refines what a detector found.
pub struct Refiner {
    network: RoiRunner,
    config: RefinerConfig,
    effort: Effort,
    /// The input, kept from call to call.
    input: Vec<f32>,
}

impl Refiner {
    /// The network of `config`, which `network` runs, with the effort [`Effort::Best`].
    pub fn new(network: RoiRunner, config: RefinerConfig) -> Self {
        Self { network, config, effort: Effort::Best, input: Vec::new() }
    }

    /// The same with another effort.
    #[must_use]
    pub fn with_effort(self, effort: Effort) -> Self {
        Self { effort, ..self }
    }

    /// The same for another thread; weights are shared where the engine can.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn share(&self) -> Result<Self, EngineError> {
        Ok(Self::new(self.network.share()?, self.config.clone()).with_effort(self.effort))
    }

    /// Whether the scores that it gives are probabilities, fitted on labelled frames.
    pub fn is_calibrated(&self) -> bool {
        !self.config.fusion.scores.is_empty()
    }

    /// Half the widths of the intervals that hold 50 and 90% of the truths, error bars.
    pub fn interval_sigmas(&self) -> [f64; 2] {
        self.config.fusion.depths.interval_sigmas
    }

    /// What the distances of an image's vehicles have in common in a region; none of a region that was not fitted.
    pub fn scale(&self, region: Region) -> Option<ScalePrior> {
        self.config.fusion.scales.get(&region).copied()
    }

    /// What is in `image`, taken by `camera`, after refining each of `candidates`: what has a score above `min_score`
    /// then, highest first, each object once, of one of `classes`. What is not likely to reach the score `sought` gets
    /// fewer iterations, or none.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn refined(
        &mut self,
        image: &RgbImage,
        camera: &Camera,
        candidates: Vec<Detection>,
        classes: &[ClassReference],
        min_score: f64,
        sought: f64,
    ) -> Result<Vec<Detection>, EngineError> {
        let image_size = [image.width(), image.height()].map(|side| side as usize);
        let refinements = self.refinements(image, camera, &candidates, sought)?;
        let fused = |(first, second): (Detection, Option<Refinement>)| {
            let fused = self.config.fusion.fused(&first, second.as_ref(), camera, image_size);
            let is_known = classes.iter().any(|known| known.class == fused.class);
            if is_known { fused } else { Detection { class: first.class, ..fused } }
        };
        let mut found: Vec<Detection> = candidates.into_iter().zip(refinements).map(fused).collect();
        // Stable: equals stay in the order of the detector.
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut found = soft_suppression(class_nms(found, SAME_OBJECT_OVERLAP));
        found.retain(|detection| detection.score > min_score);
        Ok(found)
    }

    /// What the refiner alone says of each detection; `None` where it has no answer.
    ///
    /// Several iterations ([`Effort`]), each where the one before it saw the object: a cut-out around a better box
    /// shows more of the object and less of the rest. What is not likely to reach the score `sought` keeps the answer
    /// that it has ([`Cascade`](super::Cascade)).
    ///
    /// # Errors
    /// When the engine fails.
    pub fn refinements(
        &mut self,
        image: &RgbImage,
        camera: &Camera,
        detections: &[Detection],
        sought: f64,
    ) -> Result<Vec<Option<Refinement>>, EngineError> {
        self.iterated(image, camera, detections, sought, |_, _, _| {})
    }

    /// The scores of each detection before each iteration and after the last one: what a [`Cascade`](super::Cascade)
    /// is fitted on.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn score_traces(
        &mut self,
        image: &RgbImage,
        camera: &Camera,
        detections: &[Detection],
    ) -> Result<Vec<ScoreTrace>, EngineError> {
        let image_size = [image.width(), image.height()].map(|side| side as usize);
        let mut traces = vec![ScoreTrace::default(); detections.len()];
        let refinements = self.iterated(image, camera, detections, 0.0, |place, iteration, score| {
            traces[place][iteration] = score;
        })?;
        for ((trace, detection), refinement) in traces.iter_mut().zip(detections).zip(&refinements) {
            trace[ITERATIONS] = self.config.fusion.fused(detection, refinement.as_ref(), camera, image_size).score;
        }
        Ok(traces)
    }

    /// [`Refiner::refinements`]; `tell` hears place, iteration (from 0) and the score before it.
    fn iterated(
        &mut self,
        image: &RgbImage,
        camera: &Camera,
        detections: &[Detection],
        sought: f64,
        mut tell: impl FnMut(usize, usize, f64),
    ) -> Result<Vec<Option<Refinement>>, EngineError> {
        let image_size = [image.width(), image.height()].map(|side| side as usize);
        let least_scores = self.effort.least_scores(&self.config.cascade, sought);
        let mut seen: Vec<Option<Seen>> = vec![None; detections.len()];
        // Objects that are not settled.
        let mut places: Vec<usize> = (0..detections.len()).collect();
        for (iteration, least_score) in least_scores.into_iter().take(self.effort.iterations()).enumerate() {
            let is_last = iteration + 1 == self.effort.iterations();
            let (mut shot_places, mut shots) = (Vec::with_capacity(places.len()), Vec::with_capacity(places.len()));
            places.retain(|&place| {
                let known = seen[place].as_ref().map(|seen| &seen.refinement);
                let fused = self.config.fusion.fused(&detections[place], known, camera, image_size);
                tell(place, iteration, fused.score);
                if fused.score < least_score {
                    return false;
                }
                let Some(crop) = Crop::from_box(&fused.box2d, camera, self.config.side) else { return true };
                let settled = seen[place].filter(|seen| self.is_settled(&seen.crop, &crop));
                let mirrors = self.effort.mirrors();
                let shot = match settled {
                    Some(Seen { crop, answer, .. }) => {
                        mirrors.then_some(Shot { crop, known: Some(answer), mirrored: true })
                    }
                    None => Some(Shot { crop, known: None, mirrored: is_last && mirrors }),
                };
                if let Some(shot) = shot {
                    shot_places.push(place);
                    shots.push(shot);
                }
                settled.is_none()
            });
            let answers = self.answers(image, &shots)?;
            for ((place, Shot { crop, .. }), answer) in shot_places.into_iter().zip(shots).zip(answers) {
                // Where an answer is no place, the one before it stays.
                if let Some(refinement) = crop.decode(&answer) {
                    seen[place] = Some(Seen { crop, answer, refinement });
                }
            }
        }
        Ok(seen.into_iter().map(|seen| Some(seen?.refinement)).collect())
    }

    /// Whether a cut-out shows what the one before it showed.
    fn is_settled(&self, before: &Crop, now: &Crop) -> bool {
        self.effort.settled_within().is_some_and(|share| now.distance(before) <= share)
    }

    /// What the network says of cut-outs around `boxes`; `None` where there is nothing to cut out or the answer lies
    /// behind the camera.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn refine_boxes(
        &mut self,
        image: &RgbImage,
        camera: &Camera,
        boxes: &[Box2d],
        flip: Flip,
    ) -> Result<Vec<Option<Refinement>>, EngineError> {
        let crops: Vec<Option<Crop>> =
            boxes.iter().map(|box2d| Crop::from_box(box2d, camera, self.config.side)).collect();
        let shot = |crop: &Crop| Shot { crop: *crop, known: None, mirrored: flip == Flip::Averaged };
        let shots: Vec<Shot> = crops.iter().flatten().map(shot).collect();
        let mut answers = self.answers(image, &shots)?.into_iter();
        Ok(crops.iter().map(|crop| crop.and_then(|crop| crop.decode(&answers.next()?))).collect())
    }

    /// The network's answers for some cut-outs, one for each.
    fn answers(&mut self, image: &RgbImage, shots: &[Shot]) -> Result<Vec<Answer>, EngineError> {
        let mut answers = Vec::with_capacity(shots.len());
        for batch in shots.chunks(BATCH) {
            self.see(image, batch);
            let raw = self.network.answers::<OUTPUT_CHANNELS>(&self.input, INPUT_CHANNELS, self.config.side)?;
            let mut raw = raw.into_iter();
            answers.extend(batch.iter().filter_map(|Shot { crop, known, mirrored }| {
                let plain = known.or_else(|| raw.next())?;
                if *mirrored { Some(crop.mean_answer(&plain, &raw.next()?)) } else { Some(plain) }
            }));
        }
        Ok(answers)
    }

    /// Writes what the network is to see of some cut-outs to the input.
    fn see(&mut self, image: &RgbImage, shots: &[Shot]) {
        let side = self.config.side;
        let (pixels, look) = (3 * side * side, INPUT_CHANNELS * side * side);
        let looks = |shot: &Shot| usize::from(shot.known.is_none()) + usize::from(shot.mirrored);
        self.input.resize(look * shots.iter().map(looks).sum::<usize>(), 0.0);
        let mut inputs = self.input.as_mut_slice();
        for shot in shots {
            let (own, rest) = inputs.split_at_mut(look * looks(shot));
            inputs = rest;
            network_input_in(&mut own[..pixels], image, &shot.crop.window, &input_rules(side), None);
            if shot.known.is_none() {
                shot.crop.rays_in(&mut own[pixels..look]);
            }
            if shot.mirrored {
                let start = own.len() - look;
                own.copy_within(..pixels, start);
                let mirrored = &mut own[start..];
                mirrored[..pixels].chunks_exact_mut(side).for_each(<[f32]>::reverse);
                shot.crop.mirrored().rays_in(&mut mirrored[pixels..]);
            }
        }
    }
}
