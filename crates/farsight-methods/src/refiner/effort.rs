//! How much is done for each object.

use super::cascade::{Cascade, ITERATIONS};

/// How many iterations of the refiner each object gets, and how many mirror images.
///
/// A cut-out around a box that hardly differs from that of the iteration before shows the same pixels, and the answer
/// would be nearly the same. So an object is *settled* when its next cut-out is the last one within a share of its
/// side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Effort {
    /// One iteration, or two where the first one moved the box; no mirror images.
    Fast,
    /// Three iterations as long as an object is promising ([`Cascade`]), the last cut-out mirrored, too.
    #[default]
    Normal,
    /// Three iterations for whatever the detector found, the last cut-out mirrored, too: what the numbers of the fusion
    /// were fitted with.
    Best,
}

impl Effort {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Normal, Self::Best];

    /// As users write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Normal => "normal",
            Self::Best => "best",
        }
    }

    /// No object has more.
    pub(super) fn iterations(self) -> usize {
        match self {
            Self::Fast => 2,
            Self::Normal | Self::Best => ITERATIONS,
        }
    }

    /// Whether the mean of the answers for the last cut-out and for its mirror image counts.
    pub(super) fn mirrors(self) -> bool {
        self != Self::Fast
    }

    /// By what share of its side a cut-out may lie elsewhere, or be larger, and show the same; none is never.
    pub(super) fn settled_within(self) -> Option<f64> {
        match self {
            Self::Fast => Some(0.1),
            Self::Normal | Self::Best => None,
        }
    }

    /// What has a score below these before each iteration gets no more of them, where the score `sought` counts.
    pub(super) fn least_scores(self, cascade: &Cascade, sought: f64) -> [f64; ITERATIONS] {
        let [first, second, third] = cascade.least(sought);
        match self {
            Self::Fast => [first, second.max(0.5 * sought), third.max(0.5 * sought)],
            Self::Normal => [first, second, third],
            Self::Best => [0.0; ITERATIONS],
        }
    }
}
