//! Divisions of a data set: by height in the image, distance, occlusion and truncation.

use farsight_core::{Detection, Label};

/// Lower edges of the bins of height in the image, pixels: KITTI's two limits, then a car at about 18 m and at 11 m.
const HEIGHT_EDGES_PX: [f64; 4] = [25.0, 40.0, 60.0, 100.0];

/// Names of the bins of height: pixels of the 2D box.
pub const HEIGHT_BINS: [&str; 5] = ["0-25", "25-40", "40-60", "60-100", "100-inf"];

/// Width of a distance bin, metres of true z; the last has no end.
const DISTANCE_BIN_M: f64 = 10.0;

/// Names of the distance bins: metres of true z.
pub const DISTANCE_BINS: [&str; 8] = ["0-10", "10-20", "20-30", "30-40", "40-50", "50-60", "60-70", "70-inf"];

/// Names of the occlusion levels as KITTI numbers them; 3 is "unknown".
pub const OCCLUSIONS: [&str; 4] = ["0", "1", "2", "3"];

/// Upper edges of the truncation bins: the limits of the three levels.
const TRUNCATION_EDGES: [f64; 4] = [0.0, 0.15, 0.30, 0.50];

/// Names of the truncation bins.
pub const TRUNCATIONS: [&str; 5] = ["0", "0-0.15", "0.15-0.30", "0.30-0.50", "0.50-1"];

/// A part of a data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// All of it.
    Whole,
    /// One of [`HEIGHT_BINS`]: how large it looks.
    Height(usize),
    /// One of [`DISTANCE_BINS`]; what lies behind the camera is in the first.
    Distance(usize),
    /// One of [`OCCLUSIONS`].
    Occlusion(usize),
    /// One of [`TRUNCATIONS`].
    Truncation(usize),
}

/// Where an object stands in every division at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Bins {
    height: u8,
    distance: u8,
    occlusion: u8,
    truncation: u8,
}

impl Bins {
    pub(crate) fn new(height_px: f64, depth_m: f64, occlusion: i32, truncation: f64) -> Self {
        Self {
            height: HEIGHT_EDGES_PX.iter().filter(|edge| height_px >= **edge).count() as u8,
            distance: distance_bin(depth_m),
            occlusion: (occlusion.max(0) as usize).min(OCCLUSIONS.len() - 1) as u8,
            truncation: TRUNCATION_EDGES.iter().filter(|edge| truncation > **edge).count() as u8,
        }
    }

    pub(crate) fn of_label(label: &Label) -> Self {
        Self::new(label.box2d.height(), label.box3d.depth_m(), label.occlusion, label.truncation)
    }

    /// By its own height and distance; nothing is known of what hides it.
    pub(crate) fn of_detection(detection: &Detection) -> Self {
        Self::new(detection.box2d.height().abs(), detection.box3d.depth_m(), 0, 0.0)
    }
}

impl Part {
    /// The parts of each division with their names: by height, distance, occlusion and truncation.
    pub fn divisions() -> [Vec<(&'static str, Self)>; 4] {
        let named = |names: &[&'static str], part: fn(usize) -> Self| {
            names.iter().enumerate().map(|(i, name)| (*name, part(i))).collect()
        };
        [
            named(&HEIGHT_BINS, Self::Height),
            named(&DISTANCE_BINS, Self::Distance),
            named(&OCCLUSIONS, Self::Occlusion),
            named(&TRUNCATIONS, Self::Truncation),
        ]
    }

    /// Its name: pixels, metres or a level; `all` of all.
    pub fn name(self) -> &'static str {
        match self {
            Self::Whole => "all",
            Self::Height(bin) => HEIGHT_BINS[bin],
            Self::Distance(bin) => DISTANCE_BINS[bin],
            Self::Occlusion(level) => OCCLUSIONS[level],
            Self::Truncation(bin) => TRUNCATIONS[bin],
        }
    }

    /// The name of the division that it is a part of; `all` of all.
    pub fn division(self) -> &'static str {
        match self {
            Self::Whole => "all",
            Self::Height(_) => "height",
            Self::Distance(_) => "distance",
            Self::Occlusion(_) => "occlusion",
            Self::Truncation(_) => "truncation",
        }
    }

    /// Whether an object that stands here belongs to it.
    pub(crate) fn holds(self, bins: Bins) -> bool {
        match self {
            Self::Whole => true,
            Self::Height(bin) => usize::from(bins.height) == bin,
            Self::Distance(bin) => usize::from(bins.distance) == bin,
            Self::Occlusion(level) => usize::from(bins.occlusion) == level,
            Self::Truncation(bin) => usize::from(bins.truncation) == bin,
        }
    }

    /// Whether a detection that found nothing is wrong in this part: by its own height or distance; in the divisions
    /// that no detection tells of, everywhere.
    pub(crate) fn judges(self, bins: Bins) -> bool {
        matches!(self, Self::Occlusion(_) | Self::Truncation(_)) || self.holds(bins)
    }
}

/// The bin of a depth, metres; what lies behind the camera is in the first.
fn distance_bin(depth_m: f64) -> u8 {
    ((depth_m / DISTANCE_BIN_M) as usize).min(DISTANCE_BINS.len() - 1) as u8
}

/// Middle of a distance bin, metres; of the last one as if it were as wide as the others.
#[cfg(any(feature = "page", test))]
pub(crate) fn bin_middle_m(bin: usize) -> f64 {
    (bin as f64 + 0.5) * DISTANCE_BIN_M
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_middles_of_the_distance_bins_are_those_of_their_distances() {
        for (bin, name) in DISTANCE_BINS.iter().enumerate() {
            let (from, to) = name.split_once('-').unwrap();
            let from: f64 = from.parse().unwrap();
            assert_eq!([from, from + 9.999, bin_middle_m(bin)].map(distance_bin), [bin as u8; 3], "{name}");
            assert_eq!(usize::from(distance_bin(to.parse().unwrap())), (bin + 1).min(7), "{name}");
        }
        assert_eq!(distance_bin(-3.0), 0);
    }

    #[test]
    fn names_of_the_bins_of_height_are_those_of_their_heights() {
        for (bin, name) in HEIGHT_BINS.iter().enumerate() {
            let (from, to) = name.split_once('-').unwrap();
            let at = |height_px: f64| usize::from(Bins::new(height_px, 0.0, 0, 0.0).height);
            assert_eq!(at(from.parse().unwrap()), bin, "{name}");
            assert_eq!(at(to.parse().unwrap()), (bin + 1).min(HEIGHT_BINS.len() - 1), "{name}");
        }
    }
}
