//! `POST /v1/calibrate`: a camera from four points of the road.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use axum::extract::rejection::JsonRejection;
use axum::http::StatusCode;
use farsight_core::road::RoadPlane;
use farsight_core::road_rectangle::{RoadCamera, RoadRectangle};
use farsight_data::kitti::Calibration;
use serde::{Deserialize, Serialize};

use super::rejection::Rejection;
use super::shared::Shared;

/// How far a click lies from what was meant, pixels of a screen: standard deviation in each direction.
const CLICK_PX: f64 = 1.5;

/// Width of the screen that was clicked on when nothing else is said, pixels.
const SCREEN_PX: f64 = 1000.0;

/// A rectangle on the road.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Question {
    /// Of the image, pixels.
    width: u32,
    height: u32,
    /// Column and row of each corner, one after the other around it.
    corners_px: [[f64; 2]; 4],
    /// From the first corner to the second, and from the second to the third, metres.
    sides_m: [f64; 2],
    /// Width of the image where it was clicked on, pixels of the screen.
    shown_px: Option<f64>,
}

/// Its camera.
#[derive(Debug, Serialize)]
pub(super) struct Answer {
    hfov_deg: f64,
    /// What clicks beside the corners by 1.5 pixels make of it; null where another such click tells no camera.
    hfov_sigma_deg: Option<f64>,
    height_m: f64,
    height_sigma_m: Option<f64>,
    pitch_deg: f64,
    roll_deg: f64,
    residual_px: f64,
    projection: [[f64; 4]; 3],
    /// The road under it, as `/v1/range?road=` takes it: slope, tilt and height of the camera, and their standard
    /// deviations; null where these are not known.
    road: Option<[f64; 6]>,
    /// What a file for `--calib` says, with that road.
    calibration: String,
}

/// Finds the camera.
pub(super) async fn calibrate(
    State(_): State<Arc<Shared>>,
    question: Result<Json<Question>, JsonRejection>,
) -> Result<Json<Answer>, Rejection> {
    let Json(question) = question.map_err(|error| Rejection::bad_request(error.body_text()))?;
    let Question { width, height, corners_px, sides_m, shown_px } = question;
    let (rectangle, size) = (RoadRectangle { corners_px, sides_m }, [width, height]);
    if width == 0 || height == 0 {
        return Err(Rejection::bad_request("the image has no pixels; expected its width and height"));
    }
    let unknown = |error: farsight_core::road_rectangle::RoadRectangleError| {
        Rejection::new(StatusCode::UNPROCESSABLE_ENTITY, "no_camera", error.to_string())
    };
    let found = rectangle.camera(size).map_err(unknown)?;
    let shown_px = shown_px.filter(|shown| shown.is_finite() && *shown >= 1.0).unwrap_or(SCREEN_PX);
    let sigmas = sigmas(&rectangle, size, &found, CLICK_PX * f64::from(width) / shown_px);
    let RoadCamera { camera, hfov_deg, height_m, pitch_deg, roll_deg, residual_px } = found;
    // The camera's coordinates are those of its road.
    let road = sigmas.map(|sigmas| RoadPlane {
        slope: 0.0,
        tilt: 0.0,
        height_m,
        sigmas: [sigmas.pitch_deg.to_radians(), sigmas.roll_deg.to_radians(), sigmas.height_m],
    });
    Ok(Json(Answer {
        hfov_deg,
        hfov_sigma_deg: sigmas.map(|sigmas| sigmas.hfov_deg),
        height_m,
        height_sigma_m: sigmas.map(|sigmas| sigmas.height_m),
        pitch_deg,
        roll_deg,
        residual_px,
        projection: camera.projection,
        road: road.map(|RoadPlane { slope, tilt, height_m, sigmas: [a, b, c] }| [slope, tilt, height_m, a, b, c]),
        calibration: Calibration { road, ..Calibration::from_camera(&camera) }.to_text(),
    }))
}

/// Standard deviations of what is told.
#[derive(Debug, Clone, Copy, Default)]
struct Sigmas {
    hfov_deg: f64,
    height_m: f64,
    pitch_deg: f64,
    roll_deg: f64,
}

/// What becomes of the camera when each coordinate is off by `click_px`.
fn sigmas(rectangle: &RoadRectangle, size: [u32; 2], found: &RoadCamera, click_px: f64) -> Option<Sigmas> {
    let mut sigmas = Sigmas::default();
    for place in 0..8 {
        let mut moved = *rectangle;
        moved.corners_px[place / 2][place % 2] += click_px;
        let other = moved.camera(size).ok()?;
        sigmas = Sigmas {
            hfov_deg: sigmas.hfov_deg.hypot(other.hfov_deg - found.hfov_deg),
            height_m: sigmas.height_m.hypot(other.height_m - found.height_m),
            pitch_deg: sigmas.pitch_deg.hypot(other.pitch_deg - found.pitch_deg),
            roll_deg: sigmas.roll_deg.hypot(other.roll_deg - found.roll_deg),
        };
    }
    Some(sigmas)
}
