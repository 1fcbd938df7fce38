//! Paths, requests and responses.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use axum::body::{Body, Bytes, to_bytes};
use axum::extract::rejection::QueryRejection;
use axum::extract::{DefaultBodyLimit, FromRequest, Multipart, Query, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use http_body_util::LengthLimitError;
use serde::Deserialize;
use serde_json::json;
use tokio::sync::watch;

use super::metrics::Metrics;
use super::queue::{Queue, Task, deadline_in};
use super::{Config, MAX_BODY_BYTES, Refusal};
use crate::CameraSource;
use crate::json::ImageRecord;

/// What answers call an image that has no name.
const UNNAMED: &str = "image";

/// The page may load and ask this service, and nothing else.
const CONTENT_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                              connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What all requests share.
pub(super) struct Shared {
    pub(super) queue: Queue,
    pub(super) metrics: Arc<Metrics>,
    pub(super) config: Config,
    pub(super) stopped: watch::Receiver<bool>,
}

type Service = State<Arc<Shared>>;

/// The paths of the service.
pub(super) fn router(shared: Arc<Shared>) -> Router {
    let guarded = Router::new()
        .route("/v1/range", post(range))
        .route("/v1/cameras", get(cameras))
        .route("/metrics", get(metrics))
        .layer(from_fn_with_state(Arc::clone(&shared), check_token));
    let page =
        |kind: &'static str, text: &'static str| get(move || async move { ([(header::CONTENT_TYPE, kind)], text) });
    Router::new()
        .route("/", page("text/html; charset=utf-8", include_str!("page/index.html")))
        .route("/page.css", page("text/css; charset=utf-8", include_str!("page/page.css")))
        .route("/page.js", page("text/javascript; charset=utf-8", include_str!("page/page.js")))
        .route("/v2/health/live", get(|| async { Json(json!({"live": true})) }))
        .route("/v2/health/ready", get(ready))
        .merge(guarded)
        .fallback(|| async {
            Refusal::new(StatusCode::NOT_FOUND, "not_found", "no such path; docs/service.md has them")
        })
        .layer(axum::middleware::map_response(with_headers))
        .with_state(shared)
}

/// What browsers are told of every response.
async fn with_headers(mut response: Response) -> Response {
    let headers: [(HeaderName, &'static str); 4] = [
        (header::CONTENT_SECURITY_POLICY, CONTENT_POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ];
    for (name, value) in headers {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

async fn check_token(State(shared): Service, request: Request, next: Next) -> Response {
    let Some(token) = &shared.config.token else { return next.run(request).await };
    let given = request.headers().get(header::AUTHORIZATION).map(HeaderValue::as_bytes);
    if given.and_then(|given| given.strip_prefix(b"Bearer ")).is_some_and(|given| token.is(given)) {
        return next.run(request).await;
    }
    drain(request.into_body());
    let message = "no token, or another one; expected the header Authorization: Bearer TOKEN";
    Refusal::new(StatusCode::UNAUTHORIZED, "unauthorized", message).into_response()
}

async fn ready(State(shared): Service) -> Response {
    if *shared.stopped.borrow() {
        return Refusal::ending().into_response();
    }
    Json(json!({"ready": true})).into_response()
}

async fn metrics(State(shared): Service) -> Response {
    let kind = [(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")];
    (kind, shared.metrics.text(shared.queue.inside())).into_response()
}

async fn cameras(State(shared): Service) -> Response {
    let names: Vec<&String> = shared.config.cameras.keys().collect();
    Json(json!({"cameras": names})).into_response()
}

/// The camera of an image, as the address says it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraQuery {
    camera: Option<String>,
    hfov: Option<f64>,
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
}

impl CameraQuery {
    fn source(&self, config: &Config) -> Result<CameraSource, Refusal> {
        let Self { camera, hfov, fx, fy, cx, cy } = self;
        let ways = [camera.is_some(), hfov.is_some(), fx.is_some()].into_iter().filter(|way| *way).count();
        if ways > 1 {
            return Err(Refusal::bad_request("several cameras; expected one of camera=, hfov= and fx="));
        }
        if fx.is_none() && [fy, cx, cy].iter().any(|value| value.is_some()) {
            return Err(Refusal::bad_request("fy, cx and cy need fx=; expected it beside them"));
        }
        if let Some(name) = camera {
            let known = || config.cameras.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            let unknown = || {
                let expected = if config.cameras.is_empty() { "none is stored here".to_owned() } else { known() };
                let message = format!("no camera {name:?}; expected one of these: {expected}");
                Refusal::new(StatusCode::NOT_FOUND, "no_camera", message)
            };
            return config.cameras.get(name).cloned().ok_or_else(unknown);
        }
        Ok(match (*fx, *hfov) {
            (Some(fx), _) => CameraSource::Intrinsics { fx, fy: fy.unwrap_or(fx), cx: *cx, cy: *cy },
            (None, Some(degrees)) => CameraSource::FieldOfView(degrees),
            (None, None) => CameraSource::Exif,
        })
    }
}

async fn range(
    State(shared): Service,
    query: Result<Query<CameraQuery>, QueryRejection>,
    headers: HeaderMap,
    body: Body,
) -> Response {
    let begun = Instant::now();
    let answer = answer(&shared, query, headers, body).await;
    let (status, reason) = answer.as_ref().map_or_else(|refusal| (refusal.status, refusal.reason), |_| (200, "ok"));
    shared.metrics.answered(status, reason, begun.elapsed());
    answer.map_or_else(IntoResponse::into_response, |record| Json(record).into_response())
}

async fn answer(
    shared: &Shared,
    query: Result<Query<CameraQuery>, QueryRejection>,
    headers: HeaderMap,
    body: Body,
) -> Result<ImageRecord, Refusal> {
    let deadline = deadline_in(shared.config.deadline);
    let admitted = admitted(shared, query, &headers);
    let (cameras, place) = match admitted {
        Ok(admitted) => admitted,
        Err(refusal) => {
            drain(body);
            return Err(refusal);
        }
    };
    let reading = image(headers, body);
    let read = tokio::time::timeout_at(deadline.into(), reading).await;
    let (bytes, name) = read.unwrap_or_else(|_| Err(Refusal::slow_body()))?;
    shared.queue.answer(Task { bytes, name, cameras }, place, deadline).await
}

/// What shows before the body is read: its camera, and a place in the queue.
fn admitted(
    shared: &Shared,
    query: Result<Query<CameraQuery>, QueryRejection>,
    headers: &HeaderMap,
) -> Result<(CameraSource, super::queue::Place), Refusal> {
    let Query(query) = query.map_err(|error| Refusal::bad_request(error.body_text()))?;
    let cameras = query.source(&shared.config)?;
    let length = headers.get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
    if length.is_some_and(|length| length > MAX_BODY_BYTES as u64) {
        return Err(Refusal::body_too_large());
    }
    Ok((cameras, shared.queue.place()?))
}

/// Reads what a refused client still sends, in moderation: one that is cut off while it sends sees no answer.
fn drain(body: Body) {
    tokio::spawn(async move {
        let reading = to_bytes(body, MAX_BODY_BYTES);
        // What comes of it does not matter.
        let _ = tokio::time::timeout(super::PAUSE * 20, reading).await;
    });
}

/// The image in a body, raw or in a form, and its name.
async fn image(headers: HeaderMap, body: Body) -> Result<(Bytes, PathBuf), Refusal> {
    let bytes = to_bytes(body, MAX_BODY_BYTES).await.map_err(|error| refused_body(&error))?;
    let kind = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    if !kind.trim_start().to_ascii_lowercase().starts_with("multipart/form-data") {
        return if bytes.is_empty() {
            Err(Refusal::bad_request("the body is empty; expected an image file"))
        } else {
            Ok((bytes, UNNAMED.into()))
        };
    }
    let mut request = Request::new(Body::from(bytes));
    *request.headers_mut() = headers;
    // It was counted above.
    DefaultBodyLimit::disable().apply(&mut request);
    let broken = |error: String| Refusal::bad_request(format!("the form is broken: {error}"));
    let mut form = Multipart::from_request(request, &()).await.map_err(|error| broken(error.body_text()))?;
    while let Some(field) = form.next_field().await.map_err(|error| broken(error.body_text()))? {
        if field.file_name().is_some() || field.name() == Some("image") {
            let name = field.file_name().and_then(|name| Path::new(name).file_name());
            let name = name.map_or_else(|| PathBuf::from(UNNAMED), PathBuf::from);
            let bytes = field.bytes().await.map_err(|error| broken(error.body_text()))?;
            return Ok((bytes, name));
        }
    }
    Err(Refusal::bad_request("the form has no file; expected a field \"image\" with an image file"))
}

/// A body that is too long or broke off.
fn refused_body(error: &axum::Error) -> Refusal {
    if error.source().is_some_and(<dyn Error>::is::<LengthLimitError>) {
        return Refusal::body_too_large();
    }
    Refusal::bad_request("the body broke off")
}
