//! The refiner at what was found ([`crate::refiner::geometry`]).

use crate::refiner::RefinerConfig;
use crate::refiner::geometry::{Crop, INPUT_CHANNELS, OUTPUT_CHANNELS, Refinement, input_rules};
use farsight_core::nms::{class_nms, soft_suppression};
use farsight_core::{Box2d, Camera, ClassReference, Detection, Region, ScalePrior};
use farsight_data::network_input_into;
use farsight_runtime::EngineError;
use image::RgbImage;

use crate::roi::RoiRunner;
use crate::roi::runner::BATCH;

/// The refinement stages: each cuts the object out where the one before it saw it, the last one mirrored, too.
const STAGES: [Flip; 3] = [Flip::Off, Flip::Off, Flip::Averaged];

/// Test-time augmentation by the mirror image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flip {
    /// The cut-out.
    Off,
    /// The cut-out and its mirror image; the answer is the mean of both.
    Averaged,
}

/// What has a score above this share of the least score that counts is looked at again: a further stage can raise it so
/// far.
const PROMISING_SHARE: f64 = 0.2;

/// Refines what a detector found.
pub struct Refiner {
    network: RoiRunner,
    config: RefinerConfig,
    /// The input, kept from call to call.
    input: Vec<f32>,
}

impl Refiner {
    /// The network of `config`, which `network` runs.
    pub fn new(network: RoiRunner, config: RefinerConfig) -> Self {
        Self { network, config, input: Vec::new() }
    }

    /// The same for another thread; weights are shared where the engine can.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn share(&self) -> Result<Self, EngineError> {
        Ok(Self::new(self.network.share()?, self.config.clone()))
    }

    /// Half the widths of the intervals that hold 50 and 90% of the truths, error bars.
    pub fn interval_sigmas(&self) -> [f64; 2] {
        self.config.fusion.depths.interval_sigmas
    }

    /// What the distances of an image's vehicles have in common in a region; none of a region that was not fitted.
    pub fn scale(&self, region: Region) -> Option<ScalePrior> {
        self.config.fusion.scales.get(&region).copied()
    }

    /// What is in `image`, taken by `camera`, after refining each of `candidates`: what has a score above `min_score` then, highest first, each
    /// object once, of one of `classes`.
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
    ) -> Result<Vec<Detection>, EngineError> {
        let image_size = [image.width(), image.height()].map(|side| side as usize);
        let refinements = self.refinements(image, camera, &candidates, PROMISING_SHARE * min_score)?;
        let fused = |(first, second): (Detection, Option<Refinement>)| {
            let fused = self.config.fusion.fused(&first, second.as_ref(), camera, image_size);
            let is_known = classes.iter().any(|known| known.class == fused.class);
            if is_known { fused } else { Detection { class: first.class, ..fused } }
        };
        let mut found: Vec<Detection> = candidates.into_iter().zip(refinements).map(fused).collect();
        // Stable: equals stay in the order of the detector.
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut found = soft_suppression(class_nms(found));
        found.retain(|detection| detection.score > min_score);
        Ok(found)
    }

    /// What the refiner alone says of each detection; `None` where it has no answer.
    ///
    /// Several stages, each where the one before it saw the object: a cut-out around a better box shows more of the
    /// object and less of the rest. What has no score above `promising` after a stage keeps its answer.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn refinements(
        &mut self,
        image: &RgbImage,
        camera: &Camera,
        detections: &[Detection],
        promising: f64,
    ) -> Result<Vec<Option<Refinement>>, EngineError> {
        let image_size = [image.width(), image.height()].map(|side| side as usize);
        let mut refinements: Vec<Option<Refinement>> = vec![None; detections.len()];
        let mut places: Vec<usize> = (0..detections.len()).collect();
        for flip in STAGES {
            let seen = places.iter().map(|&place| {
                let fused =
                    self.config.fusion.fused(&detections[place], refinements[place].as_ref(), camera, image_size);
                (place, fused)
            });
            let is_first = refinements.iter().all(Option::is_none);
            let seen: Vec<(usize, Detection)> = seen.filter(|(_, fused)| is_first || fused.score > promising).collect();
            places = seen.iter().map(|(place, _)| *place).collect();
            let boxes: Vec<Box2d> = seen.into_iter().map(|(_, fused)| fused.box2d).collect();
            for (&place, new) in places.iter().zip(self.refine_boxes(image, camera, &boxes, flip)?) {
                refinements[place] = new.or(refinements[place].take());
            }
        }
        Ok(refinements)
    }

    /// What the network says of cut-outs around `boxes`; `None` where there is nothing to cut out or the answer lies behind the camera.
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
            boxes.iter().map(|box2d| Crop::around(box2d, camera, self.config.side)).collect();
        let there: Vec<Crop> = crops.iter().copied().flatten().collect();
        let mut answers = Vec::with_capacity(there.len());
        for batch in there.chunks(BATCH) {
            answers.extend(self.answers(image, batch, flip)?);
        }
        let mut refinements = there.iter().zip(answers).map(|(crop, answer)| crop.decode(&answer));
        Ok(crops.iter().map(|crop| crop.and_then(|_| refinements.next().flatten())).collect())
    }

    /// The network's answers for some cut-outs.
    fn answers(
        &mut self,
        image: &RgbImage,
        crops: &[Crop],
        flip: Flip,
    ) -> Result<Vec<[f64; OUTPUT_CHANNELS]>, EngineError> {
        let side = self.config.side;
        let rules = input_rules(side);
        self.input.clear();
        let mut pixels = Vec::new();
        for crop in crops {
            network_input_into(&mut pixels, image, &crop.window, &rules, None);
            self.input.extend_from_slice(&pixels);
            self.input.extend(crop.rays());
            if flip == Flip::Averaged {
                pixels.chunks_exact_mut(side).for_each(<[f32]>::reverse);
                self.input.extend_from_slice(&pixels);
                self.input.extend(crop.mirrored().rays());
            }
        }
        let answers = self.network.answers::<OUTPUT_CHANNELS>(&self.input, INPUT_CHANNELS, side)?;
        Ok(match flip {
            Flip::Off => answers,
            Flip::Averaged => {
                let pairs = answers.chunks_exact(2);
                crops.iter().zip(pairs).map(|(crop, pair)| crop.mean_answer(&pair[0], &pair[1])).collect()
            }
        })
    }
}
