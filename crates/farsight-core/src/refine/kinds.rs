//! What the second look takes a cut-out for.

use crate::ObjectClass;

/// How many kinds are told apart.
pub const KINDS: usize = 1 + CLASSES.len();

/// The kind of what a detector mistook for an object.
pub const NOTHING: usize = 0;

/// The classes that are kinds of their own, after [`NOTHING`].
const CLASSES: [ObjectClass; 5] =
    [ObjectClass::Car, ObjectClass::Van, ObjectClass::Truck, ObjectClass::Cyclist, ObjectClass::Pedestrian];

/// Log odds beyond this, either way, count as this: a network can be surer than it has reason to be.
const MOST_LOG_ODDS: f64 = 8.0;

/// The kind of an object of `class`; none of a class that is not told from others.
pub fn kind_of(class: &ObjectClass) -> Option<usize> {
    let class = if *class == ObjectClass::PersonSitting { &ObjectClass::Pedestrian } else { class };
    CLASSES.iter().position(|known| known == class).map(|place| place + 1)
}

/// The log odds of one kind against all others, by the logits of all; 0 where they are no numbers.
pub(super) fn log_odds(logits: &[f64; KINDS], kind: usize) -> f64 {
    let others = || (0..KINDS).filter(|other| *other != kind).map(|other| logits[other]);
    let highest = others().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = others().map(|logit| (logit - highest).exp()).sum();
    let odds = logits[kind] - highest - sum.ln();
    if odds.is_nan() { 0.0 } else { odds.clamp(-MOST_LOG_ODDS, MOST_LOG_ODDS) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::logistic;

    #[test]
    fn classes_are_kinds_and_none_is_nothing() {
        for class in ObjectClass::KITTI {
            let kind = kind_of(&class);
            assert!(kind.is_none_or(|kind| kind != NOTHING && kind < KINDS), "{class}");
        }
        assert_eq!(kind_of(&ObjectClass::PersonSitting), kind_of(&ObjectClass::Pedestrian));
        assert_ne!(kind_of(&ObjectClass::Car), kind_of(&ObjectClass::Van));
        assert_eq!(kind_of(&ObjectClass::Tram), None);
    }

    #[test]
    fn log_odds_are_those_of_softmax() {
        let logits: [f64; KINDS] = [0.3, 2.0, -1.0, 0.5, 1.5, -4.0];
        let sum: f64 = logits.iter().map(|logit| logit.exp()).sum();
        for kind in 0..KINDS {
            assert!((logistic(log_odds(&logits, kind)) - logits[kind].exp() / sum).abs() < 1e-12, "kind {kind}");
        }
        let far = [0.0, 1e300, 0.0, 0.0, 0.0, 0.0];
        assert!((log_odds(&far, 1) - MOST_LOG_ODDS).abs() < 1e-12 && (log_odds(&far, 0) + MOST_LOG_ODDS).abs() < 1e-12);
        assert!(log_odds(&[f64::NAN; KINDS], 1).abs() < 1e-12);
        assert!(log_odds(&[f64::INFINITY; KINDS], 1).abs() < 1e-12);
    }
}
