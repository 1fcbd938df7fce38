//! What the two networks are asked to answer for one image.

use farsight_core::overlap::iou_2d;
use farsight_core::{Affine2, Box2d, Box3d, Camera, Label};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::Gs3dConfig;
use super::boxes::Encoded;
use super::guidance::guidance;
use super::refinement::{BINS, NUMBERS};
use super::surfaces::points;
use crate::center_map::{STRIDE, feature_camera};

/// Errors of a detector that the refinement learns to bear: of the centre and of the logarithms of the sides of a 2D
/// box, as shares of its sides, and of the angle, radians.
const BOX_ERROR: f64 = 0.04;
const ALPHA_ERROR_RAD: f64 = 0.15;

/// So much larger are the errors of a box that is to be told for background.
const BACKGROUND_FACTOR: f64 = 8.0;

/// A box that overlaps its object's less is background (as a detector's).
const MIN_OVERLAP: f64 = 0.5;

/// A box that the second network looks at.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Where the map is read ([`points`]).
    pub points: Vec<[f64; 2]>,
    /// What the network should say.
    pub target: [f32; NUMBERS * BINS],
}

/// Targets of one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// Heatmaps, `[classes, height, width]`, 1 at every centre.
    pub heatmap: Vec<f32>,
    /// Width and height of the maps, cells.
    pub map_size: [usize; 2],
    /// What stands at the cells of the objects.
    pub objects: Vec<Encoded>,
    /// For each object its own box, one as a detector would find it, and one that is too far off.
    pub candidates: Vec<Candidate>,
}

/// Targets for `labels` in a network input of `input_size` (width, height, pixels) seen by `input_camera`; errors of
/// boxes are drawn from `rng`.
pub fn targets(
    labels: &[Label],
    config: &Gs3dConfig,
    input_camera: &Camera,
    input_size: [usize; 2],
    rng: &mut impl Rng,
) -> Targets {
    let camera = feature_camera(input_camera);
    let map_size @ [width, height] = input_size.map(|side| side / STRIDE);
    let area = width * height;
    let mut heatmap = vec![0.0; config.classes.len() * area];
    let (mut objects, mut candidates) = (Vec::new(), Vec::new());
    for label in labels {
        let Some(class) = config.classes.iter().position(|known| known.class == label.class) else { continue };
        let whole = label.box2d.transformed(&Affine2::scaling(1.0 / STRIDE as f64));
        let seen = whole.clamped(width as f64 - 1.0, height as f64 - 1.0);
        if !(seen.width() > 0.0 && seen.height() > 0.0 && label.box3d.depth_m() > 0.0) {
            continue;
        }
        let alpha = label.box3d.alpha();
        let Some(encoded) = Encoded::new(&seen, alpha) else { continue };
        let channel = &mut heatmap[class * area..][..area];
        let factor = config.classes[class].heatmap_factor;
        config.heatmap.gaussian(seen.width(), seen.height(), factor).draw(channel, width, encoded.cell);
        objects.push(encoded);
        for error in [0.0, 1.0, BACKGROUND_FACTOR] {
            let found = jittered(&seen, error * BOX_ERROR, rng);
            let angle = alpha + error.min(1.0) * ALPHA_ERROR_RAD * rng.sample::<f64, _>(StandardNormal);
            let truth = (iou_2d(&found, &seen) >= MIN_OVERLAP).then_some(&label.box3d);
            candidates.extend(candidate(config, class, &found, angle, &camera, truth));
        }
    }
    Targets { heatmap, map_size, objects, candidates }
}

/// What the second network sees of a box in the map, and what it should say; none of a box that says nothing.
fn candidate(
    config: &Gs3dConfig,
    class: usize,
    box2d: &Box2d,
    alpha: f64,
    camera: &Camera,
    truth: Option<&Box3d>,
) -> Option<Candidate> {
    let guidance = guidance_of(config, class, box2d, alpha, camera)?;
    let target = truth.map_or([0.0; NUMBERS * BINS], |truth| config.refinement().target(&guidance, truth));
    Some(Candidate { points: points(box2d, &guidance, camera), target })
}

/// The guidance for a box in the map that `camera` sees.
pub(super) fn guidance_of(
    config: &Gs3dConfig,
    class: usize,
    box2d: &Box2d,
    alpha: f64,
    camera: &Camera,
) -> Option<Box3d> {
    // The guidance's least height is of the image.
    let to_input = Affine2::scaling(STRIDE as f64);
    guidance(&box2d.transformed(&to_input), alpha, config.mean_size(class), &camera.transformed(&to_input))
}

/// A box whose centre and sides are off by normal errors of this deviation.
fn jittered(box2d: &Box2d, deviation: f64, rng: &mut impl Rng) -> Box2d {
    let mut normal = || deviation * rng.sample::<f64, _>(StandardNormal);
    let [width, height] = [box2d.width(), box2d.height()];
    let x = f64::midpoint(box2d.x1, box2d.x2) + width * normal();
    let y = f64::midpoint(box2d.y1, box2d.y2) + height * normal();
    let (width, height) = (width * normal().exp(), height * normal().exp());
    Box2d::new(x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0)
}
