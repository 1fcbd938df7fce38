//! The camera of an image, as a request says it.

use std::fmt;
use std::path::Path;

use farsight_data::kitti::Calibration;
use serde::de::{self, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use super::Config;
use super::rejection::Rejection;
use crate::{CameraSource, Lens, ViewSource};

/// The camera of an image: one of these ways, or none where the image says it itself.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraQuery {
    /// The name of one that is stored.
    camera: Option<String>,
    /// Degrees, or auto.
    hfov: Option<FieldOfView>,
    /// Pixels, as are the next three.
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    /// Twelve numbers with commas between them: the projection, row by row.
    projection: Option<String>,
    /// Six numbers with commas between them: the road below that projection, as a calibration file has it.
    road: Option<String>,
    /// What distorts the image, as `--lens` has it.
    lens: Option<String>,
}

/// What `hfov=` takes: a number, as a number or as text, or auto.
#[derive(Debug, Clone, Copy, PartialEq)]
enum FieldOfView {
    Degrees(f64),
    Estimated,
}

impl<'de> Deserialize<'de> for FieldOfView {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Text;

        impl Visitor<'_> for Text {
            type Value = FieldOfView;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number of degrees or auto")
            }

            fn visit_f64<E: de::Error>(self, degrees: f64) -> Result<FieldOfView, E> {
                Ok(FieldOfView::Degrees(degrees))
            }

            fn visit_u64<E: de::Error>(self, degrees: u64) -> Result<FieldOfView, E> {
                Ok(FieldOfView::Degrees(degrees as f64))
            }

            fn visit_i64<E: de::Error>(self, degrees: i64) -> Result<FieldOfView, E> {
                Ok(FieldOfView::Degrees(degrees as f64))
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<FieldOfView, E> {
                if text == "auto" {
                    return Ok(FieldOfView::Estimated);
                }
                let wrong = || E::invalid_value(Unexpected::Str(text), &self);
                text.parse().map(FieldOfView::Degrees).map_err(|_| wrong())
            }
        }

        deserializer.deserialize_any(Text)
    }
}

impl CameraQuery {
    /// From parameters of a request in JSON.
    pub(super) fn from_parameters(parameters: Value) -> Result<Self, Rejection> {
        serde_json::from_value(parameters).map_err(|error| Rejection::bad_request(format!("parameters: {error}")))
    }

    /// What is known of how the image was taken.
    pub(super) fn views(&self, config: &Config) -> Result<ViewSource, Rejection> {
        let Self { camera, hfov, fx, fy, cx, cy, projection, road, lens } = self;
        let ways = [camera.is_some(), hfov.is_some(), fx.is_some(), projection.is_some()];
        if ways.into_iter().filter(|way| *way).count() > 1 {
            let message = "several cameras; expected one of camera=, hfov=, fx= and projection=";
            return Err(Rejection::bad_request(message));
        }
        if fx.is_none() && [fy, cx, cy].iter().any(|value| value.is_some()) {
            return Err(Rejection::bad_request("fy, cx and cy need fx=; expected it beside them"));
        }
        if road.is_some() && projection.is_none() {
            return Err(Rejection::bad_request("road= needs projection=; expected it beside it"));
        }
        if camera.is_some() && lens.is_some() {
            return Err(Rejection::bad_request("lens= beside camera=; expected one: a stored camera has its own lens"));
        }
        if let Some(name) = camera {
            let unknown = || Rejection::not_found("no_camera", unknown("camera", name, config.cameras.keys()));
            return config.cameras.get(name).cloned().ok_or_else(unknown);
        }
        let cameras = match (projection, *fx, *hfov) {
            (Some(projection), ..) => calibrated(projection, road.as_deref())?,
            (None, Some(fx), _) => CameraSource::Intrinsics { fx, fy: fy.unwrap_or(fx), cx: *cx, cy: *cy },
            (None, None, Some(FieldOfView::Degrees(degrees))) => CameraSource::FieldOfView(degrees),
            (None, None, Some(FieldOfView::Estimated)) => CameraSource::Estimated,
            (None, None, None) => CameraSource::Exif,
        };
        let lens = lens.as_deref().map(str::parse::<Lens>).transpose();
        let lens = lens.map_err(|error| Rejection::bad_request(error.to_string()))?;
        Ok(ViewSource::from(cameras).with_lens(lens))
    }
}

/// The camera of rows as a calibration file has them, with commas between their numbers.
fn calibrated(projection: &str, road: Option<&str>) -> Result<CameraSource, Rejection> {
    let row = |(name, numbers): (&str, &str)| format!("{name}: {}\n", numbers.replace([',', '\n'], " "));
    let rows = [Some(("P2", projection)), road.map(|road| ("road", road))].into_iter().flatten();
    let calibration = Calibration::from_text(&rows.map(row).collect::<String>(), Path::new("projection=, road="));
    let expected = "projection= takes twelve numbers with commas between them, row by row, road= six";
    let calibration = calibration.map_err(|error| Rejection::bad_request(format!("{error}; {expected}")))?;
    Ok(CameraSource::of_calibration(&calibration))
}

/// What is told of a name that is not known.
pub(super) fn unknown<'a>(kind: &str, name: &str, known: impl Iterator<Item = &'a String>) -> String {
    let known: Vec<&str> = known.map(String::as_str).collect();
    let expected = if known.is_empty() { "none is stored here".to_owned() } else { known.join(", ") };
    format!("no {kind} {name:?}; expected one of these: {expected}")
}
