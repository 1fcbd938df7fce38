//! Which objects another iteration of the refiner pays for.

use serde::{Deserialize, Serialize};

/// No object has more iterations.
pub(super) const ITERATIONS: usize = 3;

/// The score of a detection before each iteration of the refiner, and after the last one.
pub type ScoreTrace = [f64; ITERATIONS + 1];

/// A rejection cascade (Viola and Jones 2001): what has a score below a share of the score that is sought gets no more
/// iterations, as hardly any of it would reach that. There is a share before each iteration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Cascade {
    shares: [f64; ITERATIONS],
}

impl Default for Cascade {
    /// Unfitted: all of what a detector was asked for has one iteration.
    fn default() -> Self {
        Self { shares: [0.0, 0.2, 0.2] }
    }
}

impl Cascade {
    /// The scores that a fit seeks.
    pub const SOUGHT: [f64; 3] = [0.3, 0.5, 0.7];

    /// Of what reaches a score that is sought, this share may be lost before each iteration.
    pub const LOST: f64 = 0.002;

    /// The fewest detections that reach a score, for a fit.
    pub const MIN_REACHING: usize = 200;

    /// The largest shares with which, for each of [`Cascade::SOUGHT`], no more than [`Cascade::LOST`] is lost. None
    /// where fewer than [`Cascade::MIN_REACHING`] of `traces` reach one of them.
    pub fn fit(traces: &[ScoreTrace]) -> Option<Self> {
        let mut shares = [1.0_f64; ITERATIONS];
        for sought in Self::SOUGHT {
            let reaching = traces.iter().filter(|trace| trace[ITERATIONS] >= sought);
            let reaching: Vec<&ScoreTrace> = reaching.collect();
            if reaching.len() < Self::MIN_REACHING {
                return None;
            }
            let lost = (Self::LOST * reaching.len() as f64) as usize;
            for (iteration, share) in shares.iter_mut().enumerate() {
                let mut before: Vec<f64> = reaching.iter().map(|trace| trace[iteration]).collect();
                before.sort_by(f64::total_cmp);
                *share = share.min(before[lost] / sought);
            }
        }
        Some(Self { shares })
    }

    /// Whether these are numbers that a fit could have given: files from strangers may hold others.
    pub fn is_usable(&self) -> bool {
        self.shares.iter().all(|share| (0.0..=1.0).contains(share))
    }

    /// The share before each iteration.
    pub fn shares(&self) -> [f64; ITERATIONS] {
        self.shares
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The scores 0, 0.001 ... 1 at the end, and this share of them before each iteration.
    fn traces(shares: [f64; 3]) -> Vec<ScoreTrace> {
        let trace = |step: i32| {
            let last = f64::from(step) / 1000.0;
            let [first, second, third] = shares.map(|share| share * last);
            [first, second, third, last]
        };
        (0..=1000).map(trace).collect()
    }

    #[test]
    fn a_fit_loses_what_it_may() {
        let traces = traces([0.4, 0.6, 0.8]);
        let cascade = Cascade::fit(&traces).expect("enough");
        for sought in Cascade::SOUGHT {
            let reaching: Vec<_> = traces.iter().filter(|trace| trace[ITERATIONS] >= sought).collect();
            for (iteration, share) in cascade.shares().into_iter().enumerate() {
                let lost = reaching.iter().filter(|trace| trace[iteration] < share * sought).count();
                assert!(lost as f64 <= Cascade::LOST * reaching.len() as f64, "{lost} of {}", reaching.len());
                assert!(share > [0.4, 0.6, 0.8][iteration] - 1e-9, "{share}");
            }
        }
    }

    #[test]
    fn no_share_is_fitted_on_too_few_or_above_one() {
        assert_eq!(Cascade::fit(&traces([0.4; 3])[..800]), None);
        let falling = Cascade::fit(&traces([3.0, 1.0, 0.5])).expect("enough").shares();
        assert!(falling[0] > 0.99 && falling[1] > 0.99 && falling[2] < 0.51, "{falling:?}");
        assert!(Cascade { shares: falling }.is_usable() && Cascade::default().is_usable());
        assert!(!Cascade { shares: [0.1, f64::NAN, 0.1] }.is_usable());
    }
}
