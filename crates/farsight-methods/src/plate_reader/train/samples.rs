//! From labelled frames to crops of vehicles' ends and what the plate reader should answer.

use std::sync::Arc;

use farsight_core::Box3d;
use farsight_data::annotations::Plates;
use farsight_data::{AugmentationConfig, Dataset, DatasetError, Frame, ItemKey, Transform};
use rand::Rng;
use tch::{Device, Tensor};

use super::PlateReaderTaskConfig;
use crate::plate_reader::geometry::{INPUT_CHANNELS, PlateCrop, carries_plate};
use crate::refiner::geometry::input_rules;
use crate::roi::train::{BoxErrors, MAX_TRUNCATED, drawn, is_seen, jittered};

/// Errors of the depths are twice those that come: so what is read says little about what was known.
const REFINER_ERRORS: BoxErrors = BoxErrors { depth: 0.1, size: 0.04, center: 0.03, heading_rad: 0.07 };

/// How often each vehicle of a frame is cut out: to read the image takes as long as to learn from several crops.
const CROPS: usize = 2;

/// A vehicle, and the right and the left end of its plate, if the image shows it.
#[derive(Debug, Clone, Copy)]
struct Vehicle {
    box3d: Box3d,
    plate: Option<[[f64; 3]; 2]>,
}

impl Vehicle {
    /// What is seen in the mirror image.
    fn mirrored(&self) -> Self {
        let flipped = |[x, y, z]: [f64; 3]| [-x, y, z];
        Self { box3d: self.box3d.mirrored(), plate: self.plate.map(|[right, left]| [flipped(left), flipped(right)]) }
    }
}

/// One end of a vehicle as the reader sees it.
#[derive(Debug)]
struct PlateSample {
    /// `[3, side, side]`.
    input: Vec<f32>,
    /// Left and right end of the plate and its height in the crop, sides of that from its middle; no numbers where the
    /// plate is not seen.
    place: [f32; 3],
    /// By what factor the plate is wider than expected, as the network says it.
    wider: f32,
}

/// What is learnt from a frame.
#[derive(Debug)]
pub struct FramePlates {
    /// Name of the frame.
    pub(super) id: String,
    samples: Vec<PlateSample>,
}

/// Makes the samples of a frame. Shared by the loader's threads.
#[derive(Debug)]
pub(super) struct PlateMaker {
    pub(super) source: Arc<dyn Dataset>,
    pub(super) augmentation: AugmentationConfig,
    pub(super) task: PlateReaderTaskConfig,
    pub(super) side: usize,
}

impl PlateMaker {
    /// The samples of the frame that `key` stands for; the same whenever and wherever they are asked for.
    pub(super) fn samples(&self, key: ItemKey) -> Result<FramePlates, DatasetError> {
        let frame = self.source.item(key)?;
        let mut rng = key.rng();
        let labels = frame.labels.iter().enumerate();
        let labels = labels.filter(|(_, label)| {
            carries_plate(&label.class) && is_seen(label, self.task.least_height_px, MAX_TRUNCATED)
        });
        let plates = frame.annotation::<Plates>().map_or(&[][..], |Plates(plates)| plates);
        let vehicles = labels.map(|(place, label)| {
            let plate = plates.iter().find(|plate| plate.label == place).map(|plate| plate.ends);
            Vehicle { box3d: label.box3d, plate }
        });
        let (shown, hidden): (Vec<Vehicle>, Vec<Vehicle>) = vehicles.partition(|vehicle| vehicle.plate.is_some());
        let vehicles = [
            drawn(shown, self.task.objects_per_frame, &mut rng),
            drawn(hidden, self.task.hidden_plates_per_frame, &mut rng),
        ];
        let crops = vehicles.into_iter().flatten().flat_map(|vehicle| [vehicle; CROPS]);
        let samples = crops.filter_map(|vehicle| self.sample(&frame, vehicle, &mut rng)).collect();
        Ok(FramePlates { id: frame.id.clone(), samples })
    }

    /// The end of `vehicle` cut out where an earlier look with errors would have it.
    fn sample(&self, frame: &Frame, vehicle: Vehicle, rng: &mut impl Rng) -> Option<PlateSample> {
        let image_size = [frame.image.width(), frame.image.height()].map(|side| side as usize);
        let rules = input_rules(self.side);
        let drawn = self.augmentation.draw(rng, image_size, &rules);
        let camera = if drawn.mirror { frame.camera.mirrored(image_size[0]) } else { frame.camera };
        let Vehicle { box3d, plate } = if drawn.mirror { vehicle.mirrored() } else { vehicle };
        let expected = jittered(&box3d, &camera, &REFINER_ERRORS, rng)?;
        let crop = PlateCrop::of(&expected, &camera, image_size, self.side)?;
        let place = match plate {
            Some([right, left]) => {
                let ([right, right_down], [left, left_down]) =
                    (crop.image_position(right)?, crop.image_position(left)?);
                [left, right, f64::midpoint(right_down, left_down)].map(|at| at as f32)
            }
            None => [f32::NAN; 3],
        };
        let input = Transform { window: crop.window, ..drawn }.input(&frame.image, &rules);
        Some(PlateSample { input, place, wider: crop.encode(box3d.depth_m()) as f32 })
    }
}

/// What a step learns from.
#[derive(Debug)]
pub struct PlateBatch {
    /// `[vehicles, 3, side, side]`.
    pub(super) input: Tensor,
    /// Left and right end and height of the plates, `[vehicles, 3]`; no numbers where they are not seen.
    pub(super) places: Tensor,
    /// By what factor they are wider than expected, `[vehicles]`.
    pub(super) wider: Tensor,
}

impl PlateBatch {
    /// What `frames` teach; none without a vehicle.
    pub(super) fn new(frames: &[FramePlates], side: usize, device: Device) -> Option<Self> {
        let samples: Vec<&PlateSample> = frames.iter().flat_map(|frame| &frame.samples).collect();
        if samples.is_empty() {
            return None;
        }
        let shape = [INPUT_CHANNELS as i64, side as i64, side as i64];
        let inputs: Vec<Tensor> = samples.iter().map(|sample| Tensor::from_slice(&sample.input).view(shape)).collect();
        let places: Vec<[f32; 3]> = samples.iter().map(|sample| sample.place).collect();
        let wider: Vec<f32> = samples.iter().map(|sample| sample.wider).collect();
        Some(Self {
            input: Tensor::stack(&inputs, 0).to_device(device),
            places: Tensor::from_slice(places.as_flattened()).view([-1, 3]).to_device(device),
            wider: Tensor::from_slice(&wider).to_device(device),
        })
    }
}
