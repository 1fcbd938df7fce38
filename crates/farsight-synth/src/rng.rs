//! Random draws: everything in a scene comes from one of these.

use rand::RngExt;
use rand_pcg::Pcg64;

/// The streams of draws that decide about scenes, layouts and the sensor.
pub(crate) const SCENE_STREAM: u64 = 0;
pub(crate) const LAYOUT_STREAM: u64 = 1;
pub(crate) const SENSOR_STREAM: u64 = 2;

/// A stream of random draws that is the same on every machine.
#[derive(Debug, Clone)]
pub(crate) struct SceneRng(Pcg64);

impl SceneRng {
    /// Draws of item `index` of `seed`; `stream` separates the uses of one item.
    pub(crate) fn new(seed: u64, index: u64, stream: u64) -> Self {
        let state = (u128::from(seed) << 64) | u128::from(index);
        Self(Pcg64::new(state.wrapping_mul(0x9E37_79B9_7F4A_7C15_F39C_C060_5CED_C835), u128::from(stream)))
    }

    /// An independent stream, so that what is drawn from it does not change what comes after.
    pub(crate) fn fork(&mut self) -> Self {
        Self(Pcg64::new(self.0.random::<u128>(), self.0.random::<u128>()))
    }

    /// The generator itself, for draws that are written elsewhere.
    pub(crate) fn inner(&mut self) -> &mut Pcg64 {
        &mut self.0
    }

    /// From 0 up to, not including, 1.
    pub(crate) fn unit(&mut self) -> f64 {
        self.0.random::<f64>()
    }

    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub(crate) fn range32(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit() as f32
    }

    pub(crate) fn symmetric(&mut self, reach: f64) -> f64 {
        self.range(-reach, reach)
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// A whole number from `low` to `high`, both included.
    pub(crate) fn whole(&mut self, low: usize, high: usize) -> usize {
        low + ((high - low + 1) as f64 * self.unit()) as usize
    }

    pub(crate) fn seed(&mut self) -> u32 {
        self.0.random::<u32>()
    }

    /// Box and Muller 1958.
    pub(crate) fn normal(&mut self, mean: f64, deviation: f64) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.unit())).sqrt();
        mean + deviation * radius * libm::cos(std::f64::consts::TAU * self.unit())
    }

    /// Even in its logarithm.
    pub(crate) fn log_range(&mut self, low: f64, high: f64) -> f64 {
        libm::exp(self.range(libm::log(low), libm::log(high)))
    }

    /// One of `items`; they must not be empty.
    pub(crate) fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.whole(0, items.len() - 1)]
    }

    /// One of `items` with probability in proportion to its weight.
    pub(crate) fn weighted<T: Copy>(&mut self, items: &[(T, f64)]) -> T {
        let total: f64 = items.iter().map(|(_, weight)| weight).sum();
        let mut left = self.unit() * total;
        for &(item, weight) in items {
            if left < weight {
                return item;
            }
            left -= weight;
        }
        items[items.len() - 1].0
    }
}

/// Fowler, Noll and Vo's prime, for 64 bits.
const FNV_PRIME: u64 = 0x0100_0000_01b3;

/// The seed of what is rebuilt from the labels called `id`: it does not depend on which others are rebuilt.
pub(crate) fn twin_seed(seed: u64, id: &str) -> u64 {
    id.bytes().fold(seed, |seed, byte| (seed ^ u64::from(byte)).wrapping_mul(FNV_PRIME))
}
