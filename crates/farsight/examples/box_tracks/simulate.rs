//! Detections without pictures: rendered traffic, with the errors that a model really made of other objects.
//!
//! Errors are taken from tracks of objects that look alike (height in the image, how much is hidden), frame by frame,
//! so that what lasts of them lasts, and what hangs together does.

use farsight::video::EgoFile;
use farsight::{Box2d, Box3d, Detection, ObjectClass};
use farsight_core::overlap::iou_2d;
use farsight_core::{Dimensions, Label};
use farsight_eval::tracks::{GroundTruthFrame, GroundTruthTrack};
use farsight_synth::{SceneConfig, SequenceStream};
use rand::{Rng, RngExt};

use crate::data::Sequence;

/// A detection overlaps what it is by this share at least.
const SAME_OVERLAP: f64 = 0.5;

/// Errors go to objects whose boxes are higher or lower by at most this factor, and stay with them up to the other.
const ALIKE: f64 = 1.25;
const STILL_ALIKE: f64 = 1.7;

/// Of so many of such errors the one is taken that goes on best, of so many that are looked at.
const CANDIDATES: usize = 8;
const LOOKS: usize = 400;

/// What is wrong with a detection.
#[derive(Debug, Clone)]
struct Errors {
    class: ObjectClass,
    score: f64,
    /// Of the depth's logarithm, and the standard deviation that was told of it.
    log_depth: f64,
    log_sigma: f64,
    /// Left, top, right and bottom edge, as shares of the box's sides.
    edges: [f64; 4],
    /// `x / z` and `y / z` of the location, as shares of the box's sides.
    direction: [f64; 2],
    /// Of the logarithms of height, width and length.
    log_size: [f64; 3],
    yaw: f64,
}

/// One frame of a donor: height of the box, pixels, how much is hidden, and what was found, if it was.
struct Moment {
    height_px: f64,
    occlusion: i32,
    found: Option<Errors>,
}

/// The errors that a model made of objects, one list each.
pub(crate) struct Donors(Vec<Vec<Moment>>);

impl Donors {
    pub(crate) fn new(sequences: &[Sequence]) -> Self {
        let mut donors = Vec::new();
        for sequence in sequences {
            let mut ids: Vec<u64> = cars(&sequence.truth).map(|(_, one)| one.id).collect();
            ids.sort_unstable();
            ids.dedup();
            for id in ids {
                let of_id = cars(&sequence.truth).filter(|(_, one)| one.id == id);
                let moment = |(frame, one): (usize, &GroundTruthTrack)| Moment {
                    height_px: one.label.box2d.height(),
                    occlusion: one.label.occlusion,
                    found: sequence.detections.get(frame).and_then(|all| errors(sequence, &one.label, all)),
                };
                donors.push(of_id.map(moment).collect());
            }
        }
        Self(donors)
    }

    /// The place of errors for such a box, which go on from the last ones if there are any.
    fn pick(&self, height_px: f64, occlusion: i32, last: Option<&Errors>, rng: &mut impl Rng) -> Option<[usize; 2]> {
        let mut best: Option<([usize; 2], f64)> = None;
        let mut fit = 0;
        for _ in 0..LOOKS {
            let donor = rng.random_range(0..self.0.len());
            let place = rng.random_range(0..self.0[donor].len());
            let moment = &self.0[donor][place];
            let is_alike = (moment.height_px / height_px).ln().abs() < ALIKE.ln() && moment.occlusion == occlusion;
            let Some(errors) = moment.found.as_ref().filter(|_| is_alike) else { continue };
            let off = last.map_or(0.0, |last| {
                let height = |one: &Errors| one.edges[3] - one.edges[1];
                ((errors.log_depth - last.log_depth) / 0.03).abs() + ((height(errors) - height(last)) / 0.03).abs()
            });
            if best.is_none_or(|(_, least)| off < least) {
                best = Some(([donor, place], off));
            }
            fit += 1;
            if fit == CANDIDATES || last.is_none() {
                break;
            }
        }
        best.map(|(place, _)| place)
    }
}

/// Everyone in a car, frame by frame.
fn cars(truth: &[GroundTruthFrame]) -> impl Iterator<Item = (usize, &GroundTruthTrack)> {
    let all = truth.iter().enumerate().flat_map(|(number, frame)| frame.tracks.iter().map(move |one| (number, one)));
    all.filter(|(_, one)| one.label.class == ObjectClass::Car)
}

