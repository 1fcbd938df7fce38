//! The JSON that `range` writes: an array with one object for each image that was done, in the order of the input.

use std::path::Path;

use anyhow::Result;
use farsight_core::{Box3d, Detection};
use farsight_files::write_atomically;
use serde::Serialize;

/// One image.
#[derive(Debug, Serialize)]
pub(crate) struct ImageJson {
    /// The path; what of it is no text is replaced, as JSON has no other way.
    image: String,
    width: u32,
    height: u32,
    detections: Vec<DetectionJson>,
}

/// One detection; pixels, metres, radians.
#[derive(Debug, Serialize)]
struct DetectionJson {
    class: String,
    score: f64,
    box2d: [f64; 4],
    dimensions_hwl: [f64; 3],
    /// Bottom centre in rectified camera coordinates.
    location: [f64; 3],
    rotation_y: f64,
    alpha: f64,
    range_m: f64,
    /// Standard deviation of `range_m`.
    range_sigma_m: Option<f64>,
}

impl ImageJson {
    pub(crate) fn new(
        image: &Path,
        (width, height): (u32, u32),
        detections: &[Detection],
        range_m: fn(&Box3d) -> f64,
    ) -> Self {
        let detections = detections.iter().map(|detection| DetectionJson::new(detection, range_m)).collect();
        Self { image: image.to_string_lossy().into_owned(), width, height, detections }
    }
}

impl DetectionJson {
    fn new(detection: &Detection, range_m: fn(&Box3d) -> f64) -> Self {
        let Detection { class, score, box2d, box3d, range_sigma_m: _ } = detection;
        let range_m = range_m(box3d);
        let size = box3d.dimensions;
        Self {
            class: class.to_string(),
            score: *score,
            box2d: [box2d.x1, box2d.y1, box2d.x2, box2d.y2],
            dimensions_hwl: [size.height, size.width, size.length],
            location: box3d.location,
            rotation_y: box3d.yaw,
            alpha: detection.alpha(),
            range_m,
            range_sigma_m: detection.sigma_of_m(range_m),
        }
    }
}

/// Writes `images` to `path`, whole or not at all.
pub(crate) fn write(path: &Path, images: &[ImageJson]) -> Result<()> {
    Ok(write_atomically(path, |out| {
        serde_json::to_writer_pretty(&mut *out, images)?;
        out.write_all(b"\n")
    })?)
}
