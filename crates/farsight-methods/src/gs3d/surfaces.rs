//! Where the first network's map is read for an object: its 2D box, and the three faces of its cuboid that are seen.

use farsight_core::samplers::{FeatureMap, face_corners, grid_in_box, grid_on_face, grid_sample};
use farsight_core::{Box2d, Box3d, Camera, Dimensions};

/// Samples along each side of a surface (the paper's 5).
pub const SIDE: usize = 5;

/// Samples of a surface.
pub const SAMPLES: usize = SIDE * SIDE;

/// The 2D box, the top, the front or the back, the left or the right.
pub const SURFACES: usize = 4;

/// A face by its corners, camera coordinates, metres: once around.
type Face = [[f64; 3]; 4];

/// Points of a map to be read for an object, surface by surface: pixels of the map that `camera` sees, in which `box2d`
/// is. Points of a face that is not seen, or not wholly before the camera, are no numbers: what is read there is zero.
pub fn points(box2d: &Box2d, cuboid: &Box3d, camera: &Camera) -> Vec<[f64; 2]> {
    let mut points = grid_in_box(box2d, [SIDE, SIDE]);
    for face in faces(cuboid) {
        let corners = face.and_then(|face| face_corners(camera, face));
        let seen = corners.and_then(|corners| grid_on_face(corners, [SIDE, SIDE]));
        points.extend(seen.unwrap_or_else(|| nothing(SAMPLES)));
    }
    points
}

/// So many points that lie nowhere.
pub fn nothing(count: usize) -> Vec<[f64; 2]> {
    vec![[f64::NAN; 2]; count]
}

/// The top; of front and back, and of both sides, the one that looks towards the camera. None where that is none: the
/// camera sees no top that is above it, and no end of what it stands beside.
fn faces(cuboid: &Box3d) -> [Option<Face>; SURFACES - 1] {
    let (sin, cos) = cuboid.yaw.sin_cos();
    let Dimensions { height, width, length } = cuboid.dimensions;
    let (along, across) = ([cos, -sin], [sin, cos]);
    let [x, y, z] = cuboid.location;
    // Shares of half the length, of half the width and of the height.
    let point = |l: f64, w: f64, h: f64| {
        let [dx, dz] = [0, 1].map(|axis| along[axis] * l * length / 2.0 + across[axis] * w * width / 2.0);
        [x + dx, y - h * height, z + dz]
    };
    // A face looks towards the camera where the camera lies beyond it.
    let towards = |[nx, nz]: [f64; 2], half: f64| {
        let off = nx * x + nz * z;
        (off.abs() > half).then(|| -off.signum())
    };
    let top = [point(1.0, -1.0, 1.0), point(1.0, 1.0, 1.0), point(-1.0, 1.0, 1.0), point(-1.0, -1.0, 1.0)];
    let end = |l: f64| [point(l, -1.0, 1.0), point(l, 1.0, 1.0), point(l, 1.0, 0.0), point(l, -1.0, 0.0)];
    let side = |w: f64| [point(-1.0, w, 1.0), point(1.0, w, 1.0), point(1.0, w, 0.0), point(-1.0, w, 0.0)];
    [(y > height).then_some(top), towards(along, length / 2.0).map(end), towards(across, width / 2.0).map(side)]
}

