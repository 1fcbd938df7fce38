//! What the refiner takes a cut-out for.

use farsight_core::ObjectClass;

/// How many kinds are told apart.
pub const KINDS: usize = 1 + CLASSES.len();

/// The kind of what a detector mistook for an object.
pub const NOTHING: usize = 0;

/// The classes that are kinds of their own, after [`NOTHING`].
const CLASSES: [ObjectClass; 5] =
    [ObjectClass::Car, ObjectClass::Van, ObjectClass::Truck, ObjectClass::Cyclist, ObjectClass::Pedestrian];

/// Log odds beyond this, either way, count as this: a network can be surer than it has reason to be.
const MAX_LOG_ODDS: f64 = 8.0;

/// The kind of an object of `class`; none of a class that is not told from others.
pub fn kind_of(class: &ObjectClass) -> Option<usize> {
    let class = if *class == ObjectClass::PersonSitting { &ObjectClass::Pedestrian } else { class };
    CLASSES.iter().position(|known| known == class).map(|place| place + 1)
}

/// Whether both kinds are one, or of classes that are easily taken for one another: whichever of them it is, there is
/// somebody.
fn are_of_one_group(a: usize, b: usize) -> bool {
    a == b || (a != NOTHING && b != NOTHING && CLASSES[a - 1].is_like(&CLASSES[b - 1]))
}

/// The log odds, by the logits of all kinds, that something is of this kind or of one that is easily taken for it; 0
/// where they are no numbers.
pub(super) fn log_odds(logits: &[f64; KINDS], kind: usize) -> f64 {
    let highest = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum = |inside: bool| {
        let logits = logits.iter().enumerate().filter(|(other, _)| are_of_one_group(*other, kind) == inside);
        logits.map(|(_, logit)| (logit - highest).exp()).sum::<f64>()
    };
    let odds = (sum(true) / sum(false)).ln();
    if odds.is_nan() { 0.0 } else { odds.clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS) }
}

/// `class`, or the class that it is easily taken for and that is likelier.
pub(super) fn likeliest(logits: &[f64; KINDS], class: &ObjectClass) -> ObjectClass {
    let Some(kind) = kind_of(class) else { return class.clone() };
    let alike = (0..KINDS).filter(|other| are_of_one_group(*other, kind));
    let best = alike.max_by(|&a, &b| logits[a].total_cmp(&logits[b]));
    match best.filter(|best| logits[*best] > logits[kind]) {
        Some(best) => CLASSES[best - 1].clone(),
        None => class.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farsight_core::score::logistic;

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
    fn log_odds_are_those_of_softmax_for_all_that_could_be_meant() {
        let logits: [f64; KINDS] = [0.3, 2.0, -1.0, 0.5, 1.5, -4.0];
        let sum = |kinds: std::ops::Range<usize>| kinds.map(|kind| logits[kind].exp()).sum::<f64>();
        for (kind, meant) in [(NOTHING, 0..1), (1, 1..4), (3, 1..4), (5, 4..6)] {
            let share = sum(meant) / sum(0..KINDS);
            assert!((logistic(log_odds(&logits, kind)) - share).abs() < 1e-12, "kind {kind}");
        }
        let far = [0.0, 1e300, 0.0, 0.0, 0.0, 0.0];
        assert!((log_odds(&far, 1) - MAX_LOG_ODDS).abs() < 1e-12 && (log_odds(&far, 0) + MAX_LOG_ODDS).abs() < 1e-12);
        assert!(log_odds(&[f64::NAN; KINDS], 1).abs() < 1e-12);
        assert!(log_odds(&[f64::INFINITY; KINDS], 1).abs() < 1e-12);
    }

    #[test]
    fn the_likeliest_class_is_one_that_could_be_meant() {
        let [car, van, cyclist, pedestrian] =
            [ObjectClass::Car, ObjectClass::Van, ObjectClass::Cyclist, ObjectClass::Pedestrian];
        let logits = [9.0, 1.0, 2.0, -1.0, 0.0, 5.0];
        assert_eq!(likeliest(&logits, &car), van);
        assert_eq!(likeliest(&logits, &cyclist), pedestrian);
        assert_eq!(likeliest(&logits, &ObjectClass::Tram), ObjectClass::Tram);
        assert_eq!(likeliest(&[0.0; KINDS], &car), car, "nothing speaks against it");
    }
}
