//! Which objects another iteration of the refiner pays for.

use serde::{Deserialize, Serialize};

/// No object has more iterations.
pub(super) const ITERATIONS: usize = 3;

/// The score of a detection before each iteration of the refiner, and after the last one.
pub type ScoreTrace = [f64; ITERATIONS + 1];

/// A rejection cascade (Viola and Jones 2001): before each iteration there is a score below which an object gets no
/// more of them, as hardly any such object would reach the score that is sought.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Cascade {
    /// For each of [`Cascade::SOUGHT`], the least scores before each iteration.
    least: [[f64; ITERATIONS]; Cascade::SOUGHT.len()],
}

impl Default for Cascade {
    /// Unfitted: all of what a detector was asked for has one iteration, and others from a fifth of what is sought on.
    fn default() -> Self {
        Self { least: Self::SOUGHT.map(|sought| [0.0, 0.2 * sought, 0.2 * sought]) }
    }
}

impl Cascade {
    /// The scores that a fit seeks.
    pub const SOUGHT: [f64; 3] = [0.3, 0.5, 0.7];

    /// Of what reaches a score that is sought, this share may be lost before each iteration.
    pub const LOST: f64 = 0.003;

    /// The fewest detections that reach a score, for a fit.
    pub const MIN_REACHING: usize = 200;

    /// The largest scores with which no more than [`Cascade::LOST`] is lost. None where fewer than
    /// [`Cascade::MIN_REACHING`] of `traces` reach one of [`Cascade::SOUGHT`].
    pub fn fit(traces: &[ScoreTrace]) -> Option<Self> {
        let mut least = [[0.0; ITERATIONS]; Self::SOUGHT.len()];
        for (sought, least) in Self::SOUGHT.into_iter().zip(&mut least) {
            let reaching: Vec<&ScoreTrace> = traces.iter().filter(|trace| trace[ITERATIONS] >= sought).collect();
            if reaching.len() < Self::MIN_REACHING {
                return None;
            }
            let lost = (Self::LOST * reaching.len() as f64) as usize;
            for (iteration, least) in least.iter_mut().enumerate() {
                let mut before: Vec<f64> = reaching.iter().map(|trace| trace[iteration]).collect();
                before.sort_by(f64::total_cmp);
                *least = before[lost].min(sought);
            }
        }
        Some(Self { least })
    }

    /// Whether these are numbers that a fit could have given: files from strangers may hold others.
    pub fn is_usable(&self) -> bool {
        let mut rows = self.least.iter().zip(Self::SOUGHT);
        rows.all(|(least, sought)| least.iter().all(|score| (0.0..=sought).contains(score)))
    }

    /// The least scores before each iteration for what is to reach the score `sought`: interpolated between those of
    /// the fit, in proportion below them, and the highest ones above.
    pub fn least(&self, sought: f64) -> [f64; ITERATIONS] {
        let [low, .., high] = Self::SOUGHT;
        let [first, .., last] = self.least;
        if sought <= low {
            return first.map(|score| score * (sought / low).max(0.0));
        }
        if sought >= high {
            return last;
        }
        let place = Self::SOUGHT.iter().rposition(|known| *known <= sought).unwrap_or_default();
        let [below, above] = [Self::SOUGHT[place], Self::SOUGHT[place + 1]];
        let part = (sought - below) / (above - below);
        std::array::from_fn(|iteration| {
            let [below, above] = [self.least[place][iteration], self.least[place + 1][iteration]];
            below + part * (above - below)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The scores 0, 0.001 ... 1 at the end, and these shares of them before each iteration.
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
        let shares = [0.4, 0.6, 0.8];
        let traces = traces(shares);
        let cascade = Cascade::fit(&traces).expect("enough");
        // Between the scores of the fit, too.
        for sought in [0.3, 0.42, 0.5, 0.61, 0.7] {
            let reaching: Vec<_> = traces.iter().filter(|trace| trace[ITERATIONS] >= sought).collect();
            for (iteration, least) in cascade.least(sought).into_iter().enumerate() {
                let lost = reaching.iter().filter(|trace| trace[iteration] < least).count();
                assert!(lost as f64 <= Cascade::LOST * reaching.len() as f64 + 1.0, "{lost} of {}", reaching.len());
                assert!(least > shares[iteration] * sought - 1e-9, "{least}");
            }
        }
    }

    #[test]
    fn outside_of_the_fit_nothing_more_is_lost() {
        let cascade = Cascade::fit(&traces([0.4, 0.6, 0.8])).expect("enough");
        let [[a, ..], [b, ..], [c, ..]] = [0.0, 0.15, 0.9].map(|sought| cascade.least(sought));
        assert!(a.abs() < 1e-12 && (b - 0.06).abs() < 2e-3 && (c - 0.28).abs() < 2e-3, "{a}, {b} and {c}");
        assert!(cascade.least(-1.0).iter().all(|least| least.abs() < 1e-12));
    }

    #[test]
    fn no_score_is_fitted_on_too_few_or_above_what_is_sought() {
        assert_eq!(Cascade::fit(&traces([0.4; 3])[..800]), None);
        let falling = Cascade::fit(&traces([3.0, 1.0, 0.5])).expect("enough");
        let [first, second, third] = falling.least(0.5);
        assert!(first > 0.49 && second > 0.49 && third < 0.26, "{falling:?}");
        assert!(falling.is_usable() && Cascade::default().is_usable());
        assert!(!Cascade { least: [[0.1, f64::NAN, 0.1]; 3] }.is_usable());
    }
}
