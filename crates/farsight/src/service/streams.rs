//! What those who watch a video get: server-sent events of its tracks, or its frames as JPEG
//! (`multipart/x-mixed-replace`).
//!
//! Both show the latest frame: who reads slowly misses some, and nothing piles up. Who reads nothing at all is cut off.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::rejection::QueryRejection;
use axum::extract::{Path, Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream::unfold;
use prometheus_client::metrics::gauge::Gauge;
use serde::Deserialize;
use serde_json::json;
use tokio::sync::watch;
use tokio::task::spawn_blocking;
use tokio::time::timeout;

use super::camera_query::unknown;
use super::rejection::Rejection;
use super::shared::{Service, Shared};
use super::unless;
use super::videos::{End, Moment, Shown};

/// So often a stream without frames says that it is alive.
const ALIVE: Duration = Duration::from_secs(10);

/// Between the parts of a stream of frames.
const BOUNDARY: &str = "frame";

/// Somebody who watches.
struct Watcher {
    latest: watch::Receiver<Moment>,
    stopped: watch::Receiver<bool>,
    count: Gauge,
    /// What was shown already.
    last: Option<Arc<Shown>>,
    is_over: bool,
    /// What the last event said of the camera.
    camera: String,
}

impl Drop for Watcher {
    fn drop(&mut self) {
        self.count.dec();
    }
}

/// What comes next for somebody who watches.
enum Next {
    Frame(Arc<Shown>),
    /// Nothing for a while.
    Alive,
    Over(End),
}

impl Watcher {
    fn new(shared: &Shared, name: &str) -> Result<Self, Rejection> {
        let channel = shared.videos.get(name);
        let channel =
            channel.ok_or_else(|| Rejection::not_found("no_video", unknown("video", name, shared.videos.names())))?;
        let full =
            |_| Rejection::new(StatusCode::SERVICE_UNAVAILABLE, "no_thread", "the system gives no thread for it");
        let latest = channel.watch().map_err(full)?;
        let count = channel.watchers();
        count.inc();
        Ok(Self { latest, stopped: shared.stopped.clone(), count, last: None, is_over: false, camera: String::new() })
    }

    /// Waits for the next frame; none after the end.
    async fn next(&mut self) -> Option<Next> {
        if self.is_over {
            return None;
        }
        loop {
            let Moment { shown, end } = self.latest.borrow_and_update().clone();
            let is_known = |shown: &Arc<Shown>| self.last.as_ref().is_some_and(|last| Arc::ptr_eq(last, shown));
            if let Some(shown) = shown.filter(|shown| !is_known(shown)) {
                self.last = Some(Arc::clone(&shown));
                return Some(Next::Frame(shown));
            }
            if let Some(end) = end {
                return Some(self.over(end));
            }
            let mut stopped = self.stopped.clone();
            let stop = Box::pin(stopped.wait_for(|stopped| *stopped));
            let change = Box::pin(timeout(ALIVE, self.latest.changed()));
            match unless(stop, change).await {
                Some(Ok(Ok(()))) => {}
                Some(Err(_)) => return Some(Next::Alive),
                // The service ends.
                None | Some(Ok(Err(_))) => return Some(self.over(End::Ended)),
            }
        }
    }

    fn over(&mut self, end: End) -> Next {
        self.is_over = true;
        Next::Over(end)
    }
}

/// `GET /v1/videos/{video}/tracks`.
pub(super) async fn tracks(State(shared): Service, Path(name): Path<String>) -> Result<Response, Rejection> {
    let watcher = Watcher::new(&shared, &name)?;
    let events = unfold(watcher, |mut watcher| async move {
        let event = match watcher.next().await? {
            Next::Frame(shown) => watcher.event(&shown),
            // A comment.
            Next::Alive => ":\n\n".to_owned(),
            Next::Over(End::Ended) => "event: end\ndata: {}\n\n".to_owned(),
            Next::Over(End::Failed) => "event: failed\ndata: {\"message\":\"the video cannot be read\"}\n\n".to_owned(),
        };
        Some((Ok::<_, Infallible>(Bytes::from(event)), watcher))
    });
    Ok(([(header::CONTENT_TYPE, "text/event-stream")], Body::from_stream(events)).into_response())
}

impl Watcher {
    /// The tracks of a frame, after the camera where it is another one than before.
    fn event(&mut self, shown: &Shown) -> String {
        let record = &shown.seen.record;
        let (width, height) = shown.seen.image.dimensions();
        let view = &shown.seen.view;
        let lens = view.lens().map(|lens| lens.to_string());
        let projection = view.camera().projection;
        let camera = json!({"width": width, "height": height, "projection": projection, "lens": lens}).to_string();
        let mut event = String::new();
        if camera != self.camera {
            event = format!("event: camera\ndata: {camera}\n\n");
            self.camera = camera;
        }
        // These records are text and numbers, which JSON has.
        let line = serde_json::to_string(record).unwrap_or_default();
        event + &format!("id: {}\nevent: frame\ndata: {line}\n\n", record.frame)
    }
}

/// How frames are shown.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FramesQuery {
    /// Without boxes and the view from above.
    #[serde(default)]
    plain: bool,
}

/// `GET /v1/videos/{video}/frames`.
pub(super) async fn frames(
    State(shared): Service,
    Path(name): Path<String>,
    query: Result<Query<FramesQuery>, QueryRejection>,
) -> Result<Response, Rejection> {
    let Query(FramesQuery { plain }) = query.map_err(|error| Rejection::bad_request(error.body_text()))?;
    let watcher = Watcher::new(&shared, &name)?;
    let parts = unfold(watcher, move |mut watcher| async move {
        loop {
            match watcher.next().await? {
                Next::Frame(shown) => {
                    let number = shown.seen.record.frame;
                    // A drawing that panicked shows nothing.
                    let jpeg = spawn_blocking(move || shown.jpeg(!plain)).await.unwrap_or_default();
                    return Some((Ok::<_, Infallible>(part(number, &jpeg)), watcher));
                }
                // Each part is a whole frame, so there is no way to say this in between.
                Next::Alive => {}
                Next::Over(_) => {
                    return Some((Ok(Bytes::from(format!("--{BOUNDARY}--\r\n"))), watcher));
                }
            }
        }
    });
    let kind = format!("multipart/x-mixed-replace; boundary={BOUNDARY}");
    Ok(([(header::CONTENT_TYPE, kind)], Body::from_stream(parts)).into_response())
}

fn part(number: u64, jpeg: &Bytes) -> Bytes {
    let length = jpeg.len();
    let head =
        format!("--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {length}\r\nX-Frame: {number}\r\n\r\n");
    [head.as_bytes(), jpeg, b"\r\n"].concat().into()
}
