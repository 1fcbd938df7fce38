//! What several methods ask of their configs.

use farsight_core::ClassReference;
use farsight_core::references::MAX_FOCAL_PX;

use crate::input_spec::SIZE_STEP;

/// The longest side of an input, pixels; a description from a stranger must not ask for all memory.
const MAX_SIDE: usize = 8192;

/// Why the input cannot have this width and height, if it cannot.
pub(crate) fn problem_of_input([width, height]: [usize; 2]) -> Option<String> {
    let is_side = |side: usize| side > 0 && side.is_multiple_of(SIZE_STEP) && side <= MAX_SIDE;
    (!(is_side(width) && is_side(height))).then(|| {
        format!("model.input is {width}x{height}; expected multiples of {SIZE_STEP} pixels, at most {MAX_SIDE}")
    })
}

/// Why this cannot be a factor on channels, if it cannot.
pub(crate) fn problem_of_width(name: &str, width: f64) -> Option<String> {
    let is_factor = width.is_finite() && width > 0.0 && width <= 8.0;
    (!is_factor).then(|| format!("model.{name} is {width}; expected a factor above 0 and at most 8"))
}

/// What is wrong with what a config says of focal lengths, if anything is.
pub(crate) fn problem_of_focals(depth_focal_px: Option<f64>, focal_range_px: Option<[f64; 2]>) -> Option<String> {
    if let Some(focal_px) = depth_focal_px.filter(|focal_px| !(*focal_px > 0.0 && *focal_px <= MAX_FOCAL_PX)) {
        return Some(format!("model.depth_focal_px is {focal_px}; expected a positive number of pixels"));
    }
    let [low, high] = focal_range_px?;
    let is_range = low > 0.0 && low <= high && high <= MAX_FOCAL_PX;
    let expected = format!("expected 0 < smallest <= largest <= {MAX_FOCAL_PX}");
    (!is_range).then(|| format!("model.focal_range_px is {low} to {high}; {expected}"))
}

/// What is wrong with the classes of a config, if anything is.
pub(crate) fn problem_of_classes(classes: &[ClassReference]) -> Option<String> {
    if classes.is_empty() {
        return Some("model.classes is empty; expected at least one class".to_owned());
    }
    let unusable = |class: &ClassReference| {
        let wrong = class.score.is_some_and(|score| !score.is_usable());
        wrong.then(|| format!("model.classes has {} with a score that no fit gives", class.class))
    };
    let names = ClassReference::problem_of_names(classes).map(|problem| format!("model.classes {problem}"));
    let sizes = ClassReference::problem_of_sizes(classes).map(|problem| format!("model.classes {problem}"));
    names.or(sizes).or_else(|| classes.iter().find_map(unusable))
}

/// Which of several numbers that weigh a loss cannot, if one cannot.
#[cfg(feature = "train")]
pub(crate) fn problem_of_weights(weights: &[(&str, f64)]) -> Option<String> {
    let wrong = weights.iter().find(|(_, weight)| !(weight.is_finite() && *weight >= 0.0));
    wrong.map(|(name, weight)| format!("{name} is {weight}; expected 0 or a positive number"))
}
