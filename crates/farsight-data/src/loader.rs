//! A loader that prepares items ahead on several threads and hands out batches in one fixed order.
//!
//! Order and content depend on the seed alone: not on the number of threads, not on which of them is faster, and not on
//! whether the loader was started at this place or ran up to it. So a training continues bit for bit from a saved
//! [`Position`].

mod order;
mod queue;

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::{error, io};

use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use order::{Order, Permutations};
use queue::Queue;

/// Which batch: the epoch and the batch within it, both from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Position {
    /// Number of the epoch.
    pub epoch: u64,
    /// Number of the batch within the epoch.
    pub batch: u64,
}

/// What to load, in what order, how far ahead.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoaderConfig {
    /// Number of items in an epoch; they are numbered from 0.
    pub items: usize,
    /// Items in a batch.
    pub batch_size: usize,
    /// Decides about order and variation.
    pub seed: u64,
    /// Whether each epoch has an order of its own; otherwise items come by number.
    pub shuffle: bool,
    /// Whether the last batch of an epoch is left out when it is not full.
    pub drop_last: bool,
    /// Number of threads that prepare items.
    pub workers: usize,
    /// Batches that may be in preparation or waiting, the next one included; bounds the memory.
    pub prefetch: usize,
    /// The first batch to hand out.
    pub start: Position,
    /// Where to stop: the number of epochs, counted from epoch 0. `None` goes on for ever.
    pub epochs: Option<u64>,
}

/// One item of one epoch, and the randomness that belongs to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ItemKey {
    /// Number of the epoch.
    pub epoch: u64,
    /// Number of the item.
    pub index: usize,
    /// The loader's seed.
    pub seed: u64,
}

impl ItemKey {
    /// A generator for this item in this epoch: the same whenever, wherever and after whatever it is asked for.
    pub fn rng(&self) -> Pcg64 {
        order::rng([self.seed, self.epoch, self.index as u64])
    }
}

/// Items that were asked for together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Batch<T> {
    /// Where in the training this batch stands.
    pub position: Position,
    /// The items, in order.
    pub items: Vec<T>,
}

/// Why a loader cannot start.
#[derive(Debug, Error)]
pub enum LoaderError {
    /// A number that must be positive is 0.
    #[error("{name} is 0; expected at least 1")]
    Zero {
        /// Which.
        name: &'static str,
    },
    /// No batch is ever full.
    #[error(
        "{items} items make no full batch of {batch_size}; expected more items, a smaller batch, or incomplete batches kept"
    )]
    NoFullBatch {
        /// Items in an epoch.
        items: usize,
        /// Items in a batch.
        batch_size: usize,
    },
    /// The epoch has fewer batches than the start says.
    #[error("start is batch {batch} of its epoch; expected at most {batches}, the number of batches in an epoch")]
    Start {
        /// What was given.
        batch: u64,
        /// Batches in an epoch.
        batches: u64,
    },
    /// The system gives no thread.
    #[error("cannot start a loader thread: {0}")]
    Thread(#[from] io::Error),
}

/// Why a batch cannot be had. The next batch can be asked for all the same.
#[derive(Debug, Error)]
pub enum ItemError<E: error::Error + 'static> {
    /// An item could not be prepared.
    #[error("item {index} of epoch {epoch}: {source}")]
    Failed {
        /// Number of the item.
        index: usize,
        /// Number of the epoch.
        epoch: u64,
        /// Why.
        source: E,
    },
    /// The code that prepares items panicked: a defect, not a bad file.
    #[error("item {index} of epoch {epoch}: preparing it panicked: {message}")]
    Panicked {
        /// Number of the item.
        index: usize,
        /// Number of the epoch.
        epoch: u64,
        /// What the panic says.
        message: String,
    },
}

/// Prepares items ahead and hands them out in batches; an iterator over them. Dropping it stops its threads.
#[derive(Debug)]
pub struct Loader<T, E: error::Error + 'static> {
    order: Order,
    queue: Arc<Queue<Result<T, ItemError<E>>>>,
    threads: Vec<JoinHandle<()>>,
    position: Position,
    epochs: Option<u64>,
}

impl<T, E> Loader<T, E>
where
    T: Send + 'static,
    E: error::Error + Send + 'static,
{
    /// Starts the threads; `prepare` makes an item from its key and should draw only from [`ItemKey::rng`].
    ///
    /// # Errors
    /// When the configuration makes no batches or a thread cannot be started.
    pub fn new<F>(config: &LoaderConfig, prepare: F) -> Result<Self, LoaderError>
    where
        F: Fn(ItemKey) -> Result<T, E> + Send + Sync + 'static,
    {
        let order = Order::new(config)?;
        let position = order.normalised(config.start)?;
        let first = order.first_item(position);
        let end = config.epochs.map_or(u64::MAX, |epochs| order.first_item(Position { epoch: epochs, batch: 0 }));
        let queue = Arc::new(Queue::new(first, end, config.prefetch as u64 * config.batch_size as u64));
        let mut loader = Self { order, queue, threads: Vec::new(), position, epochs: config.epochs };
        let permutations = Arc::new(Permutations::default());
        let prepare = Arc::new(prepare);
        for number in 0..config.workers {
            let (order, queue) = (loader.order, Arc::clone(&loader.queue));
            let (permutations, prepare) = (Arc::clone(&permutations), Arc::clone(&prepare));
            let work = move || {
                while let Some(sequence) = queue.claim() {
                    let key = order.key(sequence, &permutations);
                    queue.put(sequence, prepared(&*prepare, key));
                }
            };
            // Should this fail, dropping the loader stops the threads that run already.
            loader.threads.push(thread::Builder::new().name(format!("loader-{number}")).spawn(work)?);
        }
        Ok(loader)
    }

    /// The batch that comes next: where to start another loader so that it goes on from here.
    pub fn position(&self) -> Position {
        self.position
    }

    /// Batches in an epoch.
    pub fn batches_per_epoch(&self) -> u64 {
        self.order.batches_per_epoch()
    }
}

impl<T, E> Iterator for Loader<T, E>
where
    T: Send + 'static,
    E: error::Error + Send + 'static,
{
    type Item = Result<Batch<T>, ItemError<E>>;

    /// Waits for the next batch. A batch with a bad item is that item's error; the batch after it can be had all the
    /// same.
    fn next(&mut self) -> Option<Self::Item> {
        let position = self.position;
        if self.epochs.is_some_and(|epochs| position.epoch >= epochs) {
            return None;
        }
        let outcomes = self.queue.take(self.order.first_item(position), self.order.batch_len(position));
        self.position = self.order.after(position);
        Some(outcomes.into_iter().collect::<Result<_, _>>().map(|items| Batch { position, items }))
    }
}

impl<T, E: error::Error + 'static> Drop for Loader<T, E> {
    fn drop(&mut self) {
        self.queue.stop();
        for thread in self.threads.drain(..) {
            // Panics of items were caught and told already.
            let _ = thread.join();
        }
    }
}

fn prepared<T, E: error::Error>(prepare: &impl Fn(ItemKey) -> Result<T, E>, key: ItemKey) -> Result<T, ItemError<E>> {
    let ItemKey { epoch, index, .. } = key;
    match catch_unwind(AssertUnwindSafe(|| prepare(key))) {
        Ok(outcome) => outcome.map_err(|source| ItemError::Failed { index, epoch, source }),
        Err(panic) => Err(ItemError::Panicked { index, epoch, message: panic_message(&*panic) }),
    }
}

fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no message".to_owned())
}
