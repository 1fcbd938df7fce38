//! Two arms of an experiment, run with the same seeds and judged on the same frames: is their difference more than an
//! accident of seeds and frames?
//!
//! A hierarchical bootstrap (Davison and Hinkley 1997, section 3.8): each resample draws seeds with replacement, and
//! frames. Every run sees the same draw of frames: all runs are judged on the same frames, so what makes a frame hard
//! is common to them and does not average out over seeds. Both arms of a seed are drawn together, so what a seed and a
//! frame do to both of them cancels.
//!
//! With few seeds the spread between them is taken for too small (by a factor of sqrt((n - 1) / n) of n seeds).
//!
//! ```
//! use farsight_eval::ap::{CurveSpec, Metric, OverlapSet};
//! use farsight_eval::paired::{ClaimedEffect, Endpoint, PairedRuns, judge};
//! use farsight_eval::ranging::{Group, RangingMetric, Slice};
//! use farsight_eval::{Bootstrap, Difficulty, EvaluatedClass, Evaluation, Part};
//! # let (with_seed_0, without_seed_0) = (Evaluation::default(), Evaluation::default());
//! # let (with_seed_1, without_seed_1) = (Evaluation::default(), Evaluation::default());
//! let (class, level) = (EvaluatedClass::Car, Difficulty::Moderate);
//! let ap = Endpoint::Ap(CurveSpec::new(OverlapSet::Strict, Metric::Box3d, class, level));
//! let slice = Slice { group: Group::Level(level), part: Part::Whole };
//! let mae = Endpoint::Ranging { metric: RangingMetric::MaeZ, class, slice };
//!
//! let pairs = vec![(&with_seed_0, &without_seed_0), (&with_seed_1, &without_seed_1)];
//! let runs = PairedRuns::new(pairs).ok_or("the runs were judged on different labels")?;
//! let differences = runs.compare(&[ap, mae], &Bootstrap { resamples: 2000, seed: 0 });
//! # assert_eq!(differences.len(), 2);
//! // The claim: AP rises by 0.56 points, and errors fall by 15%.
//! let claims = [ClaimedEffect::Absolute(0.56), ClaimedEffect::Relative(-0.15)];
//! let family: Vec<_> = differences.iter().flatten().zip(claims).collect();
//! for (difference, judgement) in differences.iter().flatten().zip(judge(&family)) {
//!     println!("{:+.2} {:?}: {:?}", difference.difference, difference.interval, judgement.verdict);
//! }
//! # Ok::<(), &str>(())
//! ```

use rayon::prelude::*;
use serde::Serialize;

use crate::ap::{CurveOutcomes, CurveSpec};
use crate::bootstrap::{Bootstrap, Interval};
use crate::ranging::{AlarmLimit, PairedTallies, RangingMetric, Slice, same_objects};
use crate::{EvaluatedClass, Evaluation};

/// The chance of a false alarm that a verdict takes, over a whole family.
const SIGNIFICANCE: f64 = 0.05;

/// What two arms are compared by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Endpoint {
    /// Average precision over 40 points of recall, percent. A run without a usable detection of the class, which the
    /// devkit does not evaluate, has 0.
    Ap(CurveSpec),
    /// A distance error over the objects that **both** arms of a seed found; [`RangingMetric::Share`] over all objects.
    Ranging {
        /// Which figure.
        metric: RangingMetric,
        /// Of which class.
        class: EvaluatedClass,
        /// Of which objects.
        slice: Slice,
    },
    /// Recall at so many false positives an image (FPPI): the share of the objects that count at Moderate that is found
    /// at the lowest score, of multiples of 0.05, with at most so many false alarms a frame; each arm, and each
    /// resample, at a score of its own.
    FoundAtAlarms {
        /// Of which class.
        class: EvaluatedClass,
        /// The most false alarms, a frame.
        most_per_frame: f64,
    },
}

/// Pairs of runs on the same frames, one pair a seed: an arm and what it is compared with.
#[derive(Debug, Clone)]
pub struct PairedRuns<'a> {
    pairs: Vec<(&'a Evaluation, &'a Evaluation)>,
}

/// How two arms differ by one endpoint; the mean over seeds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairedDifference {
    /// Of the arm.
    pub value: f64,
    /// Of what it is compared with.
    pub against: f64,
    /// `value - against`.
    pub difference: f64,
    /// The difference in each seed, in the order of the pairs.
    pub by_seed: Vec<f64>,
    /// 95% interval of the difference.
    pub interval: Option<Interval>,
    /// 95% interval of `value` over seeds and frames; of a ranging endpoint, of the objects that both arms found.
    pub value_interval: Option<Interval>,
    /// The differences of the resamples that have one, smallest first.
    #[serde(skip)]
    resamples: Vec<f64>,
}

