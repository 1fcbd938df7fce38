//! Errors of distance, speed and time to collision, and how often the truth lies within their error bars.

use serde::Serialize;

use super::{GroundTruthTrack, PredictedTrack};

/// Half the widths of intervals that hold 50, 68 and 90% of a normal distribution, standard deviations.
const SIGMAS: [f64; 3] = [0.674_490, 0.994_458, 1.644_854];

/// Speeds are judged of tracks that are told of for so long, seconds.
const SETTLED_S: f64 = 1.0;

/// One track in one frame, beside what is true.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Sample {
    /// The frame's number.
    pub frame: usize,
    /// Identities, as they are and as they are told.
    pub ids: [u64; 2],
    /// Seconds since the track was told of first.
    pub age_s: f64,
    /// True depth, metres.
    pub depth_m: f64,
    /// What is told less what is true, metres, and its standard deviation.
    pub depth: [Option<f64>; 2],
    /// Closing speed told less true, m/s, and its standard deviation.
    pub closing: Option<[f64; 2]>,
    /// True closing speed, m/s.
    pub true_closing_mps: Option<f64>,
    /// Speed over the ground told less true, m/s, and its standard deviation.
    pub speed: Option<[f64; 2]>,
    /// True time to collision of the nearest face, seconds, negative of what goes away.
    pub true_ttc_s: Option<f64>,
    /// What is told of it, and its interval.
    pub ttc_s: Option<f64>,
    /// It lies between these with 90%.
    pub ttc_interval_s: Option<(f64, Option<f64>)>,
}

impl Sample {
    pub(super) fn new(frame: usize, truth: &GroundTruthTrack, told: &PredictedTrack, age_s: f64) -> Self {
        let box3d = &truth.label.box3d;
        let depth_m = box3d.depth_m();
        let (sin, cos) = box3d.yaw.sin_cos();
        let half_m = f64::midpoint(sin.abs() * box3d.dimensions.length, cos.abs() * box3d.dimensions.width);
        let true_closing_mps = truth.velocity_mps.map(|velocity| -velocity[2]);
        Self {
            frame,
            ids: [truth.id, told.id],
            age_s,
            depth_m,
            depth: [Some(told.box3d.depth_m() - depth_m), told.range_sigma_m],
            closing: told.closing_mps.zip(true_closing_mps).map(|([mps, sigma], known)| [mps - known, sigma]),
            true_closing_mps,
            speed: told.speed_mps.zip(truth.speed_mps).map(|([mps, sigma], known)| [mps - known, sigma]),
            true_ttc_s: true_closing_mps.filter(|mps| mps.abs() > 1e-6).map(|mps| (depth_m - half_m).max(0.1) / mps),
            ttc_s: told.ttc_s,
            ttc_interval_s: told.ttc_interval_s,
        }
    }

    /// Whether the true time to collision lies in the interval that is told.
    fn is_ttc_held(&self) -> Option<bool> {
        let (low, high) = self.ttc_interval_s?;
        let known = self.true_ttc_s.unwrap_or(f64::INFINITY);
        // What goes away never collides.
        let known = if known < 0.0 { f64::INFINITY } else { known };
        Some(low <= known && high.is_none_or(|high| known <= high))
    }
}

/// Bins of the true time to collision: TSTTC's (Shi et al. 2023), seconds.
pub const TTC_BINS: [(&str, [f64; 2]); 3] =
    [("0 to 3 s", [0.0, 3.0]), ("3 to 6 s", [3.0, 6.0]), ("6 to 10 s", [6.0, 10.0])];

/// Times to collision of a bin.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TtcBin {
    /// Which.
    pub name: &'static str,
    /// How many there are, and of how many one is told.
    pub count: usize,
    /// See `count`.
    pub told: usize,
    /// Mean of |told - true| / true.
    pub relative_error: Option<f64>,
    /// Mean error of motion in depth, 10⁴ |ln(1 - 0.1 s / told) - ln(1 - 0.1 s / true)|.
    pub motion_in_depth: Option<f64>,
}

