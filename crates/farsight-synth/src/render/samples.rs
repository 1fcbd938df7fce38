//! The samples of a pixel.

/// Samples a pixel.
pub(crate) const SAMPLES: usize = 4;

/// Where they lie, relative to the pixel's centre: a rotated grid, which smooths nearly level and nearly upright edges
/// best.
pub(crate) const OFFSETS: [[f32; 2]; SAMPLES] = [[-0.125, -0.375], [0.375, -0.125], [-0.375, 0.125], [0.125, 0.375]];
