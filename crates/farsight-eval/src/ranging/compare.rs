//! Two result sets on the same frames: is the difference real?

use serde::Serialize;

use super::matching::Target;
use super::metrics::{RangingMetric, RangingMetrics};
use super::slices::{Group, Slice};
use super::tally::{Tallies, Tally};
use crate::EvaluatedClass;
use crate::bootstrap::{Bootstrap, Interval};
use crate::parts::Part;

/// Ranging figures of two detectors side by side.
///
/// Errors are compared on the objects that **both** found, shares on all objects: otherwise the detector that finds
/// more hard objects would look worse. Frames are drawn together for both, so what makes a frame hard for both
/// cancels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RangingComparison {
    /// Whether both say the same: of every object, and from
    /// [`Evaluation::compared_with`](crate::Evaluation::compared_with) of everything that any figure is made of.
    pub identical: bool,
    /// One row for every class with objects, group, and range of distances.
    pub rows: Vec<ComparisonRow>,
}

/// The comparison over one slice of one class.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparisonRow {
    /// The class.
    pub class: EvaluatedClass,
    /// `easy`, `moderate`, `hard` or `all`.
    pub group: &'static str,
    /// Metres of true z, or `all`.
    pub distance: &'static str,
    /// Objects in the slice.
    pub objects: usize,
    /// Objects that both found.
    pub found_by_both: usize,
    /// The metrics.
    #[serde(rename = "figures")]
    pub metrics: RangingMetrics<Option<Difference>>,
}

/// One metric of two detectors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Difference {
    /// Of the results.
    pub value: f64,
    /// Of the results they are compared with.
    pub against: f64,
    /// `value - against`.
    pub difference: f64,
    /// 95% interval of the difference.
    pub interval: Option<Interval>,
    /// Whether the interval leaves zero out.
    pub excludes_zero: bool,
}

/// The targets of one class for both detectors: all, and those that both found.
struct Paired {
    all: [Tallies; 2],
    common: [Tallies; 2],
}

impl RangingComparison {
    /// Compares two sets of targets made from the **same** labels in the same order; `frames` is the number of frames.
    ///
    /// Returns `None` when the labels differ.
    pub fn new(ours: &[Target], theirs: &[Target], frames: usize, bootstrap: &Bootstrap) -> Option<Self> {
        if !same_objects(ours, theirs) {
            return None;
        }
        let rows = EvaluatedClass::ALL.into_iter().filter_map(|class| {
            let pairs: Vec<_> = ours.iter().zip(theirs).filter(|(target, _)| target.class == class).collect();
            (!pairs.is_empty()).then(|| rows_of_class(class, &pairs, frames, bootstrap))
        });
        Some(Self { identical: ours == theirs, rows: rows.flatten().collect() })
    }
}

/// Whether two sets of targets are of the same labels in the same order.
pub(crate) fn same_objects(ours: &[Target], theirs: &[Target]) -> bool {
    let unfound = |target: &Target| Target { found: None, ..target.clone() };
    ours.len() == theirs.len() && ours.iter().zip(theirs).all(|(a, b)| unfound(a) == unfound(b))
}

fn rows_of_class(
    class: EvaluatedClass,
    pairs: &[(&Target, &Target)],
    frames: usize,
    bootstrap: &Bootstrap,
) -> Vec<ComparisonRow> {
    let [_, distances, ..] = Part::divisions();
    let parts: Vec<_> = std::iter::once(("all", Part::Whole)).chain(distances).collect();
    let named: Vec<_> = Group::ALL.iter().flat_map(|group| parts.iter().map(move |part| (*group, *part))).collect();
    let slices: Vec<_> = named.iter().map(|(group, (_, part))| Slice { group: *group, part: *part }).collect();
    let paired = Paired::new(pairs);

    let intervals = bootstrap.intervals(frames, |drawn| {
        let values = paired.values(&slices, Some(drawn));
        values.iter().flat_map(|row| row.iter().map(|(_, [a, b])| a - b).collect::<Vec<_>>()).collect()
    });
    let values = paired.values(&slices, None);
    let objects = paired.all[0].of_slices(&slices, None);
    let common = paired.common[0].of_slices(&slices, None);
    let rows = named.iter().enumerate().map(|(i, (group, (distance, _)))| ComparisonRow {
        class,
        group: group.name(),
        distance,
        objects: objects[i].objects as usize,
        found_by_both: common[i].objects as usize,
        metrics: RangingMetrics::from_fn(|f| {
            Difference::new(values[i].get(f), intervals[i * RangingMetric::COUNT + f as usize])
        }),
    });
    rows.collect()
}

impl Paired {
    fn new(pairs: &[(&Target, &Target)]) -> Self {
        let both = || pairs.iter().filter(|(a, b)| a.found.is_some() && b.found.is_some());
        Self {
            all: [Tallies::new(pairs.iter().map(|p| p.0)), Tallies::new(pairs.iter().map(|p| p.1))],
            common: [Tallies::new(both().map(|p| p.0)), Tallies::new(both().map(|p| p.1))],
        }
    }

    /// Both detectors' figures of each slice, NaN where there is none.
    fn values(&self, slices: &[Slice], drawn: Option<&[u32]>) -> Vec<RangingMetrics<[f64; 2]>> {
        let figures = |tallies: &[Tallies; 2]| {
            tallies.each_ref().map(|t| t.of_slices(slices, drawn).iter().map(Tally::metrics).collect::<Vec<_>>())
        };
        let (all, common) = (figures(&self.all), figures(&self.common));
        let row = |i: usize| {
            RangingMetrics::from_fn(|metric| {
                let source = if metric == RangingMetric::Share { &all } else { &common };
                source.each_ref().map(|rows| rows[i].get(metric).unwrap_or(f64::NAN))
            })
        };
        (0..slices.len()).map(row).collect()
    }
}

impl Difference {
    fn new([value, against]: [f64; 2], interval: Option<Interval>) -> Option<Self> {
        let difference = value - against;
        let excludes_zero = interval.is_some_and(|i| i.excludes_zero());
        difference.is_finite().then_some(Self { value, against, difference, interval, excludes_zero })
    }
}

/// One figure of two detectors over one slice, by frame.
pub(crate) struct PairedTallies {
    metric: RangingMetric,
    arms: [Tallies; 2],
    slice: Slice,
}

impl PairedTallies {
    /// From the targets of both, which must be of the same objects.
    pub(crate) fn new(targets: [&[Target]; 2], metric: RangingMetric, class: EvaluatedClass, slice: Slice) -> Self {
        let [ours, theirs] = targets;
        let pairs = || {
            let of_slice = ours.iter().zip(theirs).filter(move |(ours, _)| ours.class == class && slice.holds(ours));
            // Shares are of all objects, errors of those that both found.
            of_slice.filter(move |(a, b)| metric == RangingMetric::Share || (a.found.is_some() && b.found.is_some()))
        };
        Self { metric, arms: [Tallies::new(pairs().map(|p| p.0)), Tallies::new(pairs().map(|p| p.1))], slice }
    }

    /// The figure of both, NaN where there is none.
    pub(crate) fn values(&self, drawn: Option<&[u32]>) -> [f64; 2] {
        self.arms.each_ref().map(|tallies| {
            let tally = tallies.of_slices(&[self.slice], drawn);
            tally.first().and_then(|tally| tally.metrics().get(self.metric)).unwrap_or(f64::NAN)
        })
    }
}
