//! Reading feature maps between their cells: bilinear samples at points, mean values over boxes.
//!
//! This is what stands between two graphs of a detector with two stages: `RoIAlign`, crop-and-resize and the faces of a
//! 3D box take samples at points ([`grid_sample`]), an orthographic feature transform takes means over boxes
//! ([`IntegralImage`]). Training has the same functions on tensors (`farsight_train::samplers`).
//!
//! Maps are `[channels, height, width]`, row by row. Coordinates are pixels of the map with the centres of its cells at
//! whole numbers, so cell 0 reaches from -0.5 to 0.5, and a box around all of a map reaches from -0.5 to `width` - 0.5.
//! PyTorch calls this `align_corners=False`: the pixel coordinate `x` is `(2 x + 1) / width - 1` in its `grid_sample`.
//! Outside, a map is zero (`padding_mode="zeros"`).

mod bilinear;
mod feature_map;
mod grids;
mod integral;
#[cfg(test)]
mod tests;

pub use bilinear::{grid_sample, roi_align};
pub use feature_map::FeatureMap;
pub use grids::{face_corners, grid_in_box, grid_on_face};
pub use integral::IntegralImage;
