//! What an SSD is made of.

use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_core::references::MAX_FOCAL_PX;
use farsight_core::{ClassReference, ObjectClass};
use farsight_graph::graph::Graph;
use farsight_graph::model::NetworkConfig;
use serde::{Deserialize, Serialize};

use super::network::{BOXES, CLASSES, network};

/// What the network's labels are called, one a channel.
pub const LABELS: [&str; 4] = ["Bicycle", "Person", "Vehicle", "Car"];

/// No model looks at an image more often.
const MAX_VIEWS: usize = 8;

/// Under a shorter focal length, pixels, a car fills no cell of the network.
const MIN_FOCAL_PX: f64 = 16.0;

/// Places of the labels.
pub(super) const BICYCLE: usize = 0;
pub(super) const PERSON: usize = 1;
pub(super) const VEHICLES: [usize; 2] = [2, 3];

/// One view of the image: the network sees objects of some sizes only, so the image is shown to it at several scales.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SsdView {
    /// The focal length of the view, pixels: how large things are seen, whatever the camera.
    pub focal_px: f64,
    /// Shows the rows from the first of these above the camera's axis to the second below it, as tangents of the angle;
    /// all rows without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows: Option<[f64; 2]>,
}

/// An SSD's description, as it stands in the header of its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SsdConfig {
    /// How the image is shown.
    pub views: Vec<SsdView>,
    /// How far off a distance by similar triangles is, as a share of it: the spread of heights in a class, and of
    /// boxes.
    pub relative_error: f64,
    /// Fields of view, degrees across, for which what follows this network was made; others are told.
    pub hfov_range_deg: [f64; 2],
    /// Of boxes of a class that overlap by more than this the best stays.
    pub max_overlap: f64,
    /// The classes, with the sizes that distances are guessed by: a car, a cyclist and a pedestrian.
    pub classes: Vec<ClassReference>,
}

impl Default for SsdConfig {
    fn default() -> Self {
        Self {
            views: vec![
                SsdView { focal_px: 400.0, rows: None },
                SsdView { focal_px: 1100.0, rows: Some([0.12, 0.17]) },
            ],
            relative_error: 0.2,
            hfov_range_deg: [25.0, 125.0],
            max_overlap: 0.45,
            classes: classes(),
        }
    }
}

/// SMOKE's classes, and vans and trucks, which the network calls cars and a refiner tells apart; means of KITTI's
/// labels.
fn classes() -> Vec<ClassReference> {
    let reference = |class, dimensions_lhw| ClassReference { class, dimensions_lhw, heatmap_factor: 1.0, score: None };
    let more = [reference(ObjectClass::Van, [5.08, 2.21, 1.90]), reference(ObjectClass::Truck, [10.11, 3.25, 2.59])];
    ClassReference::smoke().into_iter().chain(more).collect()
}

impl SsdConfig {
    /// Conventions of the inputs. Sizes differ from view to view; this is that of the network's training.
    pub(super) fn input_rules(size: [usize; 2]) -> InputRules {
        InputRules { size, channels: ChannelOrder::Rgb, sampling: Sampling::Antialias }
    }

    /// What is known of a class.
    pub(super) fn reference(&self, class: &ObjectClass) -> Option<&ClassReference> {
        self.classes.iter().find(|known| known.class == *class)
    }
}

impl NetworkConfig for SsdConfig {
    const METHOD: &'static str = "ssd";
    const NAME: &'static str = "an SSD";
    const OUTPUTS: &'static [&'static str] = &[
        BOXES[0], BOXES[1], BOXES[2], BOXES[3], BOXES[4], BOXES[5], CLASSES[0], CLASSES[1], CLASSES[2], CLASSES[3],
        CLASSES[4], CLASSES[5],
    ];

    fn problem(&self) -> Option<String> {
        if !(1..=MAX_VIEWS).contains(&self.views.len()) {
            return Some(format!("model.views has {} views; expected 1 to {MAX_VIEWS}", self.views.len()));
        }
        for SsdView { focal_px, rows } in &self.views {
            if !(MIN_FOCAL_PX..=MAX_FOCAL_PX).contains(focal_px) {
                let expected = format!("expected {MIN_FOCAL_PX} to {MAX_FOCAL_PX} pixels");
                return Some(format!("model.views has focal_px {focal_px}; {expected}"));
            }
            if let Some([above, below]) = rows
                && !(above.is_finite() && below.is_finite() && above + below > 0.0)
            {
                return Some(format!("model.views has rows [{above}, {below}]; expected tangents with a positive sum"));
            }
        }
        if !(self.relative_error > 0.0 && self.relative_error <= 1.0) {
            return Some(format!("model.relative_error is {}; expected above 0 and at most 1", self.relative_error));
        }
        let [low, high] = self.hfov_range_deg;
        if !(low > 0.0 && low <= high && high < 180.0) {
            return Some(format!("model.hfov_range_deg is {low} to {high}; expected 0 < least <= most < 180"));
        }
        if !(self.max_overlap > 0.0 && self.max_overlap <= 1.0) {
            return Some(format!("model.max_overlap is {}; expected above 0 and at most 1", self.max_overlap));
        }
        let names = ClassReference::problem_of_names(&self.classes).map(|problem| format!("model.classes {problem}"));
        let sizes = ClassReference::problem_of_sizes(&self.classes).map(|problem| format!("model.classes {problem}"));
        let lacks = |class: &ObjectClass| self.reference(class).is_none();
        names.or(sizes).or_else(|| {
            let lacking = [ObjectClass::Car, ObjectClass::Cyclist, ObjectClass::Pedestrian].into_iter().find(lacks);
            lacking.map(|class| format!("model.classes has no {class}; expected Car, Cyclist and Pedestrian"))
        })
    }

    fn graph(&self) -> Graph {
        network(LABELS.len())
    }
}
