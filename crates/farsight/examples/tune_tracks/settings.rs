//! The tracker's options by name.

use farsight::TrackerOptions;

type Place = fn(&mut TrackerOptions) -> &mut f64;

/// Those of how tracks are begun, kept and ended.
const ASSOCIATION: [(&str, Place); 5] = [
    ("birth_score", |options| &mut options.birth_score),
    ("low_score", |options| &mut options.low_score),
    ("min_overlap", |options| &mut options.min_overlap),
    ("gate_sigmas", |options| &mut options.gate_sigmas),
    ("max_coast_s", |options| &mut options.max_coast_s),
];

/// Those of motion and of measurements.
pub(crate) const FILTER: [(&str, Place); 17] = [
    ("even_psd", |options| &mut options.motion[0].acceleration_psd),
    ("even_lasts_s", |options| &mut options.motion[0].lasts_s),
    ("pushed_psd", |options| &mut options.motion[1].acceleration_psd),
    ("pushed_lasts_s", |options| &mut options.motion[1].lasts_s),
    ("prior_across", |options| &mut options.prior_speed_mps[0]),
    ("prior_along", |options| &mut options.prior_speed_mps[1]),
    ("persistent_share", |options| &mut options.noise.persistent_share),
    ("persistent_s", |options| &mut options.noise.persistent_s),
    ("least_white", |options| &mut options.noise.least_white),
    ("height_share", |options| &mut options.noise.height_share),
    ("height_px", |options| &mut options.noise.height_px),
    ("height_s", |options| &mut options.noise.height_s),
    ("white_height_share", |options| &mut options.noise.white_height_share),
    ("white_height_px", |options| &mut options.noise.white_height_px),
    ("size_drift", |options| &mut options.noise.size_drift),
    ("place_px", |options| &mut options.noise.place_px),
    ("place_share", |options| &mut options.noise.place_share),
];

/// Sets what `NAME=VALUE` says.
pub(crate) fn set(options: &mut TrackerOptions, setting: &str) {
    let (name, value) = setting.split_once('=').expect("expected NAME=VALUE");
    let mut all = ASSOCIATION.iter().chain(&FILTER);
    let (_, place) = all.find(|(known, _)| *known == name).unwrap_or_else(|| panic!("no option {name}"));
    *place(options) = value.parse().expect("a number");
}
