//! From labelled frames to cut-outs and what the refiner should answer.

use farsight_core::refine::{Crop, INPUT_CHANNELS, NOTHING, TARGETS, input_rules, kind_of};
use farsight_core::{Box3d, Camera, Dimensions, Label, ObjectClass, wrapped_angle};
use farsight_data::kitti::dataset::DatasetError;
use farsight_data::{AugmentationConfig, Frame, ItemKey, Transform};
use farsight_net::refiner::KEYPOINT_COUNT;
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use tch::{Device, Kind, Tensor};

use super::config::RefinerTrainConfig;
use super::false_alarms::false_alarms;
use crate::sources::FrameSource;

/// Objects of which less is seen are not learnt from.
const MOST_OCCLUDED: i32 = 2;
const MOST_TRUNCATED: f64 = 0.8;

/// Errors of a first look, standard deviations: of the logarithms of depth and sizes, of the centre as a share of the object, and of the heading. The
/// detector's own are of this size.
const DEPTH_ERROR: f64 = 0.06;
const SIZE_ERROR: f64 = 0.06;
const CENTER_ERROR: f64 = 0.04;
const HEADING_ERROR_RAD: f64 = 0.15;

/// Keypoints farther from the middle of the cut-out than this, in sides, are not looked for: its outermost cells are there.
const FARTHEST_KEYPOINT: f64 = 0.475;

/// What is there to be learnt from.
#[derive(Debug, Clone, Copy)]
struct Object {
    box3d: Box3d,
    kind: Option<usize>,
    /// The right and the left end of its number plate, if the image shows it.
    plate: Option<[[f64; 3]; 2]>,
}

impl Object {
    /// What is seen in the mirror image.
    fn mirrored(&self) -> Self {
        let flipped = |[x, y, z]: [f64; 3]| [-x, y, z];
        let plate = self.plate.map(|[right, left]| [flipped(left), flipped(right)]);
        Self { box3d: self.box3d.mirrored(), plate, ..*self }
    }
}

/// What is cut out.
#[derive(Debug, Clone, Copy)]
enum Seen {
    /// Something with a label.
    Object(Object),
    /// Where a detector thought that something is.
    Nothing(Box3d),
}

impl Seen {
    fn mirrored(&self) -> Self {
        match self {
            Self::Object(object) => Self::Object(object.mirrored()),
            Self::Nothing(box3d) => Self::Nothing(box3d.mirrored()),
        }
    }
}

/// One cut-out as the refiner sees it.
#[derive(Debug)]
struct CropSample {
    /// `[6, side, side]`.
    input: Vec<f32>,
    /// Where the object is; none of what is nothing.
    place: Option<Place>,
    /// What it is; none where that is not told from others.
    kind: Option<usize>,
}

/// Where an object is.
#[derive(Debug)]
struct Place {
    targets: [f32; TARGETS],
    /// Column and row of the keypoints, sides of the cut-out from its middle; no number where they are not known or the cut-out does not reach.
    keypoints: [[f32; 2]; KEYPOINT_COUNT],
}

