//! How much memory a piece of work takes.

#![allow(unsafe_code, reason = "an allocator that counts can only be written with it")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator, which counts what is allocated. A test makes it its allocator:
///
/// ```
/// #[global_allocator]
/// static ALLOCATOR: farsight_testing::Counting = farsight_testing::Counting;
///
/// let (bytes, text) = farsight_testing::peak(|| "a".repeat(1000));
/// assert!(bytes >= 1000 && text.len() == 1000);
/// ```
#[derive(Debug)]
pub struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// Bytes that this thread has asked for so far.
    static ASKED: Cell<usize> = const { Cell::new(0) };
}

fn count(size: usize) {
    ASKED.set(ASKED.get().wrapping_add(size));
    let now = NOW.fetch_add(size, Ordering::Relaxed) + size;
    PEAK.fetch_max(now, Ordering::Relaxed);
}

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller promised.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(place, layout) }
    }
}

/// Bytes that are allocated at most while `work` runs, beside those that were before, and what it gives.
///
/// One piece of work at a time: whatever else the process does meanwhile counts, too.
pub fn peak<T>(work: impl FnOnce() -> T) -> (usize, T) {
    let before = NOW.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    let done = work();
    (PEAK.load(Ordering::Relaxed).saturating_sub(before), done)
}

/// Bytes that this thread asks for in all while it does `work`, freed or not, and what `work` gives. Other threads do
/// not count, nor does what libraries in other languages allocate.
pub fn asked<T>(work: impl FnOnce() -> T) -> (usize, T) {
    let before = ASKED.get();
    let done = work();
    (ASKED.get().wrapping_sub(before), done)
}
