//! `POST /v1/range`: an image in, what is in it out.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use axum::Json;
use axum::body::{Body, Bytes, to_bytes};
use axum::extract::rejection::QueryRejection;
use axum::extract::{DefaultBodyLimit, FromRequest, Multipart, Query, Request, State};
use axum::http::{HeaderMap, header};
use http_body_util::LengthLimitError;

use super::MAX_BODY_BYTES;
use super::camera_query::CameraQuery;
use super::guard::drain;
use super::queue::{Place, Task, deadline_in};
use super::rejection::Rejection;
use super::shared::{Service, Shared};
use crate::json::ImageRecord;

/// What answers call an image that has no name.
pub(super) const UNNAMED: &str = "image";

/// Looks at an image.
pub(super) async fn range(
    State(shared): Service,
    query: Result<Query<CameraQuery>, QueryRejection>,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<ImageRecord>, Rejection> {
    let deadline = deadline_in(shared.config.deadline);
    let views = query
        .map_err(|error| Rejection::bad_request(error.body_text()))
        .and_then(|Query(query)| query.views(&shared.config));
    let (views, body, place) = match views {
        Ok(views) => {
            let (body, place) = admitted(&shared, &headers, body)?;
            (views, body, place)
        }
        Err(rejection) => {
            drain(body);
            return Err(rejection);
        }
    };
    let bytes = read(body, deadline).await?;
    let (bytes, name) = image(headers, bytes).await?;
    shared.queue.answer(Task { bytes, name, views }, place, deadline).await.map(Json)
}

/// The body and a place in the queue for it, before it is read.
pub(super) fn admitted(shared: &Shared, headers: &HeaderMap, body: Body) -> Result<(Body, Place), Rejection> {
    let length = headers.get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
    let place = if length.is_some_and(|length| length > MAX_BODY_BYTES as u64) {
        Err(Rejection::body_too_large())
    } else {
        shared.queue.place()
    };
    match place {
        Ok(place) => Ok((body, place)),
        Err(rejection) => {
            drain(body);
            Err(rejection)
        }
    }
}

/// The body, if it is there by the deadline.
pub(super) async fn read(body: Body, deadline: Instant) -> Result<Bytes, Rejection> {
    let read = tokio::time::timeout_at(deadline.into(), to_bytes(body, MAX_BODY_BYTES)).await;
    read.map_err(|_| Rejection::slow_body())?.map_err(|error| refused_body(&error))
}

/// The image in a body, raw or in a form, and its name.
async fn image(headers: HeaderMap, bytes: Bytes) -> Result<(Bytes, PathBuf), Rejection> {
    let kind = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    if !kind.trim_start().to_ascii_lowercase().starts_with("multipart/form-data") {
        return if bytes.is_empty() {
            Err(Rejection::bad_request("the body is empty; expected an image file"))
        } else {
            Ok((bytes, UNNAMED.into()))
        };
    }
    let mut request = Request::new(Body::from(bytes));
    *request.headers_mut() = headers;
    // It was counted above.
    DefaultBodyLimit::disable().apply(&mut request);
    let broken = |error: String| Rejection::bad_request(format!("the form is broken: {error}"));
    let mut form = Multipart::from_request(request, &()).await.map_err(|error| broken(error.body_text()))?;
    while let Some(field) = form.next_field().await.map_err(|error| broken(error.body_text()))? {
        if field.file_name().is_some() || field.name() == Some("image") {
            let name = field.file_name().and_then(|name| Path::new(name).file_name());
            let name = name.map_or_else(|| PathBuf::from(UNNAMED), PathBuf::from);
            let bytes = field.bytes().await.map_err(|error| broken(error.body_text()))?;
            return Ok((bytes, name));
        }
    }
    Err(Rejection::bad_request("the form has no file; expected a field \"image\" with an image file"))
}

/// A body that is too long or broke off.
fn refused_body(error: &axum::Error) -> Rejection {
    if error.source().is_some_and(<dyn Error>::is::<LengthLimitError>) {
        return Rejection::body_too_large();
    }
    Rejection::bad_request("the body broke off")
}
