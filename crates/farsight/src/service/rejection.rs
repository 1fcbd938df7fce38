//! Requests that get no answer, and why.

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use farsight_data::ImageError;
use serde_json::{Value, json};

use super::MAX_BODY_BYTES;
use crate::{CameraSourceError, RangeError};

/// Why a request gets no answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rejection {
    /// Status of the response.
    pub status: u16,
    /// One word for programs and metrics.
    pub reason: &'static str,
    /// What is wrong and what was expected, for people.
    pub message: String,
    /// After how many seconds another try may do better.
    pub retry_after_s: Option<u64>,
}

impl Rejection {
    pub(super) fn new(status: StatusCode, reason: &'static str, message: impl Into<String>) -> Self {
        Self { status: status.as_u16(), reason, message: message.into(), retry_after_s: None }
    }

    pub(super) fn bad_request(message: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "bad_request", message)
    }

    pub(super) fn not_found(reason: &'static str, message: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, reason, message)
    }

    pub(super) fn queue_full(retry_after_s: u64) -> Self {
        let message = format!("the queue is full; try again in {retry_after_s} s");
        let rejection = Self::new(StatusCode::TOO_MANY_REQUESTS, "queue_full", message);
        Self { retry_after_s: Some(retry_after_s), ..rejection }
    }

    pub(super) fn deadline() -> Self {
        Self::new(StatusCode::GATEWAY_TIMEOUT, "deadline", "the deadline passed before the work began")
    }

    pub(super) fn slow_body() -> Self {
        Self::new(StatusCode::REQUEST_TIMEOUT, "slow_body", "the body did not arrive before the deadline")
    }

    pub(super) fn body_too_large() -> Self {
        let message = format!("the body is too large; expected at most {} MB", MAX_BODY_BYTES >> 20);
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "body_too_large", message)
    }

    /// Says nothing of what panicked: that is in the log.
    pub(super) fn panicked() -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "panic", "the service failed at this image")
    }

    pub(super) fn ending() -> Self {
        let rejection = Self::new(StatusCode::SERVICE_UNAVAILABLE, "ending", "the service ends");
        Self { retry_after_s: Some(1), ..rejection }
    }
}

impl From<&RangeError> for Rejection {
    fn from(error: &RangeError) -> Self {
        match error {
            RangeError::Image(ImageError::TooLarge { width, height, limit, .. }) => {
                let message = format!("the image has {width} x {height} pixels; expected at most {limit}");
                Self::new(StatusCode::PAYLOAD_TOO_LARGE, "too_many_pixels", message)
            }
            RangeError::Image(error) => Self::new(StatusCode::BAD_REQUEST, "bad_image", error.to_string()),
            // Here and with the model the text may name files of this machine.
            RangeError::Camera(
                CameraSourceError::NoCalibration { .. }
                | CameraSourceError::Kind { .. }
                | CameraSourceError::Calibration(_),
            ) => Self::new(StatusCode::INTERNAL_SERVER_ERROR, "calibration", "the camera's calibration cannot be read"),
            RangeError::Camera(error @ CameraSourceError::Lens { .. }) => {
                Self::new(StatusCode::BAD_REQUEST, "bad_lens", error.to_string())
            }
            RangeError::Camera(error) => {
                let message = format!("{error}; give one of hfov=DEGREES, fx=PIXELS or camera=NAME");
                Self::new(StatusCode::BAD_REQUEST, "no_camera", message)
            }
            RangeError::Detect(_) => {
                Self::new(StatusCode::INTERNAL_SERVER_ERROR, "model", "the model failed at this image")
            }
        }
    }
}

/// The reason of a rejection, for metrics and logs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reason(pub(super) &'static str);

impl Rejection {
    /// The response with this body instead of the usual one.
    pub(super) fn response(&self, body: &Value) -> Response {
        let Self { status, reason, retry_after_s, .. } = *self;
        let status = StatusCode::from_u16(status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let mut response = (status, Json(body)).into_response();
        response.extensions_mut().insert(Reason(reason));
        if let Some(seconds) = retry_after_s {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        if status == StatusCode::UNAUTHORIZED {
            response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

impl IntoResponse for Rejection {
    fn into_response(self) -> Response {
        self.response(&json!({"error": {"reason": self.reason, "message": self.message}}))
    }
}
