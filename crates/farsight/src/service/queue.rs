//! Threads that look at images, and what waits for them.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};

use super::infer::Infer;
use super::metrics::Metrics;
use super::rejection::Rejection;
use crate::ViewSource;
use crate::json::ImageRecord;

/// An image to be looked at.
pub(super) struct Task {
    pub(super) bytes: Bytes,
    pub(super) name: PathBuf,
    pub(super) views: ViewSource,
}

pub(super) type Answer = Result<ImageRecord, Rejection>;

/// What is on its way through the queue.
struct Job {
    task: Task,
    turn: Arc<Turn>,
    reply: oneshot::Sender<Answer>,
    since: Instant,
    /// Given back when the job is done or dropped: what a client left behind still counts.
    place: OwnedSemaphorePermit,
}

/// Whether the work of a job has begun or never will: who says so first decides.
#[derive(Default)]
struct Turn(AtomicU8);

impl Turn {
    const BEGUN: u8 = 1;
    const GIVEN_UP: u8 = 2;

    fn take(&self, state: u8) -> bool {
        self.0.compare_exchange(0, state, Ordering::AcqRel, Ordering::Acquire).is_ok()
    }
}

/// A place in the queue, held before the body is read.
pub(super) struct Place(OwnedSemaphorePermit);

/// At most so many jobs, and the threads that do them.
pub(super) struct Queue {
    jobs: Sender<Job>,
    places: Arc<Semaphore>,
    all_places: usize,
    workers: usize,
    /// Jobs that are done now.
    working: Arc<AtomicUsize>,
    metrics: Arc<Metrics>,
}

impl Queue {
    /// Starts the threads.
    pub(super) fn start(
        infer: &Arc<dyn Infer>,
        workers: usize,
        waiting: usize,
        metrics: Arc<Metrics>,
    ) -> io::Result<Self> {
        let (jobs, todo) = channel();
        let todo = Arc::new(Mutex::new(todo));
        let working = Arc::new(AtomicUsize::new(0));
        for number in 0..workers {
            let worker = Worker {
                infer: Arc::clone(infer),
                todo: Arc::clone(&todo),
                working: Arc::clone(&working),
                metrics: Arc::clone(&metrics),
            };
            thread::Builder::new().name(format!("farsight-{number}")).spawn(move || worker.work())?;
        }
        let all_places = workers + waiting;
        Ok(Self { jobs, places: Arc::new(Semaphore::new(all_places)), all_places, workers, working, metrics })
    }

    /// A place for one more, at once or not at all.
    pub(super) fn place(&self) -> Result<Place, Rejection> {
        let taken = Arc::clone(&self.places).try_acquire_owned();
        taken.map(Place).map_err(|_| Rejection::queue_full(self.retry_after_s()))
    }

    /// Requests that are inside.
    pub(super) fn inside(&self) -> usize {
        self.all_places - self.places.available_permits()
    }

    /// Requests that are inside and whose work has not begun.
    pub(super) fn waiting(&self) -> usize {
        self.inside().saturating_sub(self.working.load(Ordering::Relaxed))
    }

    /// How long the queue takes to be empty at its present speed, seconds, at least one.
    fn retry_after_s(&self) -> u64 {
        let rounds = self.inside().div_ceil(self.workers) as f64;
        (rounds * self.metrics.mean_work_s()).ceil().clamp(1.0, 60.0) as u64
    }

    /// Looks at an image when it is its turn, if that is before the deadline.
    pub(super) async fn answer(&self, task: Task, Place(place): Place, deadline: Instant) -> Answer {
        let (reply, mut answer) = oneshot::channel();
        let turn = Arc::new(Turn::default());
        let job = Job { task, turn: Arc::clone(&turn), reply, since: Instant::now(), place };
        if self.jobs.send(job).is_err() {
            return Err(Rejection::ending());
        }
        let in_time = tokio::time::timeout_at(deadline.into(), &mut answer).await;
        let answer = match in_time {
            Ok(answer) => answer,
            Err(_) if turn.take(Turn::GIVEN_UP) => return Err(Rejection::deadline()),
            // It was begun in time, so it is finished.
            Err(_) => answer.await,
        };
        answer.unwrap_or_else(|_| Err(Rejection::panicked()))
    }
}

/// One thread: does jobs until the service is gone.
struct Worker {
    infer: Arc<dyn Infer>,
    todo: Arc<Mutex<Receiver<Job>>>,
    working: Arc<AtomicUsize>,
    metrics: Arc<Metrics>,
}

impl Worker {
    fn work(self) {
        loop {
            let next = self.todo.lock().unwrap_or_else(PoisonError::into_inner).recv();
            let Ok(Job { task, turn, reply, since, place }) = next else { return };
            // Nobody waits for what was given up or whose client went away.
            if reply.is_closed() || !turn.take(Turn::BEGUN) {
                continue;
            }
            self.metrics.began(since.elapsed());
            self.working.fetch_add(1, Ordering::Relaxed);
            let answer = self.answer(&task);
            self.working.fetch_sub(1, Ordering::Relaxed);
            drop(place);
            // The client may be gone by now.
            let _ = reply.send(answer);
        }
    }

    fn answer(&self, task: &Task) -> Answer {
        let begun = Instant::now();
        let looked = catch_unwind(AssertUnwindSafe(|| self.infer.infer(&task.bytes, &task.name, &task.views)));
        let stages = looked.as_ref().ok().and_then(|looked| Some(looked.as_ref().ok()?.times));
        self.metrics.worked(begun.elapsed(), stages);
        match looked {
            Ok(looked) => looked.map(|looked| looked.record).map_err(|error| Rejection::from(&error)),
            Err(_) => Err(Rejection::panicked()),
        }
    }
}

/// A deadline so far from now.
pub(super) fn deadline_in(time: Duration) -> Instant {
    let now = Instant::now();
    now.checked_add(time).unwrap_or(now)
}