/// Errors of many samples. Shares are of 1; none where there is nothing to judge.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Errors {
    /// How many samples.
    pub count: usize,
    /// Mean absolute error of the depth, metres.
    pub depth_mae_m: Option<f64>,
    /// Median of |error| / depth.
    pub depth_relative: Option<f64>,
    /// Shares of depths inside their 50, 68 and 90% intervals.
    pub depth_coverage: Option<[f64; 3]>,
    /// Mean absolute error of the closing speed after a second, m/s: below 30 m, and from there to 60 m.
    pub closing_mae_mps: [Option<f64>; 2],
    /// Shares of closing speeds inside their intervals.
    pub closing_coverage: Option<[f64; 3]>,
    /// Of speeds over the ground, as above.
    pub speed_mae_mps: [Option<f64>; 2],
    /// Shares of speeds over the ground inside their intervals.
    pub speed_coverage: Option<[f64; 3]>,
    /// Times to collision by their bins.
    pub ttc: Vec<TtcBin>,
    /// Share of true times to collision inside their 90% intervals.
    pub ttc_coverage: Option<f64>,
}

pub(super) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn coverage(errors: &[[f64; 2]]) -> Option<[f64; 3]> {
    let share = |sigmas: f64| {
        let inside = errors.iter().filter(|[error, sigma]| error.abs() <= sigmas * sigma).count();
        inside as f64 / errors.len() as f64
    };
    (!errors.is_empty()).then(|| SIGMAS.map(share))
}

impl Errors {
    /// Errors of these samples.
    pub fn of<'a>(samples: impl IntoIterator<Item = &'a Sample>) -> Self {
        let samples: Vec<&Sample> = samples.into_iter().collect();
        let depth: Vec<f64> = samples.iter().filter_map(|one| one.depth[0]).map(f64::abs).collect();
        let mut relative: Vec<f64> =
            samples.iter().filter_map(|one| Some((one.depth[0]? / one.depth_m).abs())).collect();
        let bars: Vec<[f64; 2]> = samples.iter().filter_map(|one| Some([one.depth[0]?, one.depth[1]?])).collect();
        let settled: Vec<&&Sample> = samples.iter().filter(|one| one.age_s >= SETTLED_S).collect();
        let near = |one: &Sample| if one.depth_m < 30.0 { Some(0) } else { (one.depth_m < 60.0).then_some(1) };
        let by_distance = |value: &dyn Fn(&Sample) -> Option<[f64; 2]>| {
            [0, 1].map(|bin| {
                let of_bin = settled.iter().filter(|one| near(one) == Some(bin));
                mean(&of_bin.filter_map(|one| Some(value(one)?[0].abs())).collect::<Vec<_>>())
            })
        };
        let held = |value: &dyn Fn(&Sample) -> Option<[f64; 2]>| {
            coverage(&settled.iter().filter_map(|one| value(one)).collect::<Vec<_>>())
        };
        let ttc_held: Vec<f64> =
            settled.iter().filter_map(|one| Some(f64::from(u8::from(one.is_ttc_held()?)))).collect();
        Self {
            count: samples.len(),
            depth_mae_m: mean(&depth),
            depth_relative: median(&mut relative),
            depth_coverage: coverage(&bars),
            closing_mae_mps: by_distance(&|one| one.closing),
            closing_coverage: held(&|one| one.closing),
            speed_mae_mps: by_distance(&|one| one.speed),
            speed_coverage: held(&|one| one.speed),
            ttc: TTC_BINS.iter().map(|(name, bin)| ttc_bin(name, *bin, &settled)).collect(),
            ttc_coverage: mean(&ttc_held),
        }
    }
}

fn ttc_bin(name: &'static str, [low, high]: [f64; 2], samples: &[&&Sample]) -> TtcBin {
    let of_bin = samples.iter().filter_map(|one| Some((one, one.true_ttc_s.filter(|ttc| *ttc > low && *ttc <= high)?)));
    let (mut count, mut relative, mut motion) = (0, Vec::new(), Vec::new());
    for (one, known) in of_bin {
        count += 1;
        if let Some(told) = one.ttc_s {
            relative.push((told / known - 1.0).abs());
            let in_depth = |ttc: f64| (1.0 - 0.1 / ttc.max(0.2)).ln();
            motion.push(1e4 * (in_depth(told) - in_depth(known)).abs());
        }
    }
    TtcBin { name, count, told: relative.len(), relative_error: mean(&relative), motion_in_depth: mean(&motion) }
}
