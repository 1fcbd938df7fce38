//! Rendered scenes.

use farsight_core::Label;
use farsight_synth::{SceneConfig, SceneStream};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// Pixels; width and height; projection; labels.
type Rendered<'py> = (Bound<'py, PyBytes>, [u32; 2], [[f64; 4]; 3], Vec<LabelRow>);

/// Class, truncation, occlusion, box in the image, box in space as in `Result.boxes3d`.
type LabelRow = (String, f64, i32, [f64; 4], [f64; 7]);

/// Scene number `index` of the seed, as `farsight synth` renders it.
#[pyfunction]
pub(crate) fn render(py: Python<'_>, index: u64, seed: u64) -> Rendered<'_> {
    let frame = py.detach(|| SceneStream { config: SceneConfig::default(), seed }.frame(index));
    let size = [frame.image.width(), frame.image.height()];
    let labels = frame.labels.iter().map(row).collect();
    (PyBytes::new(py, frame.image.as_raw()), size, frame.camera.projection, labels)
}

fn row(label: &Label) -> LabelRow {
    let Label { class, truncation, occlusion, box2d, box3d, .. } = label;
    let ([x, y, z], size) = (box3d.location, box3d.dimensions);
    (
        class.to_string(),
        *truncation,
        *occlusion,
        [box2d.x1, box2d.y1, box2d.x2, box2d.y2],
        [x, y, z, size.length, size.height, size.width, box3d.yaw],
    )
}