/// An effect that somebody claims.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ClaimedEffect {
    /// A difference in the endpoint's unit.
    Absolute(f64),
    /// A difference as a share of what the arm is compared with, as measured here: -0.15 is 15% less.
    Relative(f64),
}

/// What the data say of a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// There is an effect in the direction claimed: chance is ruled out. It may still be smaller than claimed
    /// ([`Judgement::excludes_effect`]).
    Supported,
    /// The claimed effect is ruled out and nothing in its direction is shown, or an effect in the other direction is.
    Refuted,
    /// The data allow both the claimed effect and none.
    Undecided,
}

/// A claim judged within its family.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Judgement {
    /// The verdict.
    pub verdict: Verdict,
    /// The difference that was claimed, in the endpoint's unit.
    pub claimed: f64,
    /// How often a difference like this one would come up without any effect; Holm's correction for the family.
    pub p_zero: f64,
    /// The same if the effect were as large as claimed.
    pub p_effect: f64,
    /// Whether no effect at all is ruled out.
    pub excludes_zero: bool,
    /// Whether the effect as large as claimed is ruled out.
    pub excludes_effect: bool,
}

impl<'a> PairedRuns<'a> {
    /// Pairs of runs; `None` without any, or when not all of them were judged on the same frames and labels.
    pub fn new(pairs: Vec<(&'a Evaluation, &'a Evaluation)>) -> Option<Self> {
        let (first, _) = *pairs.first()?;
        let same =
            |other: &Evaluation| first.frames() == other.frames() && same_objects(first.targets(), other.targets());
        pairs.iter().all(|(ours, theirs)| same(ours) && same(theirs)).then_some(Self { pairs })
    }

    /// Compares the arms by each endpoint, in their order; `None` where there is nothing to compare: no object counts,
    /// or both arms of a seed found none.
    pub fn compare(&self, endpoints: &[Endpoint], bootstrap: &Bootstrap) -> Vec<Option<PairedDifference>> {
        let frames = self.pairs[0].0.frames();
        let by_pair: Vec<Vec<Drawn>> =
            self.pairs.iter().map(|pair| drawn_of_pair(*pair, frames, endpoints, bootstrap)).collect();
        let seeds: Vec<Vec<u32>> =
            (0..bootstrap.resamples).map(|index| bootstrap.draw_runs(self.pairs.len(), index)).collect();
        (0..endpoints.len())
            .into_par_iter()
            .map(|endpoint| {
                PairedDifference::new(&by_pair.iter().map(|drawn| &drawn[endpoint]).collect::<Vec<_>>(), &seeds)
            })
            .collect()
    }
}

/// One endpoint of one seed, of both arms: with all frames, and in each resample of the frames.
struct Drawn {
    values: [f64; 2],
    resamples: Vec<[f64; 2]>,
}

fn drawn_of_pair(
    (ours, theirs): (&Evaluation, &Evaluation),
    frames: usize,
    endpoints: &[Endpoint],
    bootstrap: &Bootstrap,
) -> Vec<Drawn> {
    let curves: Vec<CurveSpec> = endpoints.iter().filter_map(Endpoint::curve).collect();
    let outcomes = [ours, theirs].map(|arm| arm.curve_outcomes(&curves));
    let [ours_ap, theirs_ap] = outcomes.map(|outcomes| resampled(&outcomes, frames, bootstrap));
    let mut of_curves = ours_ap.into_iter().zip(theirs_ap).map(|(ours, theirs)| Drawn {
        values: [ours.0, theirs.0],
        resamples: ours.1.iter().zip(&theirs.1).map(|(ours, theirs)| [*ours, *theirs]).collect(),
    });
    let of_endpoint = |endpoint: &Endpoint| match *endpoint {
        Endpoint::Ap(_) => of_curves.next(),
        Endpoint::Ranging { metric, class, slice } => {
            let tallies = PairedTallies::new([ours.targets(), theirs.targets()], metric, class, slice);
            let resamples = (0..bootstrap.resamples)
                .into_par_iter()
                .map(|index| tallies.values(Some(&bootstrap.draw(frames, index))));
            Some(Drawn { values: tallies.values(None), resamples: resamples.collect() })
        }
        Endpoint::FoundAtAlarms { class, most_per_frame } => {
            let limit =
                |arm: &Evaluation| AlarmLimit::new(arm.targets(), arm.false_alarms(), frames, class, most_per_frame);
            let arms = [ours, theirs].map(limit);
            let values = |drawn: Option<&[u32]>| arms.each_ref().map(|arm| arm.share(drawn));
            let resamples =
                (0..bootstrap.resamples).into_par_iter().map(|index| values(Some(&bootstrap.draw(frames, index))));
            Some(Drawn { values: values(None), resamples: resamples.collect() })
        }
    };
    endpoints.iter().filter_map(of_endpoint).collect()
}

