//! How tracks are begun, kept and ended, and what is known of errors and motions.

/// Options of a [`crate::Tracker`].
///
/// Motion and heights were fitted on rendered sequences (`docs/video.md`); the other noise was set by hand from
/// the errors of the shipped models in a real sequence, wider than they were.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerOptions {
    /// From this score on a detection begins a track.
    pub birth_score: f64,
    /// From this score on a detection continues one.
    pub low_score: f64,
    /// So many detections make a track that is told; in the first frame of a scene one does.
    pub birth_hits: u32,
    /// A track is told for so long without a detection, seconds; for less if it was not seen for four times as long.
    pub max_coast_s: f64,
    /// The same behind an obstacle that is tracked, seconds; for less if it was not seen for twice as long.
    pub max_hidden_s: f64,
    /// A track is known again after at most so long, seconds.
    pub max_lost_s: f64,
    /// The least overlap (intersection over union) of a box with where it was expected.
    pub min_overlap: f64,
    /// Gate of distance and size, standard deviations, of boxes that overlap by half.
    pub gate_sigmas: f64,
    /// The two ways to move: evenly, and braking, accelerating or turning.
    pub motion: [Motion; 2],
    /// Standard deviation of the relative velocity before anything is known: across and along the optical axis, m/s.
    /// What comes towards a camera that moves is fast.
    pub prior_speed_mps: [f64; 2],
    /// A velocity is told from these standard deviations on: across and along the optical axis, m/s.
    pub known_sigma_mps: [f64; 2],
    /// Width of what we drive in, with what is to stay free beside it, metres.
    pub own_width_m: f64,
    /// Errors of the measurements.
    pub noise: Noise,
}

impl Default for TrackerOptions {
    fn default() -> Self {
        Self {
            birth_score: 0.5,
            low_score: 0.1,
            birth_hits: 2,
            max_coast_s: 0.5,
            max_hidden_s: 2.0,
            max_lost_s: 3.0,
            min_overlap: 0.2,
            gate_sigmas: 4.0,
            motion: [Motion { acceleration_psd: 0.3, lasts_s: 1.4 }, Motion { acceleration_psd: 30.0, lasts_s: 0.7 }],
            prior_speed_mps: [5.0, 18.0],
            known_sigma_mps: [2.5, 5.0],
            own_width_m: 2.4,
            noise: Noise::default(),
        }
    }
}

/// A way to move: constant velocity with a white acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Power spectral density of the relative acceleration, (m/s^2)^2 s.
    pub acceleration_psd: f64,
    /// After so long in the mean it moves the other way, seconds.
    pub lasts_s: f64,
}

/// Errors of one image's measurements, and how long they last.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Share of the distance's error variance that the next image has, too.
    pub persistent_share: f64,
    /// After so long the persistent factor of the distance is another, seconds.
    pub persistent_s: f64,
    /// Least standard deviation of a distance's error that is new in each image, as a share of the distance.
    pub least_white: f64,
    /// Standard deviation of a distance without error bar, as a share of the distance.
    pub unknown_sigma: f64,
    /// Lasting error of a box's height: as a share of it.
    pub height_share: f64,
    /// Lasting error of a box's height, pixels.
    pub height_px: f64,
    /// After so long that error is another, seconds.
    pub height_s: f64,
    /// Error of a box's height that is new in each image: as a share of it.
    pub white_height_share: f64,
    /// Error of a box's height that is new in each image, pixels.
    pub white_height_px: f64,
    /// What a box's height says of a size changes by so much in a second: it turns, stoops, loads.
    pub size_drift: f64,
    /// Error of a box's place in the image, pixels.
    pub place_px: f64,
    /// Error of a box's place in the image, as a share of its width.
    pub place_share: f64,
    /// Error of one image's dimensions that is new in each image, as a share of them.
    pub dimension_share: f64,
}

impl Default for Noise {
    fn default() -> Self {
        Self {
            persistent_share: 0.85,
            persistent_s: 5.0,
            least_white: 0.02,
            unknown_sigma: 0.1,
            height_share: 0.02,
            height_px: 0.3,
            height_s: 0.6,
            white_height_share: 0.006,
            white_height_px: 0.4,
            size_drift: 0.005,
            place_px: 1.0,
            place_share: 0.02,
            dimension_share: 0.03,
        }
    }
}
