//! Number plates as yardsticks ([`crate::plate_reader::geometry`]).

use crate::plate_reader::PlateReaderConfig;
use crate::plate_reader::geometry::{ANSWER_CHANNELS, INPUT_CHANNELS, PlateCrop, carries_plate, mean_answer, measured};
use crate::refiner::geometry::input_rules;
use farsight_core::{Camera, Detection, MeasuredDepth};
use farsight_data::network_input_into;
use farsight_runtime::EngineError;
use image::RgbImage;

use crate::roi::RoiRunner;
use crate::roi::runner::BATCH;

/// Measures vehicles by their number plates.
pub struct PlateReader {
    network: RoiRunner,
    config: PlateReaderConfig,
    /// The input, kept from call to call.
    input: Vec<f32>,
}

impl PlateReader {
    /// The network of `config`, which `network` runs.
    pub fn new(network: RoiRunner, config: PlateReaderConfig) -> Self {
        Self { network, config, input: Vec::new() }
    }

    /// The same for another thread; weights are shared where the engine can.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn share(&self) -> Result<Self, EngineError> {
        Ok(Self::new(self.network.share()?, self.config.clone()))
    }

    /// `detections` in `image`, taken by `camera`, at the distances that their plates tell, where those can be read and
    /// the detections have error bars.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn measured(
        &mut self,
        image: &RgbImage,
        camera: &Camera,
        detections: Vec<Detection>,
    ) -> Result<Vec<Detection>, EngineError> {
        let readings = self.read_plates(image, camera, &detections)?;
        let moved = |(known, reading): (Detection, Option<MeasuredDepth>)| match reading {
            Some(reading) => measured(known, reading, &self.config.depths),
            None => known,
        };
        Ok(detections.into_iter().zip(readings).map(moved).collect())
    }

    /// The depths that the plates alone tell; `None` of what carries none that the camera could see.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn read_plates(
        &mut self,
        image: &RgbImage,
        camera: &Camera,
        detections: &[Detection],
    ) -> Result<Vec<Option<MeasuredDepth>>, EngineError> {
        let image_size = [image.width(), image.height()].map(|side| side as usize);
        let crop = |detection: &Detection| {
            let crop = || PlateCrop::of(&detection.box3d, camera, image_size, self.config.side);
            carries_plate(&detection.class).then(crop).flatten()
        };
        let crops: Vec<Option<PlateCrop>> = detections.iter().map(crop).collect();
        let there: Vec<PlateCrop> = crops.iter().copied().flatten().collect();
        let mut read = Vec::with_capacity(there.len());
        for batch in there.chunks(BATCH) {
            let answers = self.answers(image, batch)?;
            read.extend(batch.iter().zip(answers).map(|(crop, answer)| crop.decode(answer)));
        }
        let mut read = read.into_iter();
        Ok(crops.iter().map(|crop| crop.and_then(|_| read.next())).collect())
    }

    /// The network's answers for some cut-outs: of each the mean for it and for its mirror image.
    fn answers(&mut self, image: &RgbImage, crops: &[PlateCrop]) -> Result<Vec<[f64; ANSWER_CHANNELS]>, EngineError> {
        let side = self.config.side;
        self.input.clear();
        let mut pixels = Vec::new();
        for crop in crops {
            network_input_into(&mut pixels, image, &crop.window, &input_rules(side), None);
            self.input.extend_from_slice(&pixels);
            pixels.chunks_exact_mut(side).for_each(<[f32]>::reverse);
            self.input.extend_from_slice(&pixels);
        }
        let answers = self.network.answers::<ANSWER_CHANNELS>(&self.input, INPUT_CHANNELS, side)?;
        Ok(answers.chunks_exact(2).map(|pair| mean_answer(pair[0], pair[1], side)).collect())
    }
}