/// AP of each curve with all frames, and in each resample of them; where a curve is not evaluated, 0 of as many.
fn resampled(outcomes: &[Option<CurveOutcomes>], frames: usize, bootstrap: &Bootstrap) -> Vec<(f64, Vec<f64>)> {
    let there: Vec<_> = outcomes.iter().flatten().collect();
    let mut drawn = CurveOutcomes::resampled(&there, frames, bootstrap).into_iter();
    let all = vec![1; frames];
    let of_curve = |outcomes: &Option<CurveOutcomes>| match outcomes {
        Some(outcomes) => {
            (outcomes.drawn_ap(&all).r40, drawn.next().unwrap_or_default().iter().map(|ap| ap.r40).collect())
        }
        None => (0.0, vec![0.0; bootstrap.resamples]),
    };
    outcomes.iter().map(of_curve).collect()
}

impl Endpoint {
    fn curve(&self) -> Option<CurveSpec> {
        match self {
            Self::Ap(curve) => Some(*curve),
            Self::Ranging { .. } | Self::FoundAtAlarms { .. } => None,
        }
    }
}

impl PairedDifference {
    /// From one endpoint of each pair, and how often each pair comes up in each resample.
    fn new(pairs: &[&Drawn], seeds: &[Vec<u32>]) -> Option<Self> {
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / pairs.len() as f64;
        let [value, against] = [0, 1].map(|arm| mean(&mut pairs.iter().map(|drawn| drawn.values[arm])));
        let by_seed: Vec<f64> = pairs.iter().map(|drawn| drawn.values[0] - drawn.values[1]).collect();
        let resampled = |of: &dyn Fn([f64; 2]) -> f64| {
            let resample = |(index, counts): (usize, &Vec<u32>)| {
                let of_pair = |(drawn, count): (&&Drawn, &u32)| f64::from(*count) * of(drawn.resamples[index]);
                // A pair that is not drawn has no say, not even one that is no number.
                mean(&mut pairs.iter().zip(counts).filter(|(_, count)| **count > 0).map(of_pair))
            };
            let mut resamples: Vec<f64> = seeds.iter().enumerate().map(resample).collect();
            (Interval::of(&mut resamples), resamples)
        };
        let (value_interval, _) = resampled(&|[ours, _]| ours);
        let (interval, resamples) = resampled(&|[ours, theirs]| ours - theirs);
        let difference = value - against;
        difference.is_finite().then_some(Self {
            value,
            against,
            difference,
            by_seed,
            interval,
            value_interval,
            resamples,
        })
    }

    /// How often chance would bring a difference as far from `truth` as this one, were `truth` the true difference: two
    /// sided, by the share of the resamples beyond it; at least one in the number of resamples.
    pub fn p_value(&self, truth: f64) -> f64 {
        let count = self.resamples.len() as f64;
        let below = self.resamples.iter().filter(|value| **value <= truth).count() as f64;
        let above = self.resamples.iter().filter(|value| **value >= truth).count() as f64;
        (2.0 * (below.min(above) + 1.0) / (count + 1.0)).min(1.0)
    }
}

impl ClaimedEffect {
    fn of(self, difference: &PairedDifference) -> f64 {
        match self {
            Self::Absolute(effect) => effect,
            Self::Relative(share) => share * difference.against,
        }
    }
}

/// p values corrected for being several (Holm 1979): the chance that any of them falls below a limit by accident is at
/// most the limit. In the order in which they were given.
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|&a, &b| p_values[a].total_cmp(&p_values[b]));
    let mut corrected = vec![0.0; p_values.len()];
    let mut largest = 0.0_f64;
    for (rank, &index) in order.iter().enumerate() {
        largest = largest.max((p_values.len() - rank) as f64 * p_values[index]).min(1.0);
        corrected[index] = largest;
    }
    corrected
}

