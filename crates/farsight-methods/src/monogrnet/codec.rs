//! From objects to the numbers of cells and boxes, and back.

use std::f64::consts::PI;

use farsight_core::box3d::{corners as corners_of, ray_angle};
use farsight_core::{Affine2, Box2d, Box3d, Camera, Dimensions};

use super::layout::{CELL_STRIDE, CORNER_NUMBERS};

/// Cells say how much farther than this, metres, an object is: about the mean of KITTI's cars.
pub const START_DEPTH_M: f64 = 25.0;

/// Corners lie so far at most from the centre along each axis, metres (authors').
pub const CORNER_REACH_M: f64 = 3.0;

/// Corners are moved by so much at most along each axis, metres (authors').
pub const CORNER_STEP_M: f64 = 2.0;

/// Signs of the corners along length, downwards from the centre, and along width, in the order of [`Box3d::corners`].
const SIGNS: [[f64; 3]; 8] = [
    [-1.0, -1.0, -1.0],
    [1.0, -1.0, -1.0],
    [1.0, 1.0, -1.0],
    [1.0, 1.0, 1.0],
    [1.0, -1.0, 1.0],
    [-1.0, -1.0, 1.0],
    [-1.0, 1.0, 1.0],
    [-1.0, 1.0, -1.0],
];

/// What the corners are of: metres, x right, y down, z ahead.
pub type Corners = [[f64; 3]; 8];

/// How objects become numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Codec {
    /// Focal length, pixels of the network's input, for which depths are learnt; true depths without it.
    pub depth_focal_px: Option<f64>,
}

/// The camera of the grid that belongs to the camera of the network's input.
pub fn cell_camera(input_camera: &Camera) -> Camera {
    input_camera.transformed(&Affine2::scaling(1.0 / CELL_STRIDE as f64))
}

/// Where the centre of a cell lies on the grid.
pub fn cell_center(cell: [usize; 2]) -> [f64; 2] {
    cell.map(|place| place as f64 + 0.5)
}

impl Codec {
    /// What a depth is under the camera of the network's input, as the network says it.
    pub fn virtual_depth(&self, depth_m: f64, input_camera: &Camera) -> f64 {
        depth_m / self.scale(input_camera)
    }

    /// The depth, metres, that the network means.
    pub fn depth(&self, virtual_depth_m: f64, input_camera: &Camera) -> f64 {
        virtual_depth_m * self.scale(input_camera)
    }

    /// True depth over virtual depth.
    fn scale(&self, input_camera: &Camera) -> f64 {
        self.depth_focal_px.map_or(1.0, |focal_px| input_camera.focal_y() / focal_px)
    }

    /// The centre of the 3D box that is seen at `center` (grid) at this depth.
    pub fn center(&self, center: [f64; 2], virtual_depth_m: f64, input_camera: &Camera) -> [f64; 3] {
        cell_camera(input_camera).point_from_pixel(center, self.depth(virtual_depth_m, input_camera))
    }
}

/// A 2D box (grid) as a cell says it: its centre from that of the cell, and its sides, cells.
pub fn encode_box(box2d: &Box2d, cell: [usize; 2]) -> [f64; 4] {
    let [x, y] = middle(box2d);
    let [cx, cy] = cell_center(cell);
    [x - cx, y - cy, box2d.width(), box2d.height()]
}

/// The 2D box that a cell says.
pub fn decode_box([dx, dy, width, height]: [f64; 4], cell: [usize; 2]) -> Box2d {
    let [cx, cy] = cell_center(cell);
    around([cx + dx, cy + dy], [width.max(0.0), height.max(0.0)])
}

/// What moves a box to another one: its centre in shares of its sides, the logarithms of its sides.
pub fn encode_move(from: &Box2d, to: &Box2d) -> [f64; 4] {
    let ([x, y], [u, v]) = (middle(from), middle(to));
    let [width, height] = [from.width(), from.height()];
    [(u - x) / width, (v - y) / height, (to.width() / width).ln(), (to.height() / height).ln()]
}

/// The box that it is moved to.
pub fn decode_move(from: &Box2d, [dx, dy, dw, dh]: [f64; 4]) -> Box2d {
    let [x, y] = middle(from);
    let [width, height] = [from.width(), from.height()];
    around([x + dx * width, y + dy * height], [width * dw.exp(), height * dh.exp()])
}

fn middle(box2d: &Box2d) -> [f64; 2] {
    [f64::midpoint(box2d.x1, box2d.x2), f64::midpoint(box2d.y1, box2d.y2)]
}

fn around([x, y]: [f64; 2], [width, height]: [f64; 2]) -> Box2d {
    Box2d::new(x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0)
}

/// The corners of a box as they are seen: from its centre, turned so that only the observation angle counts.
pub fn local_corners(box3d: &Box3d) -> Corners {
    let Dimensions { height, width, length } = box3d.dimensions;
    let alpha = box3d.yaw - ray_angle(box3d.location);
    corners_of([length, height, width], [0.0, height / 2.0, 0.0], alpha)
}

/// The same corners where they are, around the centre of the box.
pub fn global_corners(local: &Corners, center: [f64; 3]) -> Corners {
    let (sin, cos) = ray_angle(center).sin_cos();
    local.map(|[x, y, z]| [cos * x + sin * z + center[0], y + center[1], cos * z - sin * x + center[2]])
}

