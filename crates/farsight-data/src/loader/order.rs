//! Which item comes when.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use rand::seq::SliceRandom;

use super::{ItemKey, LoaderConfig, LoaderError, Pcg64, Position, SeedableRng};

/// Epochs whose order is kept; workers are never further apart than the prefetch reaches.
const KEPT_PERMUTATIONS: usize = 4;

/// Tells the generator of an epoch's order from those of its items.
const ORDER_STREAM: u64 = u64::MAX;

/// The order of items, as arithmetic on one running number.
#[derive(Debug, Clone, Copy)]
pub(super) struct Order {
    items: usize,
    /// Items handed out in an epoch.
    used: u64,
    batch_size: u64,
    seed: u64,
    shuffle: bool,
}

impl Order {
    pub(super) fn new(config: &LoaderConfig) -> Result<Self, LoaderError> {
        let &LoaderConfig { items, batch_size, seed, shuffle, drop_last, workers, prefetch, .. } = config;
        let counts = [("items", items), ("batch_size", batch_size), ("workers", workers), ("prefetch", prefetch)];
        if let Some((name, _)) = counts.into_iter().find(|(_, count)| *count == 0) {
            return Err(LoaderError::Zero { name });
        }
        let used = if drop_last { items - items % batch_size } else { items };
        if used == 0 {
            return Err(LoaderError::NoFullBatch { items, batch_size });
        }
        Ok(Self { items, used: used as u64, batch_size: batch_size as u64, seed, shuffle })
    }

    pub(super) fn batches_per_epoch(&self) -> u64 {
        self.used.div_ceil(self.batch_size)
    }

    /// The end of an epoch is the start of the next.
    pub(super) fn normalised(&self, position: Position) -> Result<Position, LoaderError> {
        let (batch, batches) = (position.batch, self.batches_per_epoch());
        match batch.cmp(&batches) {
            std::cmp::Ordering::Less => Ok(position),
            std::cmp::Ordering::Equal => Ok(Position { epoch: position.epoch + 1, batch: 0 }),
            std::cmp::Ordering::Greater => Err(LoaderError::Start { batch, batches }),
        }
    }

    pub(super) fn after(&self, position: Position) -> Position {
        let batch = position.batch + 1;
        if batch < self.batches_per_epoch() {
            Position { batch, ..position }
        } else {
            Position { epoch: position.epoch + 1, batch: 0 }
        }
    }

    /// Running number of the first item of a batch.
    pub(super) fn first_item(&self, position: Position) -> u64 {
        position.epoch.saturating_mul(self.used).saturating_add(position.batch * self.batch_size)
    }

    pub(super) fn batch_len(&self, position: Position) -> u64 {
        self.batch_size.min(self.used - position.batch * self.batch_size)
    }

    /// The item with this running number.
    pub(super) fn key(&self, sequence: u64, permutations: &Permutations) -> ItemKey {
        let (epoch, place) = (sequence / self.used, (sequence % self.used) as usize);
        let index = if self.shuffle { permutations.of(epoch, self)[place] } else { place };
        ItemKey { epoch, index, seed: self.seed }
    }

    fn permutation(&self, epoch: u64) -> Arc<[usize]> {
        let mut indices: Vec<usize> = (0..self.items).collect();
        indices.shuffle(&mut rng([self.seed, epoch, ORDER_STREAM]));
        indices.into()
    }
}

/// The orders of the latest epochs, shared by the workers.
#[derive(Debug, Default)]
pub(super) struct Permutations(Mutex<VecDeque<(u64, Arc<[usize]>)>>);

impl Permutations {
    fn of(&self, epoch: u64, order: &Order) -> Arc<[usize]> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, permutation)) = kept.iter().find(|(of, _)| *of == epoch) {
            return Arc::clone(permutation);
        }
        let permutation = order.permutation(epoch);
        kept.push_back((epoch, Arc::clone(&permutation)));
        if kept.len() > KEPT_PERMUTATIONS {
            kept.pop_front();
        }
        permutation
    }
}

/// A generator for these three numbers; neighbouring numbers give unrelated generators.
pub(super) fn rng(parts: [u64; 3]) -> Pcg64 {
    let mixed = parts.into_iter().fold(0, |state, part| mix(state ^ mix(part)));
    Pcg64::seed_from_u64(mixed)
}

/// One step of `SplitMix64`: every bit of the input moves half of the output's.
fn mix(value: u64) -> u64 {
    let value = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let value = (value ^ (value >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    value ^ (value >> 31)
}
