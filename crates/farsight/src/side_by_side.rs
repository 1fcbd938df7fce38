//! Neighbouring items done side by side, their answers taken in order.

use std::ops::ControlFlow;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

/// How many answers a worker may be ahead of what was taken: it need not wait for a neighbour whose item takes longer.
const AHEAD: usize = 2;

/// Does `work` for each of `items` on so many threads, and hands the answers to `take` one by one, in the order of the
/// items, on the thread that calls.
///
/// Worker `i` of `n` does the items `i`, `i + n`, `i + 2n` and so on. It waits when [`AHEAD`] of its answers were not
/// taken, so memory does not grow with the number of items. When `take` breaks, no further item is begun. One worker is
/// the calling thread itself.
///
/// # Errors
/// The first error of `take`; no further item is begun then.
pub(crate) fn in_order<I: Sync, A: Send, E>(
    items: &[I],
    workers: usize,
    work: impl Fn(&I) -> A + Sync,
    mut take: impl FnMut(&I, A) -> Result<ControlFlow<()>, E>,
) -> Result<(), E> {
    let workers = workers.min(items.len());
    if workers < 2 {
        for item in items {
            if take(item, work(item))?.is_break() {
                break;
            }
        }
        return Ok(());
    }
    thread::scope(|scope| {
        let start = |first: usize| {
            let (sender, receiver): (SyncSender<A>, Receiver<A>) = sync_channel(AHEAD);
            let (mine, work) = (items.iter().skip(first).step_by(workers), &work);
            scope.spawn(move || {
                for item in mine {
                    // Nobody listens any more when `take` has broken.
                    if sender.send(work(item)).is_err() {
                        break;
                    }
                }
            });
            receiver
        };
        let receivers: Vec<Receiver<A>> = (0..workers).map(start).collect();
        for (item, receiver) in items.iter().zip(receivers.iter().cycle()) {
            // A worker that panicked sends nothing; the end of the scope hands its panic on.
            let Ok(answer) = receiver.recv() else { break };
            if take(item, answer)?.is_break() {
                break;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::convert::Infallible;
    use std::ops::ControlFlow;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::thread;
    use std::time::Duration;

    use super::{AHEAD, in_order};

    #[test]
    fn answers_come_in_order_from_all_workers() {
        let items: Vec<u64> = (0..40).collect();
        for workers in [1, 2, 3, 100] {
            let threads = Mutex::new(BTreeSet::new());
            let work = |item: &u64| {
                threads.lock().unwrap().insert(format!("{:?}", thread::current().id()));
                // Later items are done sooner.
                thread::sleep(Duration::from_micros(400 - 10 * item));
                item * item
            };
            let mut taken = Vec::new();
            let done = in_order(&items, workers, work, |item, answer| {
                taken.push((*item, answer));
                Ok::<_, Infallible>(ControlFlow::Continue(()))
            });
            done.unwrap();
            let expected: Vec<(u64, u64)> = items.iter().map(|item| (*item, item * item)).collect();
            assert_eq!(taken, expected, "{workers} workers");
            assert_eq!(threads.lock().unwrap().len(), workers.min(items.len()));
        }
    }

    #[test]
    fn workers_wait_for_who_takes() {
        let items: Vec<usize> = (0..60).collect();
        let begun = AtomicUsize::new(0);
        let mut most_ahead = 0;
        let work = |_: &usize| begun.fetch_add(1, Ordering::SeqCst);
        let done = in_order(&items, 3, work, |item, _| {
            thread::sleep(Duration::from_millis(1));
            most_ahead = most_ahead.max(begun.load(Ordering::SeqCst) - item);
            Ok::<_, Infallible>(ControlFlow::Continue(()))
        });
        done.unwrap();
        // Each worker has so many answers that wait, one that it wants to send, and one that was just taken from it.
        assert!(most_ahead <= 3 * (AHEAD + 2), "{most_ahead} items ahead");
    }

    #[test]
    fn a_break_and_an_error_end_the_work() {
        let items: Vec<usize> = (0..1000).collect();
        for workers in [1, 2] {
            for fails in [false, true] {
                let begun = AtomicUsize::new(0);
                let work = |item: &usize| {
                    begun.fetch_add(1, Ordering::SeqCst);
                    *item
                };
                let mut taken = 0;
                let done = in_order(&items, workers, work, |_, answer| {
                    taken += 1;
                    match (answer, fails) {
                        (3, true) => Err("it failed"),
                        (3, false) => Ok(ControlFlow::Break(())),
                        _ => Ok(ControlFlow::Continue(())),
                    }
                });
                assert_eq!(done, if fails { Err("it failed") } else { Ok(()) });
                assert_eq!(taken, 4);
                assert!(begun.load(Ordering::SeqCst) < 20, "{begun:?} of 1000 were begun");
            }
        }
    }

    #[test]
    #[should_panic(expected = "a scoped thread panicked")]
    fn a_panic_is_handed_on() {
        let work = |item: &usize| assert_ne!(*item, 5, "the fifth");
        let _ = in_order(&[1, 2, 3, 4, 5, 6, 7, 8], 2, work, |_, ()| Ok::<_, Infallible>(ControlFlow::Continue(())));
    }
}
