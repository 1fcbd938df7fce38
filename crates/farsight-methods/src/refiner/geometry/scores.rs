//! One score from two stages: how likely a detection is right, fitted on labelled frames.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use farsight_core::ObjectClass;
use farsight_core::linear::dot;
use farsight_core::score::{logistic, logit, most_likely};

/// What speaks for a detection after both stages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    /// The detector's score, 0 to 1, both excluded.
    pub score: f64,
    /// Log odds, by the refiner, that it is what the detector says, or what that is easily taken for
    /// ([`farsight_core::ObjectClass::is_like`]).
    pub kind: f64,
    /// Overlap of both boxes in the image, 0 to 1: who takes something for a car agrees on where its edges are if it is
    /// one.
    pub overlap: f64,
}

impl Evidence {
    fn terms(&self) -> [f64; 4] {
        [logit(self.score), self.kind, self.overlap, 1.0]
    }
}

/// A detection that was looked at twice and of which is known whether it is right.
#[derive(Debug, Clone, PartialEq)]
pub struct FusedScoreExample {
    /// What it is by the stage that the fit is for: the detector, or the refiner.
    pub class: ObjectClass,
    /// What speaks for it.
    pub evidence: Evidence,
    /// Whether there is such an object.
    pub is_right: bool,
}

/// A fit for one class: coefficients of the logit of the probability (logistic regression).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FusedScore {
    /// Of the logit of the detector's score.
    pub score: f64,
    /// Of the refiner's log odds.
    pub kind: f64,
    /// Of the overlap.
    pub overlap: f64,
    /// Added.
    pub bias: f64,
}

impl FusedScore {
    /// The fit to some examples; none with fewer than [`MIN_EXAMPLES`](farsight_core::score::MIN_EXAMPLES) right or
    /// wrong ones.
    fn fit<'a>(examples: impl Iterator<Item = &'a FusedScoreExample>) -> Option<Self> {
        let rows: Vec<_> =
            examples.map(|example| (example.evidence.terms(), f64::from(u8::from(example.is_right)))).collect();
        let [score, kind, overlap, bias] = most_likely(&rows)?;
        Some(Self { score, kind, overlap, bias })
    }

    fn probability(&self, evidence: &Evidence) -> f64 {
        logistic(dot(&evidence.terms(), &[self.score, self.kind, self.overlap, self.bias]))
    }
}

/// The scores after two stages.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct FusedScores {
    /// By class.
    classes: BTreeMap<ObjectClass, FusedScore>,
}

impl FusedScores {
    /// The fit to `examples`: a class with enough of them gets that of its own ones, the others of `classes` that of
    /// all. None with fewer than [`MIN_EXAMPLES`](farsight_core::score::MIN_EXAMPLES) right or wrong ones in all.
    pub fn fit(examples: &[FusedScoreExample], classes: &[ObjectClass]) -> Option<Self> {
        let of_all = FusedScore::fit(examples.iter())?;
        let of = |class: &ObjectClass| FusedScore::fit(examples.iter().filter(|example| example.class == *class));
        let classes = classes.iter().map(|class| (class.clone(), of(class).unwrap_or(of_all))).collect();
        Some(Self { classes })
    }

    /// The fit to `examples` for the classes that have enough of them, and for no others.
    pub fn fit_where_enough(examples: &[FusedScoreExample]) -> Self {
        let named: BTreeSet<&ObjectClass> = examples.iter().map(|example| &example.class).collect();
        let of = |class: &ObjectClass| FusedScore::fit(examples.iter().filter(|example| example.class == *class));
        let classes = named.into_iter().filter_map(|class| Some((class.clone(), of(class)?))).collect();
        Self { classes }
    }

    /// Whether no class was fitted.
    pub fn is_empty(&self) -> bool {
        self.classes.is_empty()
    }

    /// The classes that were fitted.
    pub fn classes(&self) -> impl Iterator<Item = &ObjectClass> {
        self.classes.keys()
    }

    /// Whether these are numbers that a fit could have given: files from strangers may hold others.
    pub fn is_usable(&self) -> bool {
        let numbers = |fit: &FusedScore| [fit.score, fit.kind, fit.overlap, fit.bias];
        self.classes.values().flat_map(numbers).all(|number| number.abs() <= 100.0)
    }

    /// The probability that a detection of `class` is right; none of a class that was not fitted.
    pub fn probability(&self, class: &ObjectClass, evidence: &Evidence) -> Option<f64> {
        Some(self.classes.get(class)?.probability(evidence))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUTH: FusedScore = FusedScore { score: 0.7, kind: 0.5, overlap: 3.0, bias: -2.0 };

    /// Examples on a grid, each as often right as the law says.
    fn examples(class: &ObjectClass, law: &FusedScore, each: u32) -> Vec<FusedScoreExample> {
        let mut examples = Vec::new();
        for score in [0.05, 0.2, 0.5, 0.8] {
            for kind in [-4.0, -1.0, 1.0, 4.0] {
                for overlap in [0.2, 0.6, 0.9] {
                    let evidence = Evidence { score, kind, overlap };
                    let right = (law.probability(&evidence) * f64::from(each)).round() as u32;
                    let example = |i| FusedScoreExample { class: class.clone(), evidence, is_right: i < right };
                    examples.extend((0..each).map(example));
                }
            }
        }
        examples
    }

    #[test]
    fn a_fit_finds_the_law_of_each_class() {
        let other = FusedScore { kind: 1.0, bias: 0.5, ..TRUTH };
        let (car, cyclist) = (ObjectClass::Car, ObjectClass::Cyclist);
        let all = [examples(&car, &TRUTH, 1000), examples(&cyclist, &other, 1000)].concat();
        let fit = FusedScores::fit(&all, &[car.clone(), cyclist.clone()]).expect("enough examples");
        assert!(fit.is_usable());
        for (class, law) in [(car, TRUTH), (cyclist, other)] {
            for score in [0.1, 0.4, 0.9] {
                let evidence = Evidence { score, kind: 0.5, overlap: 0.7 };
                let off = fit.probability(&class, &evidence).expect("fitted") - law.probability(&evidence);
                assert!(off.abs() < 0.01, "{class} with {evidence:?}: off by {off}");
            }
        }
    }

    #[test]
    fn a_class_with_few_examples_gets_the_fit_of_all_where_it_is_asked_for() {
        let (car, van) = (ObjectClass::Car, ObjectClass::Van);
        let mut all = examples(&car, &TRUTH, 100);
        all.extend(examples(&van, &TRUTH, 100).into_iter().take(20));
        let fit = FusedScores::fit(&all, &[car.clone(), van.clone()]).expect("enough examples");
        let evidence = Evidence { score: 0.3, kind: 2.0, overlap: 0.8 };
        let law = TRUTH.probability(&evidence);
        let of_van = fit.probability(&van, &evidence).expect("that of all");
        assert!((of_van - law).abs() < 0.05 && law > 0.5);
        assert_eq!(fit.probability(&ObjectClass::Tram, &evidence), None);
        let alone = FusedScores::fit_where_enough(&all);
        assert_eq!(alone.classes().collect::<Vec<_>>(), [&car], "20 vans are too few");
        assert_eq!(FusedScores::fit(&all[..20], &[car]), None);
    }

    #[test]
    fn numbers_that_no_fit_gives_are_told_apart() {
        for bias in [f64::NAN, 1e9] {
            let classes = [(ObjectClass::Car, FusedScore { bias, ..TRUTH })].into();
            assert!(!FusedScores { classes }.is_usable(), "{bias}");
        }
    }
}