/// Judges the claims of a family, each by its difference, with a chance of 5% that any of them is wrongly taken for
/// real, and likewise for wrongly ruled out.
///
/// Holm's correction holds for the p values; an interval of [`PairedDifference`] is that of its difference alone.
pub fn judge(family: &[(&PairedDifference, ClaimedEffect)]) -> Vec<Judgement> {
    let claimed: Vec<f64> = family.iter().map(|(difference, claim)| claim.of(difference)).collect();
    let p_zero = holm(&family.iter().map(|(difference, _)| difference.p_value(0.0)).collect::<Vec<_>>());
    let p_effect: Vec<f64> = family.iter().zip(&claimed).map(|((d, _), claimed)| d.p_value(*claimed)).collect();
    let p_effect = holm(&p_effect);
    let judgement = |(i, (difference, _)): (usize, &(&PairedDifference, ClaimedEffect))| {
        let (claimed, p_zero, p_effect) = (claimed[i], p_zero[i], p_effect[i]);
        let (excludes_zero, excludes_effect) = (p_zero < SIGNIFICANCE, p_effect < SIGNIFICANCE);
        let is_as_claimed = difference.difference * claimed > 0.0;
        let is_short_of_claim = (claimed - difference.difference) * claimed > 0.0;
        let verdict = match (excludes_zero, excludes_effect) {
            (true, _) if is_as_claimed => Verdict::Supported,
            (true, _) => Verdict::Refuted,
            (false, true) if is_short_of_claim => Verdict::Refuted,
            (false, _) => Verdict::Undecided,
        };
        Judgement { verdict, claimed, p_zero, p_effect, excludes_zero, excludes_effect }
    };
    family.iter().enumerate().map(judgement).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A difference whose resamples lie evenly from `low` to `high`.
    fn difference(low: f64, high: f64) -> PairedDifference {
        let mut resamples: Vec<f64> = (0..2001).map(|i| low + (high - low) * f64::from(i) / 2000.0).collect();
        let (difference, interval) = (f64::midpoint(low, high), Interval::of(&mut resamples));
        PairedDifference {
            value: 10.0 + difference,
            against: 10.0,
            difference,
            by_seed: vec![difference],
            interval,
            value_interval: None,
            resamples,
        }
    }

    #[test]
    fn p_values_are_corrected_as_holm_has_it() {
        // Worked by hand: 4 * 0.005, 3 * 0.01, 2 * 0.03; 0.04 may not fall below the one before it.
        let corrected = holm(&[0.01, 0.04, 0.03, 0.005]);
        for (got, want) in corrected.iter().zip([0.03, 0.06, 0.06, 0.02]) {
            assert!((got - want).abs() < 1e-12, "{corrected:?}");
        }
        assert_eq!(holm(&[0.6, 0.7]), [1.0, 1.0]);
        assert!(holm(&[]).is_empty());
    }

    #[test]
    fn a_p_value_is_twice_the_share_beyond() {
        let evenly = difference(-1.0, 3.0);
        assert!((evenly.p_value(0.0) - 0.5).abs() < 0.002, "{}", evenly.p_value(0.0));
        assert!((evenly.p_value(1.0) - 1.0).abs() < 0.002, "{}", evenly.p_value(1.0));
        // Never 0: no number of resamples shows that.
        assert!((evenly.p_value(9.0) - 2.0 / 2002.0).abs() < 1e-9, "{}", evenly.p_value(9.0));
    }

    #[test]
    fn verdicts_follow_from_what_is_ruled_out() {
        use Verdict::{Refuted, Supported, Undecided};
        let absolute = ClaimedEffect::Absolute;
        let cases = [
            ("as claimed", (0.2, 0.9), absolute(0.5), Supported, [true, false]),
            ("less than claimed", (0.1, 0.3), absolute(0.5), Supported, [true, true]),
            ("more than claimed", (0.7, 0.9), absolute(0.5), Supported, [true, true]),
            ("next to nothing", (-0.1, 0.2), absolute(0.5), Refuted, [false, true]),
            ("the other way", (-0.9, -0.2), absolute(0.5), Refuted, [true, true]),
            ("too wide", (-0.3, 0.9), absolute(0.5), Undecided, [false, false]),
            ("a fall as claimed", (-2.0, -1.0), ClaimedEffect::Relative(-0.15), Supported, [true, false]),
            ("no fall", (-0.4, 0.4), ClaimedEffect::Relative(-0.15), Refuted, [false, true]),
        ];
        for (name, (low, high), claim, verdict, excludes) in cases {
            let judged = judge(&[(&difference(low, high), claim)])[0];
            assert_eq!(judged.verdict, verdict, "{name}: {judged:?}");
            assert_eq!([judged.excludes_zero, judged.excludes_effect], excludes, "{name}: {judged:?}");
        }
    }

    #[test]
    fn a_family_asks_for_more() {
        // 1.3% of the resamples below 0: enough alone (p 0.026), too little for one of three.
        let weak = difference(-0.013, 0.987);
        let claim = ClaimedEffect::Absolute(0.5);
        assert_eq!(judge(&[(&weak, claim)])[0].verdict, Verdict::Supported);
        let three = judge(&[(&weak, claim), (&weak, claim), (&weak, claim)]);
        assert!(three.iter().all(|judged| judged.verdict == Verdict::Undecided), "{three:?}");
    }
}