impl Place {
    fn of(Object { box3d, plate, .. }: &Object, crop: &Crop) -> Option<Self> {
        let corners = crop.corners(box3d).unwrap_or([[f64::NAN; 2]; 8]);
        let ends = plate.map(|ends| ends.map(|end| crop.place_of(end).unwrap_or([f64::NAN; 2])));
        let ends = ends.unwrap_or([[f64::NAN; 2]; 2]);
        let known = |at: f64| if at.abs() < FARTHEST_KEYPOINT { at as f32 } else { f32::NAN };
        let mut keypoints = [[f32::NAN; 2]; KEYPOINT_COUNT];
        for (keypoint, place) in keypoints.iter_mut().zip(corners.iter().chain(&ends)) {
            *keypoint = place.map(known);
        }
        Some(Self { targets: crop.encode(box3d)?.map(|target| target as f32), keypoints })
    }
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
        let labels = frame.labels.iter().enumerate().filter(|(_, label)| self.teaches(label));
        let object = |(place, label): (usize, &Label)| {
            let plate = frame.plates.iter().find(|plate| plate.label == place).map(|plate| plate.ends);
            Seen::Object(Object { box3d: label.box3d, kind: kind_of(&label.class), plate })
        };
        let objects = drawn(labels.map(object).collect(), self.train.objects_per_frame, &mut rng);
        let nothing = match &self.train.first_looks {
            Some(folder) => false_alarms(folder, &frame, self.train.least_height_px)?,
            None => Vec::new(),
        };
        let nothing = nothing.into_iter().map(Seen::Nothing).collect();
        let nothing = drawn(nothing, self.train.false_alarms_per_frame, &mut rng);
        let seen = objects.into_iter().chain(nothing);
        let crops = seen.filter_map(|seen| self.sample(&frame, seen, &mut rng)).collect();
        Ok(FrameCrops { id: frame.id.clone(), crops })
    }

    fn teaches(&self, label: &Label) -> bool {
        label.class != ObjectClass::DontCare
            && (0..=MOST_OCCLUDED).contains(&label.occlusion)
            && label.truncation <= MOST_TRUNCATED
            && label.box2d.height() >= self.train.least_height_px
    }

    /// What is there, cut out where a first look with errors would see it.
    fn sample(&self, frame: &Frame, seen: Seen, rng: &mut impl Rng) -> Option<CropSample> {
        let (width, height) = frame.image.dimensions();
        let rules = input_rules(self.side);
        let image_size = [width, height].map(|side| side as usize);
        let drawn = self.augmentation.draw(rng, image_size, &rules);
        let camera = if drawn.mirror { frame.camera.mirrored(image_size[0]) } else { frame.camera };
        let seen = if drawn.mirror { seen.mirrored() } else { seen };
        let (Seen::Object(Object { box3d, .. }) | Seen::Nothing(box3d)) = seen;
        let first_look = misjudged(&box3d, &camera, rng)?.projected(&camera)?;
        let crop = Crop::around(&first_look.clamped(f64::from(width), f64::from(height)), &camera, self.side)?;
        let (place, kind) = match seen {
            Seen::Object(object) => (Some(Place::of(&object, &crop)?), object.kind),
            Seen::Nothing(_) => (None, Some(NOTHING)),
        };
        let mut input = Transform { window: crop.window, ..drawn }.input(&frame.image, &rules);
        input.extend(crop.rays());
        Some(CropSample { input, place, kind })
    }
}

/// At most so many of `all`, in random order.
fn drawn<T>(mut all: Vec<T>, most: usize, rng: &mut impl Rng) -> Vec<T> {
    all.shuffle(rng);
    all.truncate(most);
    all
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

/// What a step learns from.
#[derive(Debug)]
pub(super) struct CropBatch {
    /// `[cut-outs, 6, side, side]`.
    pub(super) input: Tensor,
    /// Which cut-outs show objects, and where those are: `[objects]` and `[objects, 8]`.
    pub(super) objects: Tensor,
    pub(super) targets: Tensor,
    /// Where the keypoints of those are, `[objects, 20]`, and which of these numbers are known, 1 or 0.
    pub(super) keypoints: Tensor,
    pub(super) seen: Tensor,
    /// Of which cut-outs the kind is known, and that: `[known]` each.
    pub(super) known: Tensor,
    pub(super) kinds: Tensor,
}

impl CropBatch {
    /// What `frames` teach; none without an object whose kind is known.
    pub(super) fn new(frames: &[FrameCrops], side: usize, device: Device) -> Option<Self> {
        let samples = || frames.iter().flat_map(|frame| &frame.crops);
        let (objects, places): (Vec<i64>, Vec<&Place>) =
            (0..).zip(samples()).filter_map(|(index, sample)| Some((index, sample.place.as_ref()?))).unzip();
        let (known, kinds): (Vec<i64>, Vec<i64>) =
            (0..).zip(samples()).filter_map(|(place, sample)| Some((place, sample.kind? as i64))).unzip();
        if objects.is_empty() || known.is_empty() {
            return None;
        }
        let shape = [INPUT_CHANNELS as i64, side as i64, side as i64];
        let inputs: Vec<Tensor> = samples().map(|sample| Tensor::from_slice(&sample.input).view(shape)).collect();
        let list = |numbers: &[i64]| Tensor::from_slice(numbers).to_device(device);
        let table =
            |numbers: &[f32], columns: usize| Tensor::from_slice(numbers).view([-1, columns as i64]).to_device(device);
        let targets: Vec<f32> = places.iter().flat_map(|place| place.targets).collect();
        let keypoints: Vec<f32> = places.iter().flat_map(|place| place.keypoints).flatten().collect();
        let keypoints = table(&keypoints, 2 * KEYPOINT_COUNT);
        let seen = keypoints.isfinite();
        Some(Self {
            input: Tensor::stack(&inputs, 0).to_device(device),
            objects: list(&objects),
            targets: table(&targets, TARGETS),
            keypoints: keypoints.nan_to_num(0.0, None, None),
            seen: seen.to_kind(Kind::Float),
            known: list(&known),
            kinds: list(&kinds),
        })
    }
}
