//! Where to take samples: in a box, on a face.

use crate::linear::solved;
use crate::{Box2d, Camera};

/// The centres of `width` x `height` equal cells in a box, row by row.
///
/// Sampled there, a map is cropped and resized; the box around a whole map with as many cells gives the map itself.
pub fn grid_in_box(area: &Box2d, [width, height]: [usize; 2]) -> Vec<[f64; 2]> {
    let at = |low: f64, high: f64, place: usize, count: usize| low + (high - low) * (place as f64 + 0.5) / count as f64;
    let row = |y: usize| (0..width).map(move |x| [at(area.x1, area.x2, x, width), at(area.y1, area.y2, y, height)]);
    (0..height).flat_map(row).collect()
}

/// The centres of `width` x `height` cells on a flat face that is seen in perspective, row by row; `corners` are the
/// pixels of its upper left, upper right, lower right and lower left corner.
///
/// Cells are equal on a square that the camera sees as this quadrilateral (a homography). `None` when no square looks
/// like that. Corners of a box are pixels by [`Camera::pixel_from_point`].
pub fn grid_on_face(corners: [[f64; 2]; 4], [width, height]: [usize; 2]) -> Option<Vec<[f64; 2]>> {
    let homography = homography_from_square(corners)?;
    let point = |x: usize, y: usize| {
        let (u, v) = ((x as f64 + 0.5) / width as f64, (y as f64 + 0.5) / height as f64);
        let [p, q, r] = homography.map(|[a, b, c]| a * u + b * v + c);
        [p / r, q / r]
    };
    Some((0..height).flat_map(|y| (0..width).map(move |x| point(x, y))).collect())
}

/// The homography that takes the corners of the unit square (0, 0), (1, 0), (1, 1), (0, 1) to `corners`.
fn homography_from_square(corners: [[f64; 2]; 4]) -> Option<[[f64; 3]; 3]> {
    const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let equation = |k: usize| {
        let ([u, v], [x, y]) = (SQUARE[k / 2], corners[k / 2]);
        let at = [x, y][k % 2];
        let left = if k.is_multiple_of(2) { [u, v, 1.0, 0.0, 0.0, 0.0] } else { [0.0, 0.0, 0.0, u, v, 1.0] };
        let [a, b, c, d, e, f] = left;
        ([a, b, c, d, e, f, -u * at, -v * at], at)
    };
    let equations: [([f64; 8], f64); 8] = std::array::from_fn(equation);
    let [a, b, c, d, e, f, g, h] = solved(equations.map(|(left, _)| left), equations.map(|(_, right)| right))?;
    // The square lies wholly before the camera.
    let is_before = SQUARE.iter().all(|[u, v]| g * u + h * v + 1.0 > 0.0);
    let homography = [[a, b, c], [d, e, f], [g, h, 1.0]];
    (is_before && homography.as_flattened().iter().all(|value| value.is_finite())).then_some(homography)
}

/// Where a flat face is seen: the pixels of its corners, as [`grid_on_face`] takes them; `None` when one of them is not
/// before the camera. `camera` is that of the map, not of the image.
pub fn face_corners(camera: &Camera, face: [[f64; 3]; 4]) -> Option<[[f64; 2]; 4]> {
    let mut corners = [[0.0; 2]; 4];
    for (corner, point) in corners.iter_mut().zip(face) {
        *corner = camera.pixel_from_point(point)?;
    }
    Some(corners)
}
