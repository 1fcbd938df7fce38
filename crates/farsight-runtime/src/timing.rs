//! Where the time goes.

use std::time::{Duration, Instant};

/// Time that each stage took for the images of one call.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct StageTimes {
    /// Reading and decoding the image file; zero from a detector, which gets pixels.
    pub load: Duration,
    /// Warping and normalising.
    pub warp: Duration,
    /// The engine.
    pub network: Duration,
    /// From head maps to detections.
    pub decode: Duration,
    /// The refiner, where there is one.
    pub refine: Duration,
}

impl StageTimes {
    /// All stages.
    pub fn total(&self) -> Duration {
        self.load + self.warp + self.network + self.decode + self.refine
    }

    /// The share of one of `count` that went through the stages together.
    #[must_use]
    pub fn divided(&self, count: usize) -> Self {
        let share = |time: Duration| time.div_f64(count.max(1) as f64);
        Self {
            load: share(self.load),
            warp: share(self.warp),
            network: share(self.network),
            decode: share(self.decode),
            refine: share(self.refine),
        }
    }

    /// Each stage's time and that of `other` together.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            load: self.load + other.load,
            warp: self.warp + other.warp,
            network: self.network + other.network,
            decode: self.decode + other.decode,
            refine: self.refine + other.refine,
        }
    }
}

/// The answer of `work` and the time it took.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let start = Instant::now();
    let answer = work();
    (answer, start.elapsed())
}
