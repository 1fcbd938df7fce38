//! From labelled frames to crops and what the refiner should answer.

use std::sync::Arc;

use farsight_core::{Affine2, Box2d, Box3d, Label};
use farsight_data::{AugmentationConfig, Dataset, DatasetError, Frame, ItemKey, Transform};
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt};
use tch::{Device, Tensor};

use super::RefinerTaskConfig;
use super::detected::{self, DetectedBoxes};
use crate::refiner::geometry::{Crop, INPUT_CHANNELS, NOTHING, TARGETS, input_rules, kind_of};
use crate::roi::train::{BoxErrors, drawn, is_seen, jittered};

/// Where no detector was asked, its errors are of this size.
const DETECTOR_ERRORS: BoxErrors = BoxErrors { depth: 0.06, size: 0.06, center: 0.04, heading_rad: 0.15 };

/// What is cut out.
#[derive(Debug, Clone, Copy)]
enum Seen {
    /// An object.
    Object {
        /// Where it is.
        box3d: Box3d,
        /// What it is, if that is told from others.
        kind: Option<usize>,
        /// Where a detector has it, if it is cut out there.
        detected: Option<Box2d>,
    },
    /// Where a detector thought that something is.
    Nothing(Box2d),
}

/// One crop as the refiner sees it.
#[derive(Debug)]
struct CropSample {
    /// `[6, side, side]`.
    input: Vec<f32>,
    /// Where the object is; none of what is nothing.
    targets: Option<[f32; TARGETS]>,
    /// What it is; none where that is not told from others.
    kind: Option<usize>,
}

/// What is learnt from a frame.
#[derive(Debug)]
pub struct FrameCrops {
    /// Name of the frame.
    pub(super) id: String,
    crops: Vec<CropSample>,
}

/// Makes the samples of a frame. Shared by the loader's threads.
#[derive(Debug)]
pub(super) struct CropMaker {
    pub(super) source: Arc<dyn Dataset>,
    pub(super) augmentation: AugmentationConfig,
    pub(super) task: RefinerTaskConfig,
    pub(super) side: usize,
}

impl CropMaker {
    /// The samples of the frame that `key` stands for; the same whenever and wherever they are asked for.
    pub(super) fn samples(&self, key: ItemKey) -> Result<FrameCrops, DatasetError> {
        let frame = self.source.item(key)?;
        let mut rng = key.rng();
        let least_height_px = self.task.least_height_px;
        let DetectedBoxes { of_labels, of_nothing } = match &self.task.detections {
            Some(folder) => DetectedBoxes::read(folder, &frame, least_height_px)?,
            None => DetectedBoxes::none(&frame),
        };
        let labels = frame
            .labels
            .iter()
            .zip(&of_labels)
            .filter(|(label, _)| is_seen(label, least_height_px, self.task.most_truncated));
        let object = |(label, boxes): (&Label, &Vec<Box2d>)| {
            let Label { box3d, ref class, .. } = *label;
            let is_detected = !boxes.is_empty() && rng.random_bool(self.task.detected_share);
            let detected = is_detected.then(|| boxes.choose(&mut rng).copied()).flatten();
            Seen::Object { box3d, kind: kind_of(class), detected }
        };
        let objects = labels.map(object).collect();
        let objects = drawn(objects, self.task.objects_per_frame, &mut rng);
        let nothing = of_nothing.into_iter().map(Seen::Nothing).collect();
        let nothing = drawn(nothing, self.task.false_positives_per_frame, &mut rng);
        let seen = objects.into_iter().chain(nothing);
        let crops = seen.filter_map(|seen| self.sample(&frame, seen, &mut rng)).collect();
        Ok(FrameCrops { id: frame.id.clone(), crops })
    }

    /// What is there, cut out where a detector with errors would see it.
    fn sample(&self, frame: &Frame, seen: Seen, rng: &mut impl Rng) -> Option<CropSample> {
        let (width, height) = frame.image.dimensions();
        let rules = input_rules(self.side);
        let image_size = [width, height].map(|side| side as usize);
        let drawn = self.augmentation.draw(rng, image_size, &rules);
        let camera = if drawn.mirror { frame.camera.mirrored(image_size[0]) } else { frame.camera };
        let mirrored = |box3d: Box3d| if drawn.mirror { box3d.mirrored() } else { box3d };
        let seen_2d = |found: &Box2d, rng: &mut _| {
            let found = detected::jittered(found, rng);
            if drawn.mirror { found.transformed(&Affine2::mirror(image_size[0])) } else { found }
        };
        let (cut_out, targets, kind) = match seen {
            Seen::Object { box3d, kind, detected } => {
                let box3d = mirrored(box3d);
                let cut_out = match detected {
                    Some(found) => seen_2d(&found, rng),
                    None => jittered(&box3d, &camera, &DETECTOR_ERRORS, rng)?.projected(&camera)?,
                };
                (cut_out, Some(box3d), kind)
            }
            Seen::Nothing(found) => (seen_2d(&found, rng), None, Some(NOTHING)),
        };
        let crop = Crop::from_box(&cut_out.clamped(f64::from(width), f64::from(height)), &camera, self.side)?;
        let targets = match targets {
            Some(box3d) => Some(crop.encode(&box3d)?.map(|target| target as f32)),
            None => None,
        };
        let mut input = Transform { window: crop.window, ..drawn }.input(&frame.image, &rules);
        input.extend(crop.rays());
        Some(CropSample { input, targets, kind })
    }
}

/// What a step learns from.
#[derive(Debug)]
pub struct CropBatch {
    /// `[crops, 6, side, side]`.
    pub(super) input: Tensor,
    /// Which crops show objects, and where those are: `[objects]` and `[objects, 8]`.
    pub(super) objects: Tensor,
    pub(super) targets: Tensor,
    /// Of which crops the kind is known, and that: `[known]` each.
    pub(super) known: Tensor,
    pub(super) kinds: Tensor,
}

impl CropBatch {
    /// What `frames` teach; none without an object whose kind is known.
    pub(super) fn new(frames: &[FrameCrops], side: usize, device: Device) -> Option<Self> {
        let samples = || frames.iter().flat_map(|frame| &frame.crops);
        let (objects, targets): (Vec<i64>, Vec<[f32; TARGETS]>) =
            (0..).zip(samples()).filter_map(|(place, sample)| Some((place, sample.targets?))).unzip();
        let (known, kinds): (Vec<i64>, Vec<i64>) =
            (0..).zip(samples()).filter_map(|(place, sample)| Some((place, sample.kind? as i64))).unzip();
        if objects.is_empty() || known.is_empty() {
            return None;
        }
        let shape = [INPUT_CHANNELS as i64, side as i64, side as i64];
        let inputs: Vec<Tensor> = samples().map(|sample| Tensor::from_slice(&sample.input).view(shape)).collect();
        let places = |places: &[i64]| Tensor::from_slice(places).to_device(device);
        Some(Self {
            input: Tensor::stack(&inputs, 0).to_device(device),
            objects: places(&objects),
            targets: Tensor::from_slice(targets.as_flattened()).view([-1, TARGETS as i64]).to_device(device),
            known: places(&known),
            kinds: places(&kinds),
        })
    }
}
