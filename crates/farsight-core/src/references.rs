//! What a detector's regression is relative to: mean sizes of classes, and the depth that counts as zero.

use serde::{Deserialize, Serialize};

use crate::ObjectClass;
use crate::range_error::{DepthExample, RangeError};
use crate::score::{MIN_EXAMPLES, ScoreCalibration};
use crate::statistics::{quantile, sorted};

/// Slopes are taken between pairs of so many objects at most.
const MAX_PAIRED: usize = 1500;

/// Pairs that are closer than this, metres, say little about the slope.
const MIN_APART_M: f64 = 1.0;

/// Mean and standard deviation of the depth of objects; centres the depth channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthReference {
    /// Mean depth, metres.
    pub mean_m: f64,
    /// Standard deviation of the depth, metres.
    pub std_m: f64,
    /// Virtual depth: the focal length, pixels of the network's input, under which the network's depth is the true
    /// depth. Under another focal length the same picture means a distance larger or smaller by the ratio of the two.
    /// Without it the network's depth is taken as it is, as in SMOKE.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<f64>,
    /// How far off the model's depths are, where that was fitted: gives detections their error bars.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<RangeError>,
}

/// No object that a camera on a road sees is farther away or longer, metres; a file from a stranger may say otherwise.
pub const MAX_M: f64 = 10_000.0;

/// No camera sees a network's input under a longer focal length, pixels of the input.
pub const MAX_FOCAL_PX: f64 = 1_000_000.0;

impl DepthReference {
    /// Whether mean and deviation are those of objects that a camera sees.
    pub fn is_usable(&self) -> bool {
        self.mean_m.abs() <= MAX_M && self.std_m > 0.0 && self.std_m <= MAX_M
    }

    /// Depth of KITTI's objects (SMOKE, spec 5.1).
    pub const KITTI: Self = Self { mean_m: 28.01, std_m: 16.32, focal_px: None, error: None };

    /// The depth that a network sees at `depth_m` through an input of this focal length, pixels.
    pub fn virtual_depth_m(&self, depth_m: f64, input_focal_px: f64) -> f64 {
        depth_m / self.scale(input_focal_px)
    }

    /// Standard deviation, metres, of a depth seen through an input of this focal length (pixels) with this score (0 to
    /// 1, both excluded), in a box that the image's border cuts or not. None where it was not fitted.
    pub fn sigma_m(&self, depth_m: f64, score: f64, is_cut: bool, input_focal_px: f64) -> Option<f64> {
        let virtual_m = self.virtual_depth_m(depth_m, input_focal_px);
        let sigma_m = self.error?.sigma_m(virtual_m, score, is_cut) * self.scale(input_focal_px);
        sigma_m.is_finite().then_some(sigma_m)
    }

    /// This reference moved and stretched, so that depths come out right in the median for near and for far objects:
    /// Theil and Sen's line through what was found (by a model of this reference) and what is right. None with fewer
    /// than [`MIN_EXAMPLES`], or where the line does not rise.
    pub fn refitted(&self, examples: &[DepthExample]) -> Option<Self> {
        if examples.len() < MIN_EXAMPLES {
            return None;
        }
        let step = examples.len().div_ceil(MAX_PAIRED);
        let paired: Vec<_> = examples.iter().step_by(step).collect();
        let mut slopes = Vec::new();
        for (i, a) in paired.iter().enumerate() {
            let apart = paired[i + 1..].iter().filter(|b| (a.found_m - b.found_m).abs() >= MIN_APART_M);
            slopes.extend(apart.map(|b| (a.true_m - b.true_m) / (a.found_m - b.found_m)));
        }
        if slopes.is_empty() {
            return None;
        }
        let slope = quantile(&sorted(slopes), 0.5);
        let offset_m = quantile(&sorted(examples.iter().map(|e| e.true_m - slope * e.found_m)), 0.5);
        let refitted = Self { mean_m: offset_m + slope * self.mean_m, std_m: slope * self.std_m, ..*self };
        (refitted.std_m > 0.0 && refitted.mean_m.is_finite()).then_some(refitted)
    }

    /// True depth over virtual depth through an input of this focal length, pixels.
    pub fn scale(&self, input_focal_px: f64) -> f64 {
        self.focal_px.map_or(1.0, |focal_px| input_focal_px / focal_px)
    }
}

/// What the codec must know of a class.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClassReference {
    /// The class.
    pub class: ObjectClass,
    /// Reference length, height and width, metres; the dimension channels are relative to it.
    pub dimensions_lhw: [f64; 3],
    /// Factor on the dynamic heatmap's alpha for this class.
    #[serde(default = "one", alias = "heat_map_factor")]
    pub heatmap_factor: f64,
    /// Makes probabilities of the peaks; without it the peak is the score, as in SMOKE.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub score: Option<ScoreCalibration>,
}

fn one() -> f64 {
    1.0
}

impl ClassReference {
    /// What is wrong with the sizes and factors of these classes, if anything is.
    pub fn problem_of_sizes(classes: &[Self]) -> Option<String> {
        let is_usable = |number: &f64| *number > 0.0 && *number <= MAX_M;
        let numbers = |known: &Self| [known.dimensions_lhw.as_slice(), &[known.heatmap_factor]].concat();
        let bad = classes.iter().find(|known| !numbers(known).iter().all(is_usable))?;
        let expected = format!("expected positive numbers, at most {MAX_M}");
        Some(format!("has {} with a size or factor out of all proportion; {expected}", bad.class))
    }

    /// What is wrong with the names of these classes, if anything is.
    pub fn problem_of_names(classes: &[Self]) -> Option<String> {
        for (place, Self { class, .. }) in classes.iter().enumerate() {
            if classes[..place].iter().any(|other| other.class == *class) {
                return Some(format!("names {class} twice"));
            }
            if let Some(known) = class.misspelt() {
                return Some(format!("names {class}; expected {known}, as KITTI writes it"));
            }
            let name = class.name();
            if name.is_empty() || name.len() > 64 || name.contains(|c: char| c.is_whitespace() || c.is_control()) {
                return Some(format!("names {name:?}; expected one word"));
            }
        }
        None
    }

    /// SMOKE's three classes with its reference sizes, in the official order of channels: car, cyclist, pedestrian
    /// (spec 5.1).
    ///
    /// The car's height and width look exchanged; both public code bases carry it and it only shifts a learnt offset.
    pub fn smoke() -> Vec<Self> {
        let reference = |class, dimensions_lhw| Self { class, dimensions_lhw, heatmap_factor: 1.0, score: None };
        vec![
            reference(ObjectClass::Car, [3.88, 1.63, 1.53]),
            reference(ObjectClass::Cyclist, [1.78, 1.70, 0.58]),
            reference(ObjectClass::Pedestrian, [0.88, 1.73, 0.67]),
        ]
    }
}
