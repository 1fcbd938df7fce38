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

use super::Config;
use super::infer::{AskedImage, Infer, Inference};
use super::metrics::Metrics;
use super::rejection::Rejection;
use crate::json::ImageRecord;
use crate::{RangeError, ViewSource};

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

impl Job {
    /// Nobody waits for what was given up or whose client went away.
    fn is_wanted(&self) -> bool {
        self.turn.is_open() && !self.reply.is_closed()
    }
}

/// Whether the work of a job has begun or never will: who says so first decides.
#[derive(Default)]
struct Turn(AtomicU8);

impl Turn {
    const BEGUN: u8 = 1;
    const GIVEN_UP: u8 = 2;

    fn is_open(&self) -> bool {
        self.0.load(Ordering::Acquire) == 0
    }

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
    pub(super) fn start(infer: &Arc<dyn Infer>, config: &Config, metrics: Arc<Metrics>) -> io::Result<Self> {
        let [workers, batch] = [config.workers, config.batch].map(|count| count.max(1));
        let (jobs, todo) = channel();
        let todo = Arc::new(Mutex::new(todo));
        let working = Arc::new(AtomicUsize::new(0));
        for number in 0..workers {
            let worker = Worker {
                infer: Arc::clone(infer),
                todo: Arc::clone(&todo),
                working: Arc::clone(&working),
                metrics: Arc::clone(&metrics),
                batch,
                batch_wait: config.batch_wait,
            };
            thread::Builder::new().name(format!("farsight-{number}")).spawn(move || worker.work())?;
        }
        let all_places = workers * batch + config.queue;
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
    /// Most jobs that are done together, and how long the first of them waits for others.
    batch: usize,
    batch_wait: Duration,
}

impl Worker {
    fn work(self) {
        while let Some(jobs) = self.next() {
            let jobs: Vec<Job> = jobs.into_iter().filter(|job| job.is_wanted() && job.turn.take(Turn::BEGUN)).collect();
            if jobs.is_empty() {
                continue;
            }
            for job in &jobs {
                self.metrics.began(job.since.elapsed());
            }
            self.working.fetch_add(jobs.len(), Ordering::Relaxed);
            let answers = self.answers(&jobs.iter().map(|job| &job.task).collect::<Vec<_>>());
            self.working.fetch_sub(jobs.len(), Ordering::Relaxed);
            for (Job { reply, place, .. }, answer) in jobs.into_iter().zip(answers) {
                drop(place);
                // The client may be gone by now.
                let _ = reply.send(answer);
            }
        }
    }

    /// Waits for a job, and a little for others that are done with it. A job that had to wait anyway takes those along
    /// that are there by then.
    fn next(&self) -> Option<Vec<Job>> {
        let todo = self.todo.lock().unwrap_or_else(PoisonError::into_inner);
        let first = todo.recv().ok()?;
        let end = first.since.checked_add(self.batch_wait);
        let mut jobs = vec![first];
        while jobs.len() < self.batch {
            let left = end.map_or(self.batch_wait, |end| end.saturating_duration_since(Instant::now()));
            let Ok(job) = todo.recv_timeout(left) else { break };
            jobs.extend(Some(job).filter(Job::is_wanted));
        }
        Some(jobs)
    }

    fn answers(&self, tasks: &[&Task]) -> Vec<Answer> {
        let begun = Instant::now();
        self.metrics.batch(tasks.len());
        let looked = self.looked(tasks);
        let share = begun.elapsed().div_f64(tasks.len() as f64);
        let answer = |looked: Option<Result<Inference, RangeError>>| {
            let stages = looked.as_ref().and_then(|looked| Some(looked.as_ref().ok()?.times));
            self.metrics.worked(share, stages);
            let looked = looked.ok_or_else(Rejection::panicked)?;
            looked.map(|looked| looked.record).map_err(|error| Rejection::from(&error))
        };
        looked.into_iter().map(answer).collect()
    }

    /// What is in each image; none where that panics.
    fn looked(&self, tasks: &[&Task]) -> Vec<Option<Result<Inference, RangeError>>> {
        let images = tasks.iter().map(|Task { bytes, name, views }| AskedImage { bytes, name, views });
        let images: Vec<AskedImage<'_>> = images.collect();
        // Whoever catches a panic sees nothing of what it left behind.
        let looked = catch_unwind(AssertUnwindSafe(|| match images[..] {
            [AskedImage { bytes, name, views }] => vec![self.infer.infer(bytes, name, views)],
            _ => self.infer.infer_batch(&images),
        }));
        match looked {
            Ok(looked) if looked.len() == tasks.len() => looked.into_iter().map(Some).collect(),
            // One of them breaks it, so each is looked at alone, where it breaks its own request only.
            _ if tasks.len() > 1 => tasks.iter().flat_map(|task| self.looked(&[*task])).collect(),
            _ => vec![None],
        }
    }
}

/// A deadline so far from now.
pub(super) fn deadline_in(time: Duration) -> Instant {
    let now = Instant::now();
    now.checked_add(time).unwrap_or(now)
}
