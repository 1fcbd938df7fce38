//! The sizes of KITTI's images.

use farsight_core::Camera;

/// Horizontal focal length of each of KITTI's four cameras, pixels, and the size of its rectified images (width,
/// height).
const SIZES: [(f64, [usize; 2]); 4] =
    [(721.5377, [1242, 375]), (707.0493, [1224, 370]), (718.3351, [1238, 374]), (718.856, [1241, 376])];

/// Two focal lengths this close are the same camera, pixels.
const SAME_FOCAL_PX: f64 = 1e-3;

/// Width and height, pixels, of the images that `camera` takes: for label and calibration files without their images.
///
/// A camera that is not KITTI's is taken to have its principal point in the middle.
pub fn image_size(camera: &Camera) -> [usize; 2] {
    let known = SIZES.iter().find(|(focal, _)| (camera.focal_x() - focal).abs() < SAME_FOCAL_PX);
    known.map_or_else(|| around_principal_point(camera), |&(_, size)| size)
}

fn around_principal_point(camera: &Camera) -> [usize; 2] {
    let [first, second, third] = camera.projection;
    [first, second].map(|row| ((2.0 * row[2] / third[2]).round().max(1.0) as usize).saturating_add(1))
}

#[cfg(test)]
mod tests {
    use farsight_core::Camera;

    use super::image_size;

    #[test]
    fn sizes() {
        let table = [
            ("KITTI's most frequent camera", (721.5377, 609.5593, 172.854), [1242, 375]),
            ("another of KITTI's", (718.856, 607.1928, 185.2157), [1241, 376]),
            ("full HD", (1000.0, 959.5, 539.5), [1920, 1080]),
            ("out of this world", (1e10, 1e30, 539.5), [usize::MAX, 1080]),
        ];
        for (name, (focal, cx, cy), expected) in table {
            let camera = Camera::from_intrinsics(focal, focal, cx, cy).unwrap();
            assert_eq!(image_size(&camera), expected, "{name}");
        }
    }
}
