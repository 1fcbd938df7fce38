//! What trainings on crops of single objects have in common: which objects are learnt from, and the errors of an
//! earlier stage that says where to crop.

mod jitter;

pub(crate) use jitter::{BoxErrors, jittered};

use farsight_core::{Label, ObjectClass};
use rand::Rng;
use rand::seq::SliceRandom;

/// Objects of which less is seen are not learnt from.
const MAX_OCCLUDED: i32 = 2;
pub(crate) const MAX_TRUNCATED: f64 = 0.8;

/// Whether enough is seen of what is labelled: it is high enough, pixels, and at most this share is cut by the image's
/// edge.
pub(crate) fn is_seen(label: &Label, least_height_px: f64, most_truncated: f64) -> bool {
    label.class != ObjectClass::DontCare
        && (0..=MAX_OCCLUDED).contains(&label.occlusion)
        && label.truncation <= most_truncated
        && label.box2d.height() >= least_height_px
}

/// At most so many of `all`, in random order.
pub(crate) fn drawn<T>(mut all: Vec<T>, most: usize, rng: &mut impl Rng) -> Vec<T> {
    all.shuffle(rng);
    all.truncate(most);
    all
}
