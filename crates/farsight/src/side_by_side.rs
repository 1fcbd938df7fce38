//! Neighbouring items done side by side, their answers taken in order.

use std::ops::ControlFlow;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread;

/// How many answers for each worker may wait to be taken: none need wait for a neighbour whose item takes longer.
const AHEAD: usize = 1;

/// Does `work` for each of `items` on so many threads, and hands the answers to `take` one by one, in the order of the
/// items, on the thread that calls.
///
/// A worker that has nothing to do takes the next item; `items` may read it from a file, as one worker at a time asks.
/// Workers wait when [`AHEAD`] answers for each of them were not taken, so memory does not grow with the number of
/// items. When `take` breaks, no further item is begun. One worker is the calling thread itself.
///
/// # Errors
/// The first error of `take`; no further item is begun then.
pub(crate) fn in_order<I, A: Send, E>(
    items: impl IntoIterator<Item = I, IntoIter: Send>,
    workers: usize,
    work: impl Fn(I) -> A + Sync,
    mut take: impl FnMut(A) -> Result<ControlFlow<()>, E>,
) -> Result<(), E> {
    let items = items.into_iter();
    let (_, most) = items.size_hint();
    let workers = workers.min(most.unwrap_or(usize::MAX));
    if workers < 2 {
        for item in items {
            if take(work(item))?.is_break() {
                break;
            }
        }
        return Ok(());
    }
    let (queue, answers): (SyncSender<Receiver<A>>, _) = sync_channel(AHEAD * workers);
    let source = Arc::new(Mutex::new((items, queue)));
    thread::scope(|scope| {
        for _ in 0..workers {
            let (source, work) = (Arc::clone(&source), &work);
            scope.spawn(move || {
                while let Some((item, answer)) = next(&source) {
                    // Nobody listens any more when `take` has broken.
                    if answer.send(work(item)).is_err() {
                        break;
                    }
                }
            });
        }
        // The queue ends with the last worker.
        drop(source);
        for answer in answers {
            // A worker that panicked sends nothing; the end of the scope hands its panic on.
            let Ok(answer) = answer.recv() else { break };
            if take(answer)?.is_break() {
                break;
            }
        }
        Ok(())
    })
}

/// The next item and where its answer goes; its place in the queue is taken before any other worker has the next one.
/// None when there are no more, nobody waits for answers, or another worker panicked over it.
fn next<I, A>(source: &Mutex<(impl Iterator<Item = I>, SyncSender<Receiver<A>>)>) -> Option<(I, SyncSender<A>)> {
    let mut source = source.lock().ok()?;
    let item = source.0.next()?;
    let (sender, receiver) = sync_channel(1);
    source.1.send(receiver).ok()?;
    Some((item, sender))
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
        for workers in [1, 2, 3, 100] {
            let threads = Mutex::new(BTreeSet::new());
            let work = |item: u64| {
                threads.lock().unwrap().insert(format!("{:?}", thread::current().id()));
                // Later items are done sooner.
                thread::sleep(Duration::from_micros(400 - 10 * item));
                item * item
            };
            let mut taken = Vec::new();
            let done = in_order(0..40, workers, work, |answer| {
                taken.push(answer);
                Ok::<_, Infallible>(ControlFlow::Continue(()))
            });
            done.unwrap();
            let expected: Vec<u64> = (0..40).map(|item| item * item).collect();
            assert_eq!(taken, expected, "{workers} workers");
            let threads = threads.lock().unwrap().len();
            assert!((workers.min(2)..=workers.min(40)).contains(&threads), "{threads} threads, {workers} workers");
        }
    }

    #[test]
    fn workers_wait_for_who_takes() {
        let begun = AtomicUsize::new(0);
        let mut most_ahead = 0;
        let work = |item: usize| {
            begun.fetch_add(1, Ordering::SeqCst);
            item
        };
        let done = in_order(0..60, 3, work, |item| {
            thread::sleep(Duration::from_millis(1));
            most_ahead = most_ahead.max(begun.load(Ordering::SeqCst) - item);
            Ok::<_, Infallible>(ControlFlow::Continue(()))
        });
        done.unwrap();
        // So many answers wait for each worker; it works at one, and one was just taken.
        assert!(most_ahead <= 3 * (AHEAD + 1) + 1, "{most_ahead} items ahead");
    }

    #[test]
    fn a_break_and_an_error_end_the_work() {
        for workers in [1, 2] {
            for fails in [false, true] {
                let begun = AtomicUsize::new(0);
                let work = |item: usize| {
                    begun.fetch_add(1, Ordering::SeqCst);
                    item
                };
                let mut taken = 0;
                let done = in_order(0..1000, workers, work, |answer| {
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
        let work = |item: usize| assert_ne!(item, 5, "the fifth");
        let _ = in_order(1..9, 2, work, |()| Ok::<_, Infallible>(ControlFlow::Continue(())));
    }
}
