//! Precision at 41 points of recall (spec rules 18 to 21).

/// Points of a curve: recall 0, 1/40, ... 1.
pub const RECALL_POINTS: usize = 41;

/// Precision against recall for one class, metric and difficulty.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// The overlap that a detection had to exceed.
    pub min_overlap: f64,
    /// Objects that had to be found.
    pub objects: usize,
    /// True positives of the first pass, from whose scores the thresholds are chosen.
    pub matched: usize,
    /// The score thresholds, highest first; the one at position `i` stands for recall `i / 40`.
    pub thresholds: Vec<ScoreThreshold>,
    /// Precision at each point, 0 to 1, made falling; 0 where no threshold is.
    pub precision: [f64; RECALL_POINTS],
    /// Orientation similarity at each point, 0 to 1; only in the image, and only when every detection states its angle.
    pub orientation: Option<[f64; RECALL_POINTS]>,
}

/// One score threshold and the counts over all frames there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreThreshold {
    /// Detections with a lower score take no part.
    pub score: f64,
    /// True positives.
    pub true_positives: usize,
    /// False positives.
    pub false_positives: usize,
    /// Objects missed.
    pub false_negatives: usize,
    /// Sum of the orientation similarities of the true positives.
    pub similarity: f64,
}

impl Curve {
    /// Average precision over 40 points of recall, percent: the mean without the point at recall 0 (KITTI since
    /// 8.10.2019).
    pub fn ap_r40(&self) -> f64 {
        percent_r40(&self.precision)
    }

    /// Average precision over 11 points of recall, percent (KITTI before that).
    pub fn ap_r11(&self) -> f64 {
        percent_r11(&self.precision)
    }

    pub(super) fn new(
        min_overlap: f64,
        objects: usize,
        matched: usize,
        thresholds: Vec<ScoreThreshold>,
        with_orientation: bool,
    ) -> Self {
        let share = |part: fn(&ScoreThreshold) -> f64| falling(&thresholds, part);
        let precision = share(|threshold| threshold.true_positives as f64);
        let orientation = with_orientation.then(|| share(|threshold| threshold.similarity));
        Self { min_overlap, objects, matched, thresholds, precision, orientation }
    }
}

pub(super) fn percent_r40(points: &[f64; RECALL_POINTS]) -> f64 {
    100.0 * points[1..].iter().sum::<f64>() / 40.0
}

pub(super) fn percent_r11(points: &[f64; RECALL_POINTS]) -> f64 {
    100.0 * points.iter().step_by(4).sum::<f64>() / 11.0
}

/// `part / (true + false positives)` at each threshold, then the largest value from there on.
///
/// 0 / 0 counts as 0. The devkit gets NaN there, which hides or spreads depending on where it stands (spec rule 21).
fn falling(thresholds: &[ScoreThreshold], part: impl Fn(&ScoreThreshold) -> f64) -> [f64; RECALL_POINTS] {
    let mut points = [0.0; RECALL_POINTS];
    let mut largest = 0.0_f64;
    for (point, threshold) in points.iter_mut().zip(thresholds).rev() {
        let predictions = threshold.true_positives + threshold.false_positives;
        if predictions > 0 {
            largest = largest.max(part(threshold) / predictions as f64);
        }
        *point = largest;
    }
    points
}