/// The depth, metres, that a cell's channel stands for.
pub fn depth_of(channel: f64) -> f64 {
    channel + START_DEPTH_M
}

/// Corners as the network says them.
pub fn corners_from(channels: &[f32; CORNER_NUMBERS], reach_m: f64) -> Corners {
    std::array::from_fn(|corner| std::array::from_fn(|axis| reach_m * f64::from(channels[3 * corner + axis]).tanh()))
}

/// The upright box that lies nearest to these corners: each side is the mean of its four edges.
pub fn box_from_corners(corners: &Corners) -> Box3d {
    let mut center = [0.0; 3];
    // Along length, down and along width, each as long as the box.
    let mut sides = [[0.0; 3]; 3];
    for (corner, signs) in corners.iter().zip(SIGNS) {
        for axis in 0..3 {
            center[axis] += corner[axis] / 8.0;
            for (side, sign) in sides.iter_mut().zip(signs) {
                side[axis] += sign * corner[axis] / 4.0;
            }
        }
    }
    let [along, down, across] = sides;
    // Both sides say how it is turned; the longer one more surely.
    let (x, z) = (along[0] + across[2], along[2] - across[0]);
    let yaw = if x == 0.0 && z == 0.0 { 0.0 } else { (-z).atan2(x) };
    let (sin, cos) = yaw.sin_cos();
    let length = (along[0] * cos - along[2] * sin).max(0.0);
    let width = (across[0] * sin + across[2] * cos).max(0.0);
    let height = down[1].max(0.0);
    let yaw = if yaw <= -PI { yaw + 2.0 * PI } else { yaw };
    Box3d {
        dimensions: Dimensions { height, width, length },
        location: [center[0], center[1] + height / 2.0, center[2]],
        yaw,
    }
}

#[cfg(test)]
mod tests {
    use farsight_core::wrapped_angle;
    use proptest::prelude::*;

    use super::*;

    fn box3d() -> impl Strategy<Value = Box3d> {
        let sizes = (0.5..4.0, 0.4..3.0, 0.4..5.0);
        let places = (-20.0..20.0, -1.0..3.0, 3.0..80.0);
        (sizes, places, -3.1..3.1).prop_map(|((height, width, length), (x, y, z), yaw)| Box3d {
            dimensions: Dimensions { height, width, length },
            location: [x, y, z],
            yaw,
        })
    }

    proptest! {
        #[test]
        fn a_box_comes_back_from_its_corners(expected in box3d()) {
            let found = box_from_corners(&expected.corners());
            let (size, truth) = (found.dimensions, expected.dimensions);
            for (a, b) in [(size.height, truth.height), (size.width, truth.width), (size.length, truth.length)] {
                prop_assert!((a - b).abs() < 1e-9, "{found:?}");
            }
            prop_assert!(found.location.iter().zip(expected.location).all(|(a, b)| (a - b).abs() < 1e-9));
            prop_assert!(wrapped_angle(found.yaw - expected.yaw).abs() < 1e-9);
        }

        #[test]
        fn local_corners_are_put_where_the_box_is(expected in box3d()) {
            let found = global_corners(&local_corners(&expected), expected.center());
            let all = found.iter().flatten().zip(expected.corners().into_iter().flatten());
            prop_assert!(all.into_iter().all(|(a, b)| (a - b).abs() < 1e-9));
        }

        #[test]
        fn boxes_of_cells_and_their_moves_come_back(
            x in 0.0..38.0, y in 0.0..11.0, width in 0.1..20.0, height in 0.1..9.0,
            dx in -1.0..1.0, dw in 0.5..2.0, column in 0..39_usize, row in 0..12_usize,
        ) {
            let first = Box2d::new(x, y, x + width, y + height);
            let second = Box2d::new(x + dx, y - dx, x + dx + dw * width, y - dx + height / dw);
            let back = [decode_box(encode_box(&first, [column, row]), [column, row]), decode_move(&second, encode_move(&second, &first))];
            for found in back {
                for (a, b) in [(found.x1, first.x1), (found.y1, first.y1), (found.x2, first.x2), (found.y2, first.y2)] {
                    prop_assert!((a - b).abs() < 1e-9, "{found:?}");
                }
            }
        }

        #[test]
        fn centers_come_back(x in -9.0..9.0, y in -1.0..2.0, z in 3.0..70.0, focal in 300.0..900.0, fourth in -50.0..50.0) {
            let mut camera = Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap();
            camera.projection[0][3] = fourth;
            let codec = Codec { depth_focal_px: Some(focal) };
            let seen = cell_camera(&camera).pixel_from_point([x, y, z]).unwrap();
            let found = codec.center(seen, codec.virtual_depth(z, &camera), &camera);
            prop_assert!(found.iter().zip([x, y, z]).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
        }
    }

    #[test]
    fn corners_without_extent_are_a_box_without_size() {
        let found = box_from_corners(&[[1.0, 2.0, 3.0]; 8]);
        assert_eq!((found.location, found.yaw), ([1.0, 2.0, 3.0], 0.0));
        assert_eq!(found.dimensions, Dimensions { height: 0.0, width: 0.0, length: 0.0 });
    }
}
