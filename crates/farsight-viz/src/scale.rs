//! How large lines and text are in an image of a given size.

/// Length of the longer side, pixels, at which lines and text have their nominal size: KITTI's width.
const NOMINAL_SIDE_PX: f64 = 1242.0;

/// Least factor on lines and text; below it nobody can read them.
const MIN_SCALE: f64 = 0.75;

/// Factor on lines and text for an image of this width and height, pixels.
pub(crate) fn drawing_scale(image_size: [u32; 2]) -> f64 {
    let [width, height] = image_size.map(f64::from);
    (width.max(height) / NOMINAL_SIDE_PX).max(MIN_SCALE)
}
