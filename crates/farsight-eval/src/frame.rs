//! What is evaluated: the labels of an image and what a detector says about it.

use farsight_core::{Detection, Label, ObjectClass};
use farsight_data::kitti::DevkitRow;

/// One image's ground truth and detections, each in file order: the order decides between equals.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Frame {
    /// Name of the frame, KITTI's six digits for instance.
    pub id: String,
    /// Ground truth, all classes and `DontCare` regions.
    pub labels: Vec<Label>,
    /// What the detector says.
    pub predictions: Vec<Prediction>,
}

impl Frame {
    /// The frame `id` with what a detector says in memory: angles of observation follow from place and heading.
    pub fn new(id: impl Into<String>, labels: Vec<Label>, detections: Vec<Detection>) -> Self {
        Self { id: id.into(), labels, predictions: detections.into_iter().map(Prediction::from).collect() }
    }
}

impl Frame {
    /// The frame in which vans, trucks and trams are cars, labels and detections alike: all vehicles as one class.
    #[must_use]
    pub fn with_vehicles_as_cars(mut self) -> Self {
        let labelled = self.labels.iter_mut().map(|label| &mut label.class);
        let detected = self.predictions.iter_mut().map(|prediction| &mut prediction.detection.class);
        for class in labelled.chain(detected) {
            let is_vehicle = [ObjectClass::Van, ObjectClass::Truck, ObjectClass::Tram].contains(class);
            let is_unnamed = class.name().eq_ignore_ascii_case(ANY_VEHICLE);
            if is_vehicle || is_unnamed {
                *class = ObjectClass::Car;
            }
        }
        self
    }
}

/// How labels name a vehicle of a kind that is not known.
const ANY_VEHICLE: &str = "Vehicle";

/// A detection as it is handed in.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    /// Class, score and boxes.
    pub detection: Detection,
    /// Observation angle as handed in, radians; -10 says that the detector knows none, which turns AOS off for the
    /// whole set.
    pub alpha_rad: f64,
}

impl From<Detection> for Prediction {
    fn from(detection: Detection) -> Self {
        Self { alpha_rad: detection.alpha(), detection }
    }
}

impl From<DevkitRow> for Prediction {
    /// The row of a result file, with the angle as written.
    fn from(read: DevkitRow) -> Self {
        let alpha_rad = read.row.label.alpha;
        let detection = Detection { range_sigma_m: read.range_sigma_m, ..read.row.into_detection() };
        Self { detection, alpha_rad }
    }
}