fn errors(sequence: &Sequence, label: &Label, detections: &[Detection]) -> Option<Errors> {
    let overlap = |one: &Detection| iou_2d(&one.box2d, &label.box2d);
    let found = detections.iter().max_by(|a, b| overlap(a).total_cmp(&overlap(b)))?;
    let focal = [sequence.camera.focal_x(), sequence.camera.focal_y()];
    (overlap(found) > SAME_OVERLAP).then(|| {
        let (told, known) = (&found.box3d, &label.box3d);
        let (a, b) = (&found.box2d, &label.box2d);
        let (width, height) = (b.width(), b.height());
        let direction = |one: &Box3d| [one.location[0] / one.depth_m(), one.location[1] / one.depth_m()];
        let off = |axis: usize| direction(told)[axis] - direction(known)[axis];
        Errors {
            class: found.class.clone(),
            score: found.score,
            log_depth: (told.depth_m() / known.depth_m()).ln(),
            log_sigma: (found.range_sigma_m.unwrap_or(0.05 * told.depth_m()) / told.depth_m()).ln(),
            edges: [(a.x1 - b.x1) / width, (a.y1 - b.y1) / height, (a.x2 - b.x2) / width, (a.y2 - b.y2) / height],
            direction: [off(0) * focal[0] / width, off(1) * focal[1] / height],
            log_size: [0, 1, 2].map(|k| (hwl(&told.dimensions)[k] / hwl(&known.dimensions)[k]).ln()),
            yaw: farsight_core::wrapped_angle(told.yaw - known.yaw),
        }
    })
}

fn hwl(size: &Dimensions) -> [f64; 3] {
    [size.height, size.width, size.length]
}

/// Traffic of the renderer without pictures and without detections, as `farsight synth --sequence` would draw it.
pub(crate) fn traffic(seed: u64, count: u64, frames: usize, fps: f64) -> Vec<Sequence> {
    let stream = SequenceStream { config: SceneConfig::default(), seed, frames, fps };
    let sequence = |index: u64| {
        let sequence = stream.sequence(index);
        let all: Vec<_> = (0..frames).map(|frame| sequence.unrendered_frame(frame)).collect();
        let truth = |frame: &farsight_synth::UnrenderedFrame| GroundTruthFrame {
            tracks: frame
                .tracks
                .iter()
                .map(|one| GroundTruthTrack {
                    id: u64::from(one.id),
                    label: one.label.clone(),
                    velocity_mps: Some(one.velocity_mps),
                    speed_mps: Some(one.speed_mps),
                })
                .collect(),
            dont_care: Vec::new(),
        };
        Sequence {
            name: format!("{index:04}"),
            truth: all.iter().map(truth).collect(),
            camera: all[0].camera,
            image_size: all[0].image_size,
            detections: Vec::new(),
            ego: Some(EgoFile::Frames(all.iter().map(|frame| [frame.ego.speed_mps, frame.ego.yaw_rate]).collect())),
            fps,
        }
    };
    (0..count).map(sequence).collect()
}

/// What a model might find in a sequence.
pub(crate) fn detections(sequence: &Sequence, donors: &Donors, rng: &mut impl Rng) -> Vec<Vec<Detection>> {
    let mut found: Vec<Vec<Detection>> = vec![Vec::new(); sequence.truth.len()];
    let mut ids: Vec<u64> = cars(&sequence.truth).map(|(_, one)| one.id).collect();
    ids.sort_unstable();
    ids.dedup();
    for id in ids {
        let mut at: Option<[usize; 2]> = None;
        let mut last: Option<Errors> = None;
        for (frame, one) in cars(&sequence.truth).filter(|(_, one)| one.id == id) {
            let (height_px, occlusion) = (one.label.box2d.height(), one.label.occlusion);
            let goes_on = at.map(|[donor, place]| [donor, place + 1]).filter(|[donor, place]| {
                donors.0[*donor].get(*place).is_some_and(|moment| {
                    (moment.height_px / height_px).ln().abs() < STILL_ALIKE.ln() && moment.occlusion == occlusion
                })
            });
            at = goes_on.or_else(|| donors.pick(height_px, occlusion, last.as_ref(), rng));
            let Some(errors) = at.and_then(|[donor, place]| donors.0[donor][place].found.clone()) else { continue };
            found[frame].extend(detection(sequence, &one.label, &errors));
            last = Some(errors);
        }
    }
    found
}

fn detection(sequence: &Sequence, label: &Label, errors: &Errors) -> Option<Detection> {
    let known = &label.box3d;
    let (width, height) = (label.box2d.width(), label.box2d.height());
    let z = known.depth_m() * errors.log_depth.exp();
    let focal = [sequence.camera.focal_x(), sequence.camera.focal_y()];
    let along = |axis: usize, side: f64| {
        z * (known.location[axis] / known.depth_m() + errors.direction[axis] * side / focal[axis])
    };
    let size = hwl(&known.dimensions);
    let [h, w, l] = [0, 1, 2].map(|k| size[k] * errors.log_size[k].exp());
    let [x1, y1, x2, y2] = errors.edges;
    let b = &label.box2d;
    let [right, bottom] = sequence.image_size.map(|side| side as f64);
    let box2d = Box2d::new(b.x1 + x1 * width, b.y1 + y1 * height, b.x2 + x2 * width, b.y2 + y2 * height);
    let box2d = box2d.clamped(right, bottom);
    (box2d.width() > 1.0 && box2d.height() > 1.0 && z > 0.0).then(|| Detection {
        class: errors.class.clone(),
        score: errors.score,
        box2d,
        box3d: Box3d {
            dimensions: Dimensions { height: h, width: w, length: l },
            location: [along(0, width), along(1, height), z],
            yaw: farsight_core::wrapped_angle(known.yaw + errors.yaw),
        },
        range_sigma_m: Some(errors.log_sigma.exp() * z),
    })
}
