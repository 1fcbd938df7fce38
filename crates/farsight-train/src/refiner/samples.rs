//! From labelled frames to cut-outs and what the refiner should answer.

use farsight_core::refine::{Crop, INPUT_CHANNELS, TARGETS, input_rules};
use farsight_core::{Box3d, Camera, Dimensions, Label, ObjectClass, wrapped_angle};
use farsight_data::kitti::dataset::DatasetError;
use farsight_data::{AugmentationConfig, Frame, ItemKey, Transform};
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use tch::{Device, Tensor};

use super::config::RefinerTrainConfig;
use crate::sources::FrameSource;

/// Objects of which less is seen are not learnt from.
const MOST_OCCLUDED: i32 = 2;
const MOST_TRUNCATED: f64 = 0.5;

/// Errors of a first look, standard deviations: of the logarithms of depth and sizes, of the centre as a share of the object, and of the heading. The
/// detector's own are of this size.
const DEPTH_ERROR: f64 = 0.06;
const SIZE_ERROR: f64 = 0.06;
const CENTER_ERROR: f64 = 0.04;
const HEADING_ERROR_RAD: f64 = 0.15;

/// One object as the refiner sees it.
#[derive(Debug)]
struct CropSample {
    /// `[6, side, side]`.
    input: Vec<f32>,
    targets: [f32; TARGETS],
}

/// What a frame teaches.
#[derive(Debug)]
pub(super) struct FrameCrops {
    /// Name of the frame.
    pub(super) id: String,
    crops: Vec<CropSample>,
}

/// Makes the samples of a frame. Shared by the loader's threads.
#[derive(Debug)]
pub(super) struct CropSampler {
    pub(super) source: Box<dyn FrameSource>,
    pub(super) augmentation: AugmentationConfig,
    pub(super) train: RefinerTrainConfig,
    pub(super) side: usize,
}

impl CropSampler {
    /// The samples of the frame that `key` stands for; the same whenever and wherever they are asked for.
    pub(super) fn samples(&self, key: ItemKey) -> Result<FrameCrops, DatasetError> {
        let frame = self.source.frame(key)?;
        let mut rng = key.rng();
        let mut labels: Vec<&Label> = frame.labels.iter().filter(|label| self.teaches(label)).collect();
        labels.shuffle(&mut rng);
        labels.truncate(self.train.objects_per_frame);
        let crops = labels.into_iter().filter_map(|label| self.sample(&frame, label, &mut rng)).collect();
        Ok(FrameCrops { id: frame.id.clone(), crops })
    }

    fn teaches(&self, label: &Label) -> bool {
        label.class != ObjectClass::DontCare
            && (0..=MOST_OCCLUDED).contains(&label.occlusion)
            && label.truncation <= MOST_TRUNCATED
            && label.box2d.height() >= self.train.least_height_px
    }

    /// One object, cut out where a first look with errors would see it.
    fn sample(&self, frame: &Frame, label: &Label, rng: &mut impl Rng) -> Option<CropSample> {
        let (width, height) = frame.image.dimensions();
        let rules = input_rules(self.side);
        let image_size = [width, height].map(|side| side as usize);
        let drawn = self.augmentation.draw(rng, image_size, &rules);
        let (camera, object) = if drawn.mirror {
            (frame.camera.mirrored(image_size[0]), label.box3d.mirrored())
        } else {
            (frame.camera, label.box3d)
        };
        let seen = misjudged(&object, &camera, rng)?.projected(&camera)?;
        let seen = seen.clamped(f64::from(width), f64::from(height));
        let crop = Crop::around(&seen, &camera, self.side)?;
        let targets = crop.encode(&object)?.map(|target| target as f32);
        let mut input = Transform { window: crop.window, ..drawn }.input(&frame.image, &rules);
        input.extend(crop.rays());
        Some(CropSample { input, targets })
    }
}

/// `object` as a first look could have placed it.
fn misjudged(object: &Box3d, camera: &Camera, rng: &mut impl Rng) -> Option<Box3d> {
    let mut normal = |deviation: f64| deviation * rng.sample::<f64, _>(StandardNormal);
    let Dimensions { height, width, length } = object.dimensions;
    let dimensions = Dimensions {
        height: height * normal(SIZE_ERROR).exp(),
        width: width * normal(SIZE_ERROR).exp(),
        length: length * normal(SIZE_ERROR).exp(),
    };
    let depth_m = object.depth_m() * normal(DEPTH_ERROR).exp();
    let [u, v] = camera.pixel_from_point(object.center())?;
    let metre_px = camera.focal_y() / object.depth_m();
    let center = [u + metre_px * length * normal(CENTER_ERROR), v + metre_px * height * normal(CENTER_ERROR)];
    let [x, y, z] = camera.point_from_pixel(center, depth_m);
    let yaw = wrapped_angle(object.yaw + normal(HEADING_ERROR_RAD));
    Some(Box3d { dimensions, location: [x, y + dimensions.height / 2.0, z], yaw })
}

/// Input `[objects, 6, side, side]` and targets `[objects, 8]` of a batch; none without objects.
pub(super) fn tensors(frames: &[FrameCrops], side: usize, device: Device) -> Option<[Tensor; 2]> {
    let samples: Vec<&CropSample> = frames.iter().flat_map(|frame| &frame.crops).collect();
    if samples.is_empty() {
        return None;
    }
    let shape = [INPUT_CHANNELS as i64, side as i64, side as i64];
    let inputs: Vec<Tensor> = samples.iter().map(|sample| Tensor::from_slice(&sample.input).view(shape)).collect();
    let targets: Vec<Tensor> = samples.iter().map(|sample| Tensor::from_slice(&sample.targets)).collect();
    Some([inputs, targets].map(|rows| Tensor::stack(&rows, 0).to_device(device)))
}
