//! The camera of an image, as a request says it.

use serde::Deserialize;
use serde_json::Value;

use super::Config;
use super::refusal::Refusal;
use crate::{Camera, CameraSource};

/// The camera of an image: one of these ways, or none where the image says it itself.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraQuery {
    /// The name of one that is stored.
    camera: Option<String>,
    /// Degrees.
    hfov: Option<f64>,
    /// Pixels, as are the next three.
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    /// Twelve numbers with commas between them: the projection, row by row.
    projection: Option<String>,
}

impl CameraQuery {
    /// From parameters of a request in JSON.
    pub(super) fn from_parameters(parameters: Value) -> Result<Self, Refusal> {
        serde_json::from_value(parameters).map_err(|error| Refusal::bad_request(format!("parameters: {error}")))
    }

    /// What is known of the camera.
    pub(super) fn source(&self, config: &Config) -> Result<CameraSource, Refusal> {
        let Self { camera, hfov, fx, fy, cx, cy, projection } = self;
        let ways = [camera.is_some(), hfov.is_some(), fx.is_some(), projection.is_some()];
        if ways.into_iter().filter(|way| *way).count() > 1 {
            let message = "several cameras; expected one of camera=, hfov=, fx= and projection=";
            return Err(Refusal::bad_request(message));
        }
        if fx.is_none() && [fy, cx, cy].iter().any(|value| value.is_some()) {
            return Err(Refusal::bad_request("fy, cx and cy need fx=; expected it beside them"));
        }
        if let Some(name) = camera {
            let unknown = || Refusal::not_found("no_camera", unknown("camera", name, config.cameras.keys()));
            return config.cameras.get(name).cloned().ok_or_else(unknown);
        }
        if let Some(text) = projection {
            return Ok(CameraSource::Same(camera_from(text)?));
        }
        Ok(match (*fx, *hfov) {
            (Some(fx), _) => CameraSource::Intrinsics { fx, fy: fy.unwrap_or(fx), cx: *cx, cy: *cy },
            (None, Some(degrees)) => CameraSource::FieldOfView(degrees),
            (None, None) => CameraSource::Exif,
        })
    }
}

fn camera_from(text: &str) -> Result<Camera, Refusal> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let numbers: Option<[f64; 12]> = numbers.and_then(|numbers| numbers.try_into().ok());
    let Some(numbers) = numbers else {
        let message = "projection= is no projection; expected twelve numbers with commas between them, row by row";
        return Err(Refusal::bad_request(message));
    };
    let projection = [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| numbers[4 * row + column]));
    Camera::from_projection(projection).map_err(|error| Refusal::bad_request(error.to_string()))
}

/// What is told of a name that is not known.
pub(super) fn unknown<'a>(kind: &str, name: &str, known: impl Iterator<Item = &'a String>) -> String {
    let known: Vec<&str> = known.map(String::as_str).collect();
    let expected = if known.is_empty() { "none is stored here".to_owned() } else { known.join(", ") };
    format!("no {kind} {name:?}; expected one of these: {expected}")
}
