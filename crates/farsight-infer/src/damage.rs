//! What a change of a network does to its answers, in terms of what is read from them: scores and distances at the peaks.

use std::path::Path;

use farsight_core::codec::Regression;
use farsight_core::detection::raw_regression;
use farsight_core::peaks::{Peak, peaks};
use farsight_core::score::{logistic, logit};
use farsight_core::targets::feature_camera;
use farsight_core::{Camera, Codec, HeadMaps};
use farsight_net::onnx::{OnnxError, OnnxModel, PeaksOnly};
use thiserror::Error;

use crate::{Engine, EngineError, PeaksHead, RtenEngine};

/// Peaks of an image that take part: above this probability, and the highest of them.
const SCORE: f64 = 0.1;
const MOST: usize = 50;

/// A network that cannot be judged.
#[derive(Debug, Error)]
pub enum DamageError {
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The file is not what it says.
    #[error(transparent)]
    Onnx(#[from] OnnxError),
}

/// A network on rten that is asked at single cells.
pub struct Answers {
    engine: RtenEngine,
    head: Option<PeaksHead>,
    codec: Codec,
}

/// An image, and what a network answers at its peaks.
pub struct Reference {
    input: Vec<f32>,
    size: [usize; 2],
    /// Of the feature map.
    camera: Camera,
    peaks: Vec<(Peak, Answer)>,
}

/// What is read at a cell.
#[derive(Debug, Clone, Copy)]
struct Answer {
    score: f64,
    distance_m: f64,
}

/// How far the answers of two networks are apart, as means over the peaks of the first.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Damage {
    /// Change of the distance, as a share of it.
    pub distance: f64,
    /// Change of the score.
    pub score: f64,
    /// How many peaks there are.
    pub peaks: usize,
}

impl Damage {
    /// One number to rank by: both are shares.
    pub fn total(&self) -> f64 {
        self.distance + self.score
    }
}

impl Answers {
    /// Loads `model`, to be run by so many threads; `None` takes one for each core. `source` is only what errors call it.
    ///
    /// # Errors
    /// When rten cannot load it, or its metadata are wrong about its regression head.
    pub fn new(model: &OnnxModel, source: &Path, threads: Option<usize>) -> Result<Self, DamageError> {
        let codec = model.config().codec();
        let (engine, head) = match PeaksOnly::new(model, source)? {
            Some(cut) => {
                let head = PeaksHead::new(&cut);
                (RtenEngine::new(cut.model, threads)?, Some(head))
            }
            None => (RtenEngine::new(model.clone(), threads)?, None),
        };
        Ok(Self { engine, head, codec })
    }

    /// What this network answers for an image: `input` as for [`Engine::head_maps`], seen by `input_camera`.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn reference(
        &mut self,
        input: Vec<f32>,
        size: [usize; 2],
        input_camera: Camera,
    ) -> Result<Reference, DamageError> {
        let maps = self.engine.head_maps(&input, size)?;
        let peaks = peaks(&maps.logits, maps.map_size, MOST, logit(SCORE) as f32);
        let camera = feature_camera(&input_camera);
        let peaks = peaks.into_iter().map(|peak| (peak, self.answer(&maps, &peak, &camera))).collect();
        Ok(Reference { input, size, camera, peaks })
    }

    /// How far this network's answers are from the `references`.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn damage(&mut self, references: &[Reference]) -> Result<Damage, DamageError> {
        let mut sum = Damage::default();
        for Reference { input, size, camera, peaks } in references {
            let maps = self.engine.head_maps(input, *size)?;
            for (peak, expected) in peaks {
                let found = self.answer(&maps, peak, camera);
                sum.distance += (found.distance_m / expected.distance_m - 1.0).abs();
                sum.score += (found.score - expected.score).abs();
            }
            sum.peaks += peaks.len();
        }
        let peaks = sum.peaks.max(1) as f64;
        Ok(Damage { distance: sum.distance / peaks, score: sum.score / peaks, ..sum })
    }

    /// What `maps` say at `peak`'s cell.
    fn answer(&self, maps: &HeadMaps, peak: &Peak, camera: &Camera) -> Answer {
        let [width, height] = maps.map_size;
        let raw = match &self.head {
            Some(head) => head.regression(&maps.regression, maps.map_size, peak.cell),
            None => raw_regression(maps, peak.cell),
        };
        let logit = maps.logits[(peak.class * height + peak.cell[1]) * width + peak.cell[0]];
        let distance_m = self.codec.depth_m(&Regression::from_raw(raw), camera);
        Answer { score: logistic(f64::from(logit)), distance_m }
    }
}

impl Reference {
    /// How many peaks the image has.
    pub fn peak_count(&self) -> usize {
        self.peaks.len()
    }
}
