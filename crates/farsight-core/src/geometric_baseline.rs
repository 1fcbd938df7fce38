//! Ranging without a network: what a 2D box and a known camera give by themselves. The measure that a learnt distance
//! has to beat.

use crate::{Box2d, Camera};

/// Smallest height of a box, and smallest distance of its bottom edge from the horizon, that say anything, pixels.
const MIN_PX: f64 = 1.0;

/// Depth, metres, by similar triangles: an object `height_m` high fills the height of `box2d`.
///
/// The box shows the side that faces the camera, about half the object's length nearer than its centre: `half_length_m`
/// is added. `None` for a box lower than a pixel.
pub fn depth_from_height(box2d: &Box2d, camera: &Camera, height_m: f64, half_length_m: f64) -> Option<f64> {
    (box2d.height() >= MIN_PX).then(|| camera.focal_y() * height_m / box2d.height() + half_length_m)
}

/// Depth, metres, by inverse perspective mapping: the bottom edge of `box2d` stands on flat ground `camera_height_m`
/// below the camera, whose horizon is the row `horizon_y` of the image ([`level_horizon`], [`horizon_from_boxes`]).
///
/// The edge is where the object is nearest: `half_length_m` is added. `None` for an edge at or above the horizon.
pub fn depth_from_ground(
    box2d: &Box2d,
    camera: &Camera,
    horizon_y: f64,
    camera_height_m: f64,
    half_length_m: f64,
) -> Option<f64> {
    let below = box2d.y2 - horizon_y;
    (below >= MIN_PX).then(|| camera.focal_y() * camera_height_m / below + half_length_m)
}

/// Row of the image in which a camera that looks straight ahead has its horizon.
pub fn level_horizon(camera: &Camera) -> f64 {
    let far = camera.pixel_from_point([0.0, 0.0, HORIZON_M]);
    far.map_or_else(|| camera.principal_point()[1], |pixel| pixel[1])
}

/// Row of the image in which the horizon is if boxes stand where the height of each says: for a camera whose pitch
/// nobody knows.
///
/// Each of `objects` is a box and what [`depth_from_height`] says of where it is nearest, metres. The answer is the
/// median of the rows that they ask for, so that a box which is cut or half hidden moves it little. `None` for
/// fewer than [`MIN_BOXES`].
pub fn horizon_from_boxes(objects: &[(Box2d, f64)], camera: &Camera, camera_height_m: f64) -> Option<f64> {
    let rows = objects.iter().map(|(box2d, nearest_m)| box2d.y2 - camera.focal_y() * camera_height_m / nearest_m);
    let mut rows: Vec<f64> = rows.filter(|row| row.is_finite()).collect();
    rows.sort_by(f64::total_cmp);
    let middle = rows.len() / 2;
    (rows.len() >= MIN_BOXES)
        .then(|| if rows.len() % 2 == 1 { rows[middle] } else { f64::midpoint(rows[middle - 1], rows[middle]) })
}

/// Fewer boxes say nothing of a horizon: with one, its distance would be the one that its height says.
pub const MIN_BOXES: usize = 3;

/// Far enough to stand for the horizon, metres.
const HORIZON_M: f64 = 1e6;

#[cfg(test)]
mod tests {
    use super::{depth_from_ground, depth_from_height, horizon_from_boxes, level_horizon};
    use crate::{Box2d, Camera};

    const EXACT: f64 = 1e-3;

    #[test]
    fn both_find_a_flat_plate_where_it_stands() {
        let camera = Camera::from_intrinsics(700.0, 700.0, 610.0, 170.0).unwrap();
        for z in [5.0, 20.0, 60.0] {
            let [_, bottom] = camera.pixel_from_point([0.0, 1.65, z]).unwrap();
            let [_, top] = camera.pixel_from_point([0.0, 0.15, z]).unwrap();
            let plate = Box2d::new(600.0, top, 620.0, bottom);
            assert!((depth_from_height(&plate, &camera, 1.5, 0.0).unwrap() - z).abs() < EXACT);
            assert!((depth_from_ground(&plate, &camera, level_horizon(&camera), 1.65, 0.0).unwrap() - z).abs() < EXACT);
            assert!((depth_from_height(&plate, &camera, 1.5, 2.0).unwrap() - z - 2.0).abs() < EXACT);
        }
    }

    #[test]
    fn what_says_nothing_gives_nothing() {
        let camera = Camera::from_intrinsics(700.0, 700.0, 610.0, 170.0).unwrap();
        let above_the_horizon = Box2d::new(600.0, 100.0, 620.0, 160.0);
        assert_eq!(depth_from_ground(&above_the_horizon, &camera, level_horizon(&camera), 1.65, 0.0), None);
        let flat = Box2d::new(600.0, 200.0, 620.0, 200.0);
        assert_eq!(depth_from_height(&flat, &camera, 1.5, 0.0), None);
    }

    #[test]
    fn a_pitched_camera_finds_its_horizon_by_the_boxes_that_it_sees() {
        let camera = Camera::from_intrinsics(700.0, 700.0, 610.0, 170.0).unwrap();
        let pitched_by = 12.0;
        let plate = |z: f64| {
            let row = |y: f64| camera.pixel_from_point([0.0, y, z]).unwrap()[1] + pitched_by;
            (Box2d::new(600.0, row(0.15), 620.0, row(1.65)), z)
        };
        let mut plates: Vec<(Box2d, f64)> = [8.0, 15.0, 22.0, 40.0].map(plate).to_vec();
        // One is hidden to its middle, so both of its rows are wrong.
        plates.push((Box2d { y2: 200.0, ..plates[1].0 }, 15.0));
        let horizon = horizon_from_boxes(&plates, &camera, 1.65).unwrap();
        assert!((horizon - level_horizon(&camera) - pitched_by).abs() < EXACT, "{horizon}");
        for (plate, z) in &plates[..4] {
            assert!((depth_from_ground(plate, &camera, horizon, 1.65, 0.0).unwrap() - z).abs() < EXACT);
        }
        assert_eq!(horizon_from_boxes(&plates[..2], &camera, 1.65), None);
    }
}
