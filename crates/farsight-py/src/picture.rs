//! Pictures of answers.

use std::io::{self, Cursor};
use std::path::PathBuf;

use farsight::draw::picture_divisor;
use farsight::json::{DetectionRecord, ImageRecord};
use farsight::{Box2d, Box3d, Camera, DetectedObject, Detection, LensError, ObjectClass, RangeKind, draw_through_lens};
use farsight_core::Dimensions;
use farsight_core::depth_fusion::NORMAL_INTERVAL_SIGMAS;
use farsight_files::write_atomically;
use image::RgbImage;
use image::codecs::png::PngEncoder;
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// Pixels as they come from Python.
pub(crate) fn from_bytes(pixels: &[u8], [width, height]: [u32; 2]) -> PyResult<RgbImage> {
    RgbImage::from_raw(width, height, pixels.to_vec()).ok_or_else(|| {
        let expected = format!("{} bytes are no {width} x {height} pixels of three bytes", pixels.len());
        PyValueError::new_err(expected)
    })
}

/// Pixels, their width and height, and by which number the sides of the image were divided.
type Picture<'py> = (Bound<'py, PyBytes>, [u32; 2], u32);

/// The image of an answer with boxes, distances and the view from above.
#[pyfunction]
pub(crate) fn draw<'py>(py: Python<'py>, pixels: &[u8], record: &str) -> PyResult<Picture<'py>> {
    let record = parsed(record)?;
    let image = from_bytes(pixels, [record.width, record.height])?;
    let camera = camera(&record)?;
    let lens = record.camera.as_ref().and_then(|camera| camera.lens.as_deref()).map(str::parse).transpose();
    let lens = lens.map_err(|error: LensError| PyValueError::new_err(error.to_string()))?;
    let drawn = py.detach(|| {
        let pitch_deg = record.camera.as_ref().and_then(|camera| camera.pitch_deg).unwrap_or(0.0);
        let objects: Vec<_> = record.detections.iter().map(|one| object(one, pitch_deg)).collect();
        draw_through_lens(&image, &camera, lens, &objects, RangeKind::Depth)
    });
    let divisor = picture_divisor([image.width(), image.height()]);
    Ok((PyBytes::new(py, drawn.as_raw()), [drawn.width(), drawn.height()], divisor))
}

/// Pixels as a PNG file: its bytes, or with a path the file, written whole or not at all.
#[pyfunction]
#[pyo3(signature = (pixels, size, path=None))]
pub(crate) fn png<'py>(
    py: Python<'py>,
    pixels: &[u8],
    size: [u32; 2],
    path: Option<PathBuf>,
) -> PyResult<Option<Bound<'py, PyBytes>>> {
    let image = from_bytes(pixels, size)?;
    let Some(path) = path else {
        let mut bytes = Cursor::new(Vec::new());
        let written = py.detach(|| image.write_with_encoder(PngEncoder::new(&mut bytes)));
        written.map_err(|error| PyValueError::new_err(error.to_string()))?;
        return Ok(Some(PyBytes::new(py, bytes.get_ref())));
    };
    let write = |out: &mut dyn io::Write| image.write_with_encoder(PngEncoder::new(out)).map_err(io::Error::other);
    py.detach(|| write_atomically(&path, write)).map_err(|error| PyOSError::new_err(error.to_string()))?;
    Ok(None)
}

/// An answer that was JSON.
pub(crate) fn parsed(record: &str) -> PyResult<ImageRecord> {
    serde_json::from_str(record)
        .map_err(|error| PyValueError::new_err(format!("{error}; expected the JSON of `farsight range`, one object")))
}

fn camera(record: &ImageRecord) -> PyResult<Camera> {
    let projection = record.camera.as_ref().map(|camera| camera.projection);
    let missing = || PyValueError::new_err("the answer has no camera");
    let camera = Camera::from_projection(projection.ok_or_else(missing)?);
    camera.map_err(|error| PyValueError::new_err(error.to_string()))
}

/// The detection as drawing and result files take it. Answers of this module tell depths.
pub(crate) fn detection(record: &DetectionRecord) -> Detection {
    let [x1, y1, x2, y2] = record.box2d;
    let [height, width, length] = record.dimensions_hwl;
    Detection {
        class: ObjectClass::from(record.class.clone()),
        score: record.score,
        box2d: Box2d::new(x1, y1, x2, y2),
        box3d: Box3d {
            dimensions: Dimensions { length, height, width },
            location: record.location,
            yaw: record.rotation_y,
        },
        range_sigma_m: record.range_sigma_m,
    }
}

/// Its intervals are not drawn.
fn object(record: &DetectionRecord, pitch_deg: f64) -> DetectedObject {
    let object = DetectedObject::new(detection(record), RangeKind::Depth, NORMAL_INTERVAL_SIGMAS);
    object.with_pitch(pitch_deg.to_radians())
}
