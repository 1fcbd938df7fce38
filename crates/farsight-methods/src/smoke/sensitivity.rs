//! What a change of a network does to its answers, in terms of what is read from them: scores and distances at the
//! peaks.

use std::path::Path;

use farsight_core::Camera;
use farsight_core::peaks::{Peak, peaks};
use farsight_core::score::{logistic, logit};
use farsight_onnx::{INPUT, LocalHeadFile, OnnxError};
use farsight_runtime::{EngineError, RtenRunner, Runner, TensorView};
use thiserror::Error;

use super::codec::Regression;
use super::decode::raw_regression;
use super::network::{LOGITS, REGRESSION};
use super::targets::feature_camera;
use super::{Codec, DetectorFile, HeadMaps, SparseHead};

/// Peaks of an image that take part: above this probability, and the highest of them.
const SCORE: f64 = 0.1;
const MOST: usize = 50;

/// A network that cannot be judged.
#[derive(Debug, Error)]
pub enum SensitivityError {
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The file is not what it says.
    #[error(transparent)]
    Onnx(#[from] OnnxError),
}

/// A network on rten that is asked at single cells.
pub struct Answers {
    runner: RtenRunner,
    head: Option<SparseHead>,
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
pub struct Sensitivity {
    /// Change of the distance, as a share of it.
    pub distance: f64,
    /// Change of the score.
    pub score: f64,
    /// How many peaks there are.
    pub peaks: usize,
}

impl Sensitivity {
    /// One number to rank by: both are shares.
    pub fn total(&self) -> f64 {
        self.distance + self.score
    }
}

impl Answers {
    /// Loads `model`, to be run by so many threads; `None` takes one for each core. `source` is only what errors call
    /// it.
    ///
    /// # Errors
    /// When rten cannot load it, or its metadata are wrong about its regression head.
    pub fn new(model: &DetectorFile, source: &Path, threads: Option<usize>) -> Result<Self, SensitivityError> {
        let codec = model.config.codec();
        let (runner, head) = match LocalHeadFile::new(&model.onnx, REGRESSION, source)? {
            Some(cut) => {
                let head = SparseHead::new(&cut);
                (RtenRunner::new(cut.model, threads)?, Some(head))
            }
            None => (RtenRunner::new(model.onnx.clone(), threads)?, None),
        };
        Ok(Self { runner, head, codec })
    }

    /// What this network answers for an image: `input` planar and normalised, seen by `input_camera`.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn reference(
        &mut self,
        input: Vec<f32>,
        size: [usize; 2],
        input_camera: Camera,
    ) -> Result<Reference, SensitivityError> {
        let maps = self.maps(&input, size)?;
        let peaks = peaks(&maps.logits, maps.map_size, MOST, |_| logit(SCORE) as f32);
        let camera = feature_camera(&input_camera);
        let peaks = peaks.into_iter().map(|peak| (peak, self.answer(&maps, &peak, &camera))).collect();
        Ok(Reference { input, size, camera, peaks })
    }

    /// How far this network's answers are from the `references`.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn change(&mut self, references: &[Reference]) -> Result<Sensitivity, SensitivityError> {
        let mut sum = Sensitivity::default();
        for Reference { input, size, camera, peaks } in references {
            let maps = self.maps(input, *size)?;
            for (peak, expected) in peaks {
                let found = self.answer(&maps, peak, camera);
                sum.distance += (found.distance_m / expected.distance_m - 1.0).abs();
                sum.score += (found.score - expected.score).abs();
            }
            sum.peaks += peaks.len();
        }
        let peaks = sum.peaks.max(1) as f64;
        Ok(Sensitivity { distance: sum.distance / peaks, score: sum.score / peaks, ..sum })
    }

    fn maps(&mut self, values: &[f32], [width, height]: [usize; 2]) -> Result<HeadMaps, SensitivityError> {
        let shape = [1, 3, height, width];
        let mut outputs = self.runner.run(&[(INPUT, TensorView { shape: &shape, values })])?;
        let logits = self.runner.outputs().iter().position(|output| output.name == LOGITS).unwrap_or_default();
        let logits = outputs.swap_remove(logits);
        let regression = outputs.pop().ok_or_else(|| EngineError::new(self.runner.engine(), "it gave one output"))?;
        HeadMaps::of_batch(logits, regression)
            .pop()
            .ok_or_else(|| EngineError::new(self.runner.engine(), "it gave no maps").into())
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
