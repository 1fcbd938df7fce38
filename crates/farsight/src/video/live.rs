//! Frames that come faster than they are looked at: only the latest waits.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;

use super::error::VideoError;
use super::ffmpeg::{Decoded, Decoder};

/// A video that is read as fast as it comes.
pub(super) struct Live {
    path: PathBuf,
    shared: Arc<Shared>,
}

#[derive(Default)]
struct Shared {
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

#[derive(Default)]
struct Waiting {
    frame: Option<Result<Decoded, VideoError>>,
    fps: Option<f64>,
    dropped: u64,
    is_over: bool,
}

impl Live {
    /// Reads on in a thread of its own, which ends with the video or the process.
    pub(super) fn start(mut decoder: Decoder) -> Self {
        let live = Self { path: decoder.path().to_owned(), shared: Arc::default() };
        let shared = Arc::clone(&live.shared);
        thread::spawn(move || {
            loop {
                let frame = decoder.next();
                let is_over = frame.is_none();
                let mut waiting = shared.waiting();
                waiting.fps = decoder.fps();
                waiting.put(frame);
                drop(waiting);
                shared.changed.notify_one();
                if is_over {
                    return;
                }
            }
        });
        live
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn fps(&self) -> Option<f64> {
        self.shared.waiting().fps
    }

    /// Frames that nobody looked at.
    pub(super) fn dropped(&self) -> u64 {
        self.shared.waiting().dropped
    }

    /// The latest frame, as soon as there is one.
    pub(super) fn next(&self) -> Option<Result<Decoded, VideoError>> {
        let mut waiting = self.shared.waiting();
        loop {
            if let Some(frame) = waiting.frame.take() {
                return Some(frame);
            }
            if waiting.is_over {
                return None;
            }
            waiting = self.shared.changed.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Shared {
    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Waiting {
    /// A frame, or the error by which a video broke off, takes the place of a frame that waits.
    fn put(&mut self, frame: Option<Result<Decoded, VideoError>>) {
        match frame {
            None => self.is_over = true,
            Some(frame) => self.dropped += u64::from(self.frame.replace(frame).is_some()),
        }
    }
}
