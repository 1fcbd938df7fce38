//! Films and cameras that are watched: each runs while somebody does.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use farsight_core::Detection;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use tokio::sync::watch;

use super::PAUSE;
use super::log::{Log, LogRecord, now_s};
use super::metrics::Metrics;
use crate::View;
use crate::draw::draw_tracks;
use crate::json::FrameRecord;

/// Quality of the frames that are shown, of 100.
const JPEG_QUALITY: u8 = 80;

/// A frame, and what was found in it.
#[derive(Debug, Clone)]
pub struct SourceFrame {
    /// The tracks.
    pub record: FrameRecord,
    /// The same as detections, in the same order.
    pub detections: Vec<Detection>,
    /// How it was taken.
    pub view: View,
    /// Its pixels.
    pub image: RgbImage,
}

/// Why there is no frame; for those who run the service, as it may name files and addresses.
pub type VideoFailure = Box<dyn Error + Send + Sync>;

/// Frames, one after the other. After a failure there may be more.
pub type SourceFrames = Box<dyn Iterator<Item = Result<SourceFrame, VideoFailure>> + Send>;

/// A film or camera that can be watched.
pub trait Video: fmt::Debug + Send + Sync + 'static {
    /// Its frames from the beginning; of a camera, from now on.
    ///
    /// # Errors
    /// When it cannot be read.
    fn open(&self) -> Result<SourceFrames, VideoFailure>;
}

/// All videos by their names.
pub(super) struct Videos(BTreeMap<String, Arc<Channel>>);

impl Videos {
    pub(super) fn new(
        videos: &BTreeMap<String, Arc<dyn Video>>,
        metrics: &Arc<Metrics>,
        log: &Log,
        stopped: &watch::Receiver<bool>,
    ) -> Self {
        let channel = |(name, video): (&String, &Arc<dyn Video>)| {
            let channel = Channel {
                name: name.clone(),
                video: Arc::clone(video),
                metrics: Arc::clone(metrics),
                log: log.clone(),
                stopped: stopped.clone(),
                latest: watch::Sender::new(Moment::default()),
                is_running: Mutex::new(false),
            };
            (name.clone(), Arc::new(channel))
        };
        Self(videos.iter().map(channel).collect())
    }

    pub(super) fn get(&self, name: &str) -> Option<&Arc<Channel>> {
        self.0.get(name)
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &String> {
        self.0.keys()
    }
}

/// What those who watch see.
#[derive(Clone, Default)]
pub(super) struct Moment {
    /// The latest frame.
    pub(super) shown: Option<Arc<Shown>>,
    /// Why there will be no other.
    pub(super) end: Option<End>,
}

/// Why there are no more frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    Ended,
    /// It cannot be read.
    Failed,
}

/// A frame on its way to those who watch.
pub(super) struct Shown {
    pub(super) seen: SourceFrame,
    plain: OnceLock<Bytes>,
    drawn: OnceLock<Bytes>,
}

impl Shown {
    /// The frame as JPEG, with what was found drawn into it or without. It is made when somebody first asks.
    pub(super) fn jpeg(&self, is_drawn: bool) -> Bytes {
        let SourceFrame { record, detections, view, image } = &self.seen;
        if is_drawn {
            let draw = || jpeg(&draw_tracks(image, view.camera(), view.lens(), detections, &record.tracks));
            return self.drawn.get_or_init(draw).clone();
        }
        self.plain.get_or_init(|| jpeg(image)).clone()
    }
}

fn jpeg(image: &RgbImage) -> Bytes {
    let mut bytes = Vec::new();
    // Writing to memory cannot fail, and a frame has sides that JPEG can have; one that has not is shown as nothing.
    let _ = image.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY));
    bytes.into()
}

/// How it came that there are no more frames.
enum Ran {
    Ended,
    /// Nobody watched any more.
    Left,
}

/// One video.
pub(super) struct Channel {
    name: String,
    video: Arc<dyn Video>,
    metrics: Arc<Metrics>,
    log: Log,
    stopped: watch::Receiver<bool>,
    latest: watch::Sender<Moment>,
    is_running: Mutex<bool>,
}

impl Channel {
    /// Begins to watch: what has begun already from its present frame on, anything else from its beginning.
    pub(super) fn watch(self: &Arc<Self>) -> io::Result<watch::Receiver<Moment>> {
        let mut is_running = self.is_running();
        // Before it runs: without anybody who watches it would end at once.
        let latest = self.latest.subscribe();
        if !*is_running {
            self.latest.send_replace(Moment::default());
            let channel = Arc::clone(self);
            thread::Builder::new().name(format!("video-{}", self.name)).spawn(move || channel.run())?;
            *is_running = true;
        }
        Ok(latest)
    }

    pub(super) fn watchers(&self) -> prometheus_client::metrics::gauge::Gauge {
        self.metrics.watchers(&self.name)
    }

    fn is_running(&self) -> MutexGuard<'_, bool> {
        self.is_running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn run(&self) {
        loop {
            let ran = catch_unwind(AssertUnwindSafe(|| self.show_all()));
            let is_left = matches!(ran, Ok(Ok(Ran::Left)));
            let end = match ran {
                Ok(Ok(_)) => End::Ended,
                Ok(Err(failure)) => {
                    self.tell(&format!("cannot be read: {failure}"));
                    End::Failed
                }
                Err(_) => {
                    self.tell("failed with a panic");
                    End::Failed
                }
            };
            let mut is_running = self.is_running();
            // Somebody came after the last one had gone.
            if is_left && self.latest.receiver_count() > 0 && !*self.stopped.borrow() {
                continue;
            }
            self.latest.send_modify(|moment| moment.end = Some(end));
            *is_running = false;
            return;
        }
    }

    fn show_all(&self) -> Result<Ran, VideoFailure> {
        self.tell("begins");
        let (mut begun, mut shown) = (None, 0_u64);
        let mut last_failure = None;
        for frame in self.video.open()? {
            if self.is_left() {
                self.tell(&format!("is left after {shown} frames"));
                return Ok(Ran::Left);
            }
            self.metrics.frame(&self.name, frame.is_ok());
            match frame {
                Ok(seen) => {
                    // A film is shown no faster than it was taken.
                    let time_s = seen.record.time_s;
                    let (start, first_s) = *begun.get_or_insert((Instant::now(), time_s));
                    self.wait(start, Duration::try_from_secs_f64(time_s - first_s).unwrap_or_default());
                    shown += 1;
                    let shown = Shown { seen, plain: OnceLock::new(), drawn: OnceLock::new() };
                    self.latest.send_replace(Moment { shown: Some(Arc::new(shown)), end: None });
                }
                Err(failure) => {
                    self.tell(&format!("a frame failed: {failure}"));
                    last_failure = Some(failure);
                }
            }
        }
        self.tell(&format!("ended after {shown} frames"));
        match last_failure {
            Some(failure) if shown == 0 => Err(failure),
            _ => Ok(Ran::Ended),
        }
    }

    /// Whether nobody watches, or the service ends.
    fn is_left(&self) -> bool {
        *self.stopped.borrow() || self.latest.receiver_count() == 0
    }

    /// Waits until so long after `start`, while somebody watches.
    fn wait(&self, start: Instant, due: Duration) {
        while let Some(left) = due.checked_sub(start.elapsed()).filter(|left| !left.is_zero()) {
            if self.is_left() {
                return;
            }
            thread::sleep(left.min(PAUSE));
        }
    }

    fn tell(&self, message: &str) {
        let (video, message) = (self.name.clone(), message.to_owned());
        self.log.tell(&LogRecord::Video { time_s: now_s(), video, message });
    }
}
