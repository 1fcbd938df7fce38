//! Sums over objects from which every metric follows; sums of frames add up, which is what the bootstrap needs.

use std::collections::BTreeMap;

use super::matching::Target;
use super::metrics::{DELTA_FACTORS, RangingMetric, RangingMetrics};
use super::slices::{Cell, Slice};

/// Relative errors are taken against at least this distance, metres: an object at the camera itself has none.
const MIN_TRUE_DISTANCE_M: f64 = 0.1;

/// Sums over a set of objects, weighted by how often each was drawn.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Tally {
    pub(super) objects: f64,
    pub(super) found: f64,
    depth: ErrorSums,
    ground: ErrorSums,
}

/// Sums over the found objects.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct ErrorSums {
    signed: f64,
    absolute: f64,
    squared: f64,
    relative: f64,
    signed_relative: f64,
    within: [f64; 3],
}

impl Tally {
    /// The tally of one object.
    pub(super) fn of(target: &Target) -> Self {
        let missed = Self { objects: 1.0, ..Self::default() };
        target.found.map_or(missed, |found| Self {
            found: 1.0,
            depth: ErrorSums::of(found.depth_m, target.depth_m),
            ground: ErrorSums::of(found.ground_m, target.ground_m),
            ..missed
        })
    }

    /// Adds `other`, `weight` times.
    pub(super) fn add(&mut self, other: &Self, weight: f64) {
        self.objects += weight * other.objects;
        self.found += weight * other.found;
        self.depth.add(&other.depth, weight);
        self.ground.add(&other.ground, weight);
    }

    /// The figures; `None` where there is nothing to take a mean of.
    pub(super) fn metrics(&self) -> RangingMetrics<Option<f64>> {
        let [depth, ground] = [&self.depth, &self.ground].map(|sums| sums.means(self.found));
        RangingMetrics::from_fn(|metric| {
            let value = match metric {
                RangingMetric::Share => self.found / self.objects,
                RangingMetric::MaeZ => depth.absolute,
                RangingMetric::RmseZ => depth.squared.sqrt(),
                RangingMetric::BiasZ => depth.signed,
                RangingMetric::AbsRelZ => depth.relative,
                RangingMetric::BiasRelZ => depth.signed_relative,
                RangingMetric::Delta105Z => depth.within[0],
                RangingMetric::Delta110Z => depth.within[1],
                RangingMetric::Delta125Z => depth.within[2],
                RangingMetric::MaeGround => ground.absolute,
                RangingMetric::RmseGround => ground.squared.sqrt(),
                RangingMetric::BiasGround => ground.signed,
                RangingMetric::AbsRelGround => ground.relative,
                RangingMetric::Delta105Ground => ground.within[0],
                RangingMetric::Delta110Ground => ground.within[1],
                RangingMetric::Delta125Ground => ground.within[2],
            };
            // 0 / 0: no objects, or none found.
            (!value.is_nan()).then_some(value)
        })
    }
}

/// The tallies of a set of objects, kept by frame and cell so that frames can be drawn at random and slices taken
/// afterwards.
pub(super) struct Tallies {
    /// Position of the frame, position of the cell, and what is there.
    entries: Vec<(usize, usize, Tally)>,
    cells: Vec<Cell>,
}

impl Tallies {
    pub(super) fn new<'a>(targets: impl IntoIterator<Item = &'a Target>) -> Self {
        let mut by_place: BTreeMap<(Cell, u32), Tally> = BTreeMap::new();
        for target in targets {
            by_place.entry((Cell::of(target), target.frame)).or_default().add(&Tally::of(target), 1.0);
        }
        let mut cells: Vec<Cell> = Vec::new();
        let mut entries = Vec::with_capacity(by_place.len());
        for ((cell, frame), tally) in by_place {
            if cells.last() != Some(&cell) {
                cells.push(cell);
            }
            entries.push((frame as usize, cells.len() - 1, tally));
        }
        Self { entries, cells }
    }

    /// The tally of each slice; `drawn` says how often each frame counts, `None` that each counts once.
    pub(super) fn of_slices(&self, slices: &[Slice], drawn: Option<&[u32]>) -> Vec<Tally> {
        let mut of_cells = vec![Tally::default(); self.cells.len()];
        for (frame, cell, tally) in &self.entries {
            let weight = drawn.map_or(1.0, |drawn| f64::from(drawn[*frame]));
            if weight > 0.0 {
                of_cells[*cell].add(tally, weight);
            }
        }
        let total = |slice: &Slice| {
            let mut total = Tally::default();
            for (_, tally) in self.cells.iter().zip(&of_cells).filter(|(cell, _)| cell.is_in(*slice)) {
                total.add(tally, 1.0);
            }
            total
        };
        slices.iter().map(total).collect()
    }
}

impl ErrorSums {
    fn of(predicted_m: f64, true_m: f64) -> Self {
        let error = predicted_m - true_m;
        let ratio = (predicted_m / true_m).max(true_m / predicted_m);
        // A distance of the wrong sign is right within no factor.
        let is_right = |factor: f64| f64::from(u8::from(ratio > 0.0 && ratio < factor));
        Self {
            signed: error,
            absolute: error.abs(),
            squared: error * error,
            relative: error.abs() / true_m.abs().max(MIN_TRUE_DISTANCE_M),
            signed_relative: error / true_m.abs().max(MIN_TRUE_DISTANCE_M),
            within: DELTA_FACTORS.map(is_right),
        }
    }

    fn add(&mut self, other: &Self, weight: f64) {
        self.signed += weight * other.signed;
        self.absolute += weight * other.absolute;
        self.squared += weight * other.squared;
        self.relative += weight * other.relative;
        self.signed_relative += weight * other.signed_relative;
        for (sum, value) in self.within.iter_mut().zip(other.within) {
            *sum += weight * value;
        }
    }

    fn means(&self, count: f64) -> Self {
        Self {
            signed: self.signed / count,
            absolute: self.absolute / count,
            squared: self.squared / count,
            relative: self.relative / count,
            signed_relative: self.signed_relative / count,
            within: self.within.map(|sum| sum / count),
        }
    }
}
