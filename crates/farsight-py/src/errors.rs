//! Errors as Python's own exceptions.

use std::io::ErrorKind;

use farsight::{CameraSourceError, Error, ImageError, RangeError};
use pyo3::PyErr;
use pyo3::exceptions::{PyFileNotFoundError, PyOSError, PyRuntimeError, PyValueError};

/// What to do about a camera that is not known.
const CAMERA_HINT: &str = "give one of hfov=DEGREES, K=(3, 3), P=(3, 4) or calib=FILE";

/// An image that cannot be read.
pub(crate) fn image(error: &ImageError) -> PyErr {
    match error {
        ImageError::Read { source, .. } if source.kind() == ErrorKind::NotFound => {
            PyFileNotFoundError::new_err(error.to_string())
        }
        ImageError::Read { .. } => PyOSError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// A camera that is not known, or that no camera is.
pub(crate) fn camera(error: &CameraSourceError) -> PyErr {
    PyValueError::new_err(match error {
        CameraSourceError::Camera(_)
        | CameraSourceError::Calibration(_)
        | CameraSourceError::Kind { .. }
        | CameraSourceError::Lens { .. } => error.to_string(),
        _ => format!("{error}; {CAMERA_HINT}"),
    })
}

/// A pipeline that cannot be opened.
pub(crate) fn pipeline(error: &Error) -> PyErr {
    match error {
        Error::Engine(_) | Error::EngineLibrary { .. } | Error::Library(_) => {
            PyRuntimeError::new_err(error.to_string())
        }
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// An image that got no answer.
pub(crate) fn range(error: &RangeError) -> PyErr {
    match error {
        RangeError::Image(error) => image(error),
        RangeError::Camera(error) => camera(error),
        _ => PyRuntimeError::new_err(error.to_string()),
    }
}
