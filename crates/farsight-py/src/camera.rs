//! Cameras as they are given in Python.

use farsight::{Camera, CameraSource};
use pyo3::exceptions::PyValueError;
use pyo3::{FromPyObject, PyResult};

use crate::errors;

/// One way to say which camera it was.
#[derive(FromPyObject)]
pub(crate) enum CameraArgument {
    /// Horizontal field of view, degrees.
    Hfov(f64),
    /// The projection `P`, row by row.
    Projection([[f64; 4]; 3]),
    /// The intrinsic matrix `K`, row by row.
    Intrinsics([[f64; 3]; 3]),
}

impl CameraArgument {
    /// The camera that it means.
    #[allow(clippy::float_cmp, reason = "these numbers are exact in every intrinsic matrix")]
    pub(crate) fn source(self) -> PyResult<CameraSource> {
        match self {
            Self::Hfov(degrees) => Ok(CameraSource::FieldOfView(degrees)),
            Self::Projection(projection) => same(projection),
            Self::Intrinsics([[fx, skew, cx], [zero, fy, cy], last]) => {
                if zero != 0.0 || last != [0.0, 0.0, 1.0] {
                    return Err(PyValueError::new_err(
                        "K is no intrinsic matrix; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels",
                    ));
                }
                if skew != 0.0 {
                    return same([[fx, skew, cx, 0.0], [0.0, fy, cy, 0.0], [0.0, 0.0, 1.0, 0.0]]);
                }
                Ok(CameraSource::Intrinsics { fx, fy, cx: Some(cx), cy: Some(cy) })
            }
        }
    }
}

fn same(projection: [[f64; 4]; 3]) -> PyResult<CameraSource> {
    Ok(CameraSource::Same(Camera::from_projection(projection).map_err(|error| errors::camera(&error.into()))?))
}
