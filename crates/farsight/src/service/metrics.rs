//! Counts and times, in the text format of `OpenMetrics`, which Prometheus reads.

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::time::Duration;

use farsight_runtime::StageTimes;
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};

/// Upper ends of the bins of times, seconds.
const BINS_S: [f64; 12] = [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0];

/// Upper ends of the bins of batches, images.
const BATCH_BINS: [f64; 7] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];

/// The weight of the newest time in the mean of times.
const NEWEST: f64 = 0.1;

/// What became of a request.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Outcome {
    route: String,
    status: u16,
    reason: &'static str,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Stage {
    stage: &'static str,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Route {
    route: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Video {
    video: String,
}

type Times<L> = Family<L, Histogram, fn() -> Histogram>;

/// What has happened since the service began.
pub(super) struct Metrics {
    registry: Registry,
    requests: Family<Outcome, Counter>,
    answered: Times<Route>,
    inside: Gauge,
    waiting: Gauge,
    connections: Gauge,
    waited: Histogram,
    batches: Histogram,
    worked: Histogram,
    stages: Times<Stage>,
    frames: Family<Video, Counter>,
    failed_frames: Family<Video, Counter>,
    watchers: Family<Video, Gauge>,
    /// Of the work, seconds, the newest counting most; the bits of a float.
    mean_work_s: AtomicU64,
}

fn histogram() -> Histogram {
    Histogram::new(BINS_S)
}

fn times<L: Clone + Eq + std::hash::Hash>() -> Times<L> {
    Family::new_with_constructor(histogram)
}

impl Metrics {
    pub(super) fn new() -> Self {
        let new = Self {
            registry: Registry::with_prefix("farsight"),
            requests: Family::default(),
            answered: times(),
            inside: Gauge::default(),
            waiting: Gauge::default(),
            connections: Gauge::default(),
            waited: histogram(),
            batches: Histogram::new(BATCH_BINS),
            worked: histogram(),
            stages: times(),
            frames: Family::default(),
            failed_frames: Family::default(),
            watchers: Family::default(),
            mean_work_s: AtomicU64::new(0),
        };
        new.registered()
    }

    fn registered(mut self) -> Self {
        let all = &mut self.registry;
        all.register("requests", "Requests by path, status and reason", self.requests.clone());
        all.register("requests_inside", "Images that wait or are looked at", self.inside.clone());
        all.register("requests_waiting", "Images whose work has not begun", self.waiting.clone());
        all.register("connections", "Connections that are open", self.connections.clone());
        all.register("video_frames", "Frames of videos that were looked at", self.frames.clone());
        all.register("video_failures", "Frames of videos that could not be looked at", self.failed_frames.clone());
        all.register("video_watchers", "Streams of videos that are open", self.watchers.clone());
        let help = "From the head of a request to the head of its answer";
        all.register_with_unit("request", help, Unit::Seconds, self.answered.clone());
        all.register_with_unit(
            "wait",
            "From the body to the beginning of the work",
            Unit::Seconds,
            self.waited.clone(),
        );
        all.register("batch_size", "Images that were looked at together", self.batches.clone());
        let help = "Decoding and looking, each image; in a batch its share";
        all.register_with_unit("work", help, Unit::Seconds, self.worked.clone());
        all.register_with_unit("stage", "Each stage of the work, likewise", Unit::Seconds, self.stages.clone());
        self
    }

    /// A request that was answered.
    pub(super) fn answered(&self, route: &str, status: u16, reason: &'static str, time: Duration) {
        self.requests.get_or_create(&Outcome { route: route.to_owned(), status, reason }).inc();
        self.answered.get_or_create(&Route { route: route.to_owned() }).observe(time.as_secs_f64());
    }

    /// An image whose work began after so long a wait.
    pub(super) fn began(&self, waited: Duration) {
        self.waited.observe(waited.as_secs_f64());
    }

    /// So many images that are looked at together.
    pub(super) fn batch(&self, size: usize) {
        self.batches.observe(size as f64);
    }

    /// An image that was looked at, with its stages if it got an answer.
    pub(super) fn worked(&self, time: Duration, stages: Option<StageTimes>) {
        let time_s = time.as_secs_f64();
        self.worked.observe(time_s);
        let mean_s = self.mean_work_s();
        let mean_s = if mean_s == 0.0 { time_s } else { mean_s + NEWEST * (time_s - mean_s) };
        self.mean_work_s.store(mean_s.to_bits(), Ordering::Relaxed);
        let Some(StageTimes { load, warp, network, decode, refine }) = stages else { return };
        let stages = [("load", load), ("warp", warp), ("network", network), ("decode", decode), ("refine", refine)];
        for (stage, time) in stages {
            self.stages.get_or_create(&Stage { stage }).observe(time.as_secs_f64());
        }
    }

    /// Mean time of the work, seconds; zero before there was some.
    pub(super) fn mean_work_s(&self) -> f64 {
        f64::from_bits(self.mean_work_s.load(Ordering::Relaxed))
    }

    /// How many connections are open.
    pub(super) fn connections(&self) -> &Gauge<i64, AtomicI64> {
        &self.connections
    }

    /// A frame of a video that was looked at, or could not be.
    pub(super) fn frame(&self, video: &str, is_good: bool) {
        let frames = if is_good { &self.frames } else { &self.failed_frames };
        frames.get_or_create(&Video { video: video.to_owned() }).inc();
    }

    /// How many streams of a video are open.
    pub(super) fn watchers(&self, video: &str) -> Gauge {
        self.watchers.get_or_create_owned(&Video { video: video.to_owned() })
    }

    /// The page of metrics, with so many requests inside and so many of them waiting.
    pub(super) fn text(&self, inside: usize, waiting: usize) -> String {
        self.inside.set(inside as i64);
        self.waiting.set(waiting as i64);
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = encode(&mut text, &self.registry);
        text
    }
}