/// Samples of `map` at the [`points`] of several objects: `[objects, surfaces channels, side, side]`.
pub fn sample(map: FeatureMap<'_>, points: &[Vec<[f64; 2]>]) -> Vec<f32> {
    let [channels, ..] = map.shape();
    let mut features = Vec::with_capacity(points.len() * SURFACES * SAMPLES * channels);
    for points in points {
        let samples = grid_sample(map, points);
        for surface in 0..SURFACES {
            for channel in samples.chunks_exact(SURFACES * SAMPLES) {
                features.extend_from_slice(&channel[surface * SAMPLES..(surface + 1) * SAMPLES]);
            }
        }
    }
    features
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_are_those_that_the_camera_sees() {
        let dimensions = Dimensions { height: 1.5, width: 1.6, length: 4.0 };
        for turn in 0..16 {
            let cuboid = Box3d { dimensions, location: [-2.0, 1.7, 15.0], yaw: f64::from(turn) * 0.4 - 3.1 };
            let corners = cuboid.corners();
            let is_corner =
                |p: &[f64; 3]| corners.iter().any(|corner| corner.iter().zip(p).all(|(a, b)| (a - b).abs() < 1e-9));
            let [top, end, side] = faces(&cuboid);
            for face in [top, end, side].into_iter().flatten() {
                assert!(face.iter().all(is_corner), "{face:?}");
            }
            assert!(top.unwrap().iter().all(|[_, y, _]| (y - 0.2).abs() < 1e-9));
            // From outside at least one of the four upright faces is seen, and none from behind.
            assert!(end.is_some() || side.is_some());
            let middle = |face: &Face, axis: usize| face.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0;
            for face in [end, side].into_iter().flatten() {
                let [dx, dz] = [middle(&face, 0) - cuboid.location[0], middle(&face, 2) - cuboid.location[2]];
                assert!(dx * middle(&face, 0) + dz * middle(&face, 2) < 0.0, "{face:?} looks away");
            }
        }
    }

    #[test]
    fn what_is_not_seen_is_left_out() {
        let dimensions = Dimensions { height: 1.5, width: 1.6, length: 4.0 };
        // It stands across, straight ahead: no end of it is seen, and one side.
        let across = Box3d { dimensions, location: [0.0, 1.7, 15.0], yaw: 0.0 };
        assert!(matches!(faces(&across), [Some(_), None, Some(_)]), "{:?}", faces(&across));
        // It drives ahead: its end and neither side.
        let ahead = Box3d { yaw: -std::f64::consts::FRAC_PI_2, ..across };
        assert!(matches!(faces(&ahead), [Some(_), Some(_), None]), "{:?}", faces(&ahead));
        // Higher than the camera: no top.
        let high = Box3d { dimensions: Dimensions { height: 3.0, ..dimensions }, ..across };
        assert!(faces(&high)[0].is_none());
    }

    #[test]
    fn samples_come_by_object_surface_and_channel() {
        let (channels, height, width) = (2, 12, 40);
        let value = |k: usize| (k % width) as f32 + 100.0 * (k / width % height) as f32;
        let plane: Vec<f32> = (0..height * width).map(value).collect();
        let values = [plane.clone(), plane.iter().map(|value| -value).collect()].concat();
        let map = FeatureMap::new(&values, [channels, height, width]).unwrap();
        let camera = Camera::from_hfov(80.0, width, height).unwrap();
        let dimensions = Dimensions { height: 1.5, width: 1.6, length: 4.0 };
        let cuboid = Box3d { dimensions, location: [1.0, 1.7, 9.0], yaw: 0.7 };
        let box2d = Box2d::new(10.0, 3.0, 30.0, 9.0);
        let points = [points(&box2d, &cuboid, &camera), nothing(SURFACES * SAMPLES)];
        let found = sample(map, &points);
        assert_eq!(found.len(), 2 * SURFACES * channels * SAMPLES);
        for (k, [x, y]) in points[0].iter().enumerate() {
            let (surface, place) = (k / SAMPLES, k % SAMPLES);
            for (channel, sign) in [(0, 1.0), (1, -1.0)] {
                let expected = sign * (x + 100.0 * y);
                let found = f64::from(found[(surface * channels + channel) * SAMPLES + place]);
                assert!((found - expected).abs() < 1e-2, "{k}: {found}, not {expected}");
            }
        }
        assert!(found[SURFACES * channels * SAMPLES..].iter().all(|value| *value == 0.0));
    }

    #[test]
    fn faces_behind_the_camera_are_not_read() {
        let camera = Camera::from_hfov(80.0, 40, 12).unwrap();
        let dimensions = Dimensions { height: 1.5, width: 1.6, length: 4.0 };
        let near = Box3d { dimensions, location: [0.0, 1.6, 1.0], yaw: 1.57 };
        let points = points(&Box2d::new(0.0, 0.0, 39.0, 11.0), &near, &camera);
        assert!(points[..SAMPLES].iter().flatten().all(|value| value.is_finite()));
        assert!(points[SAMPLES..2 * SAMPLES].iter().flatten().all(|value| value.is_nan()));
    }
}
