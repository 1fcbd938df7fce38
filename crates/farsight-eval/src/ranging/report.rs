//! The ranging report: every metric of every slice, with intervals.

use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use super::calibration::Calibration;
use super::matching::Target;
use super::metrics::{RangingMetric, RangingMetrics};
use super::options::RangingOptions;
use super::slices::{Group, Slice};
use super::tally::{Tallies, Tally};
use crate::EvaluatedClass;
use crate::bootstrap::{Bootstrap, Interval};
use crate::parts::Part;

/// The share of objects at which detectors are compared on equal terms.
pub const FIXED_RECALL: f64 = 0.7;

/// Ranging errors of a set of frames, by class; in JSON a map from class to groups.
#[derive(Debug, Clone, PartialEq)]
pub struct RangingReport {
    /// One for every evaluated class that has objects.
    pub classes: Vec<ClassRanging>,
}

/// Ranging errors of one class.
#[derive(Debug, Clone, PartialEq)]
pub struct ClassRanging {
    /// The class.
    pub class: EvaluatedClass,
    /// One for every [`Group`].
    pub groups: Vec<GroupRanging>,
}

/// Ranging errors of the objects of one class that count at one difficulty, or of all.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GroupRanging {
    /// Which objects.
    #[serde(skip)]
    pub group: Group,
    /// Over all of them.
    #[serde(flatten)]
    pub whole: SliceErrors,
    /// With as many detections, best scores first, as it takes to find 70% of the objects; `None` when fewer are found
    /// at all.
    #[serde(rename = "recall_0.7")]
    pub fixed_recall: Option<FixedRecall>,
    /// By height in the image.
    pub by_height: Named<SliceErrors>,
    /// By true z.
    pub by_distance: Named<SliceErrors>,
    /// By KITTI's occlusion level.
    pub by_occlusion: Named<SliceErrors>,
    /// By share outside the image.
    pub by_truncation: Named<SliceErrors>,
    /// How far the error bars can be believed; `None` when no detection carries one.
    pub calibration: Option<Calibration>,
}

/// Errors at the score where a fixed share of the objects is found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FixedRecall {
    /// The lowest score that takes part.
    pub score: f64,
    /// The errors; intervals are for this score, as if it had been fixed beforehand.
    #[serde(flatten)]
    pub errors: SliceErrors,
}

/// Errors of one slice.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SliceErrors {
    /// How many objects there are.
    pub objects: usize,
    /// How many were found.
    pub found: usize,
    /// The figures; `None` without anything to take the mean of.
    #[serde(flatten)]
    pub metrics: RangingMetrics<Option<f64>>,
    /// 95% intervals, when they were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intervals: Option<RangingMetrics<Option<Interval>>>,
}

/// Rows with names; in JSON a map in this order.
#[derive(Debug, Clone, PartialEq)]
pub struct Named<T>(pub Vec<(&'static str, T)>);

impl<T: Serialize> Serialize for Named<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(name, row)| (name, row)))
    }
}

impl Serialize for RangingReport {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.classes.len()))?;
        for class in &self.classes {
            let groups = Named(class.groups.iter().map(|group| (group.group.name(), group)).collect());
            map.serialize_entry(class.class.name(), &groups)?;
        }
        map.end()
    }
}

impl RangingReport {
    /// The report on `targets`, which come from `frames` frames ([`super::targets`] of each).
    pub fn new(targets: &[Target], frames: usize, options: &RangingOptions) -> Self {
        let classes = EvaluatedClass::ALL.into_iter().filter_map(|class| {
            let of_class: Vec<_> = targets.iter().filter(|target| target.class == class).collect();
            (!of_class.is_empty()).then(|| ClassRanging::new(class, &of_class, frames, options))
        });
        Self { classes: classes.collect() }
    }

    /// The errors of one class in one group; `None` when the class has no objects.
    pub fn group(&self, class: EvaluatedClass, group: Group) -> Option<&GroupRanging> {
        let of_class = self.classes.iter().find(|c| c.class == class)?;
        of_class.groups.iter().find(|g| g.group == group)
    }
}

impl ClassRanging {
    fn new(class: EvaluatedClass, targets: &[&Target], frames: usize, options: &RangingOptions) -> Self {
        let bootstrap = options.bootstrap.as_ref();
        let slices = Slice::all();
        let mut errors = errors_of_slices(targets.iter().copied(), &slices, frames, bootstrap).into_iter();
        // The rows come in the order of `Slice::all`: group by group, the whole and then each table.
        let mut table = |rows: Vec<(&'static str, Part)>| {
            Named(rows.iter().zip(&mut errors).map(|((name, _), row)| (*name, row)).collect())
        };
        let groups = Group::ALL.map(|group| {
            let members: Vec<_> = targets.iter().copied().filter(|target| group.holds(target.difficulty)).collect();
            let mut whole = table(vec![("", Part::Whole)]).0;
            let [by_height, by_distance, by_occlusion, by_truncation] = Part::divisions().map(&mut table);
            GroupRanging {
                group,
                whole: whole.remove(0).1,
                fixed_recall: FixedRecall::new(group, &members, frames, bootstrap),
                by_height,
                by_distance,
                by_occlusion,
                by_truncation,
                calibration: Calibration::new(&members, options.interval_sigmas),
            }
        });
        Self { class, groups: groups.into() }
    }
}

impl FixedRecall {
    fn new(group: Group, targets: &[&Target], frames: usize, bootstrap: Option<&Bootstrap>) -> Option<Self> {
        let score = score_at_recall(targets, FIXED_RECALL)?;
        // Dropping detections of lower scores leaves the other matches as they are: higher scores choose first.
        let kept: Vec<Target> = targets
            .iter()
            .map(|&target| Target { found: target.found.filter(|found| found.score >= score), ..target.clone() })
            .collect();
        let slice = Slice { group, part: Part::Whole };
        let errors = errors_of_slices(&kept, &[slice], frames, bootstrap).pop()?;
        Some(Self { score, errors })
    }
}

/// The highest score limit at which at least this share of the objects is found.
fn score_at_recall(targets: &[&Target], recall: f64) -> Option<f64> {
    let mut scores: Vec<_> = targets.iter().filter_map(|target| Some(target.found?.score)).collect();
    scores.sort_unstable_by(|a, b| b.total_cmp(a));
    let needed = (recall * targets.len() as f64).ceil() as usize;
    scores.get(needed.checked_sub(1)?).copied()
}

fn errors_of_slices<'a>(
    targets: impl IntoIterator<Item = &'a Target>,
    slices: &[Slice],
    frames: usize,
    bootstrap: Option<&Bootstrap>,
) -> Vec<SliceErrors> {
    let tallies = Tallies::new(targets);
    let intervals = bootstrap.map(|bootstrap| {
        bootstrap.intervals(frames, |drawn| values(&tallies.of_slices(slices, Some(drawn))).collect())
    });
    let totals = tallies.of_slices(slices, None);
    let errors = totals.iter().enumerate().map(|(row, tally)| SliceErrors {
        objects: tally.objects as usize,
        found: tally.found as usize,
        metrics: tally.metrics(),
        intervals: intervals
            .as_ref()
            .map(|all| RangingMetrics::from_fn(|f| all[row * RangingMetric::COUNT + f as usize])),
    });
    errors.collect()
}

/// The figures of all tallies one after another, NaN where there is none.
fn values(tallies: &[Tally]) -> impl Iterator<Item = f64> {
    tallies
        .iter()
        .flat_map(|tally| tally.metrics().iter().map(|(_, value)| value.unwrap_or(f64::NAN)).collect::<Vec<_>>())
}
