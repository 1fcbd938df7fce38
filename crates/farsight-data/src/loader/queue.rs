//! What waits between the workers and the one who takes batches.

use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Items by running number: claimed in order, finished in any order, taken in order.
#[derive(Debug)]
pub(super) struct Queue<R> {
    state: Mutex<State<R>>,
    /// An item was finished.
    finished: Condvar,
    /// Items were taken, so others may be started; or there is an end.
    room: Condvar,
    /// The first number that is never asked for.
    end: u64,
    /// How far ahead of the first untaken item others may be claimed.
    ahead: u64,
}

#[derive(Debug)]
struct State<R> {
    next_claim: u64,
    next_take: u64,
    done: BTreeMap<u64, R>,
    stopped: bool,
}

impl<R> Queue<R> {
    pub(super) fn new(first: u64, end: u64, ahead: u64) -> Self {
        let state = State { next_claim: first, next_take: first, done: BTreeMap::new(), stopped: false };
        Self { state: Mutex::new(state), finished: Condvar::new(), room: Condvar::new(), end, ahead }
    }

    /// The next item to prepare, once there is room for it; `None` when there is nothing left to do.
    pub(super) fn claim(&self) -> Option<u64> {
        let full = |state: &mut State<R>| {
            !state.stopped && state.next_claim < self.end && state.next_claim - state.next_take >= self.ahead
        };
        let mut state = self.room.wait_while(self.lock(), full).unwrap_or_else(PoisonError::into_inner);
        if state.stopped || state.next_claim >= self.end {
            return None;
        }
        state.next_claim += 1;
        Some(state.next_claim - 1)
    }

    pub(super) fn put(&self, sequence: u64, item: R) {
        self.lock().done.insert(sequence, item);
        self.finished.notify_one();
    }

    /// Waits for `count` items from `first` on. Every worker answers for what it claimed, so the wait ends.
    pub(super) fn take(&self, first: u64, count: u64) -> Vec<R> {
        let range = first..first + count;
        let missing = |state: &mut State<R>| state.done.range(range.clone()).count() < count as usize;
        let mut state = self.finished.wait_while(self.lock(), missing).unwrap_or_else(PoisonError::into_inner);
        let later = state.done.split_off(&range.end);
        let taken = std::mem::replace(&mut state.done, later);
        state.next_take = range.end;
        drop(state);
        self.room.notify_all();
        taken.into_values().collect()
    }

    /// Sends the workers home after the item they are at.
    pub(super) fn stop(&self) {
        self.lock().stopped = true;
        self.room.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State<R>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
