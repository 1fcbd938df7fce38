//! Cameras and lenses as they are given in Python.

use std::path::PathBuf;

use farsight::{Camera, CameraSource, CameraSourceError, LensError, ViewSource};
use pyo3::exceptions::PyValueError;
use pyo3::{FromPyObject, PyResult};

use crate::errors;

/// How images were taken: their camera, where it is given, and the text of a lens.
pub(crate) type ViewArgument = (Option<CameraArgument>, Option<String>);

/// What an argument means; a camera that is not given is what `otherwise` says.
pub(crate) fn views(
    (camera, lens): ViewArgument,
    otherwise: impl FnOnce() -> Result<CameraSource, CameraSourceError>,
) -> PyResult<ViewSource> {
    let cameras = match camera {
        None => otherwise().map_err(|error| errors::camera(&error))?,
        // A calibration beside the image is no estimate.
        Some(CameraArgument::Estimated(true)) => {
            otherwise().ok().filter(|known| *known == CameraSource::Kitti).unwrap_or(CameraSource::Estimated)
        }
        Some(given) => given.source()?,
    };
    let lens = lens.map(|lens| lens.parse()).transpose();
    let lens = lens.map_err(|error: LensError| PyValueError::new_err(error.to_string()))?;
    Ok(ViewSource::from(cameras).with_lens(lens))
}

/// One way to say which camera it was.
#[derive(FromPyObject)]
pub(crate) enum CameraArgument {
    /// Estimated from the image, where that does not tell: true, as Python's `hfov="auto"` comes here.
    Estimated(bool),
    /// Horizontal field of view, degrees.
    Hfov(f64),
    /// The projection `P`, row by row.
    Projection([[f64; 4]; 3]),
    /// The intrinsic matrix `K`, row by row.
    Intrinsics([[f64; 3]; 3]),
    /// A calibration in KITTI's format, or a folder with one for each image.
    Calibration(PathBuf),
}

impl CameraArgument {
    /// The camera that it means.
    #[allow(clippy::float_cmp, reason = "these numbers are exact in every intrinsic matrix")]
    fn source(self) -> PyResult<CameraSource> {
        match self {
            Self::Calibration(path) => CameraSource::from_calibration(&path).map_err(|error| errors::camera(&error)),
            Self::Estimated(_) => Ok(CameraSource::Estimated),
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
