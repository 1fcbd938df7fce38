//! Upright boxes in the scene, their corners, angles and distances.

use crate::linear::{norm, solved};
use crate::scalar::Scalar;
use crate::{Affine2, Box2d, Camera, Pose, wrapped_angle};

/// Size of an object in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dimensions {
    /// Extent along the vertical, metres.
    pub height: f64,
    /// Extent across the heading, metres.
    pub width: f64,
    /// Extent along the heading, metres.
    pub length: f64,
}

/// An upright box in camera coordinates (x right, y down, z forward), KITTI's convention.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Box3d {
    /// Size, metres.
    pub dimensions: Dimensions,
    /// Centre of the **bottom** face, metres.
    pub location: [f64; 3],
    /// Turn about the y axis, radians; 0 faces +x, `-pi/2` faces away from the camera.
    pub yaw: f64,
}

/// Signs of the eight corners along length, height (1 = top) and width; the order of spec 5.5.
const CORNER_SIGNS: [[f64; 3]; 8] = [
    [-1.0, 1.0, -1.0],
    [1.0, 1.0, -1.0],
    [1.0, 0.0, -1.0],
    [1.0, 0.0, 1.0],
    [1.0, 1.0, 1.0],
    [-1.0, 1.0, 1.0],
    [-1.0, 0.0, 1.0],
    [-1.0, 0.0, -1.0],
];

/// The twelve edges as pairs of indices into [`Box3d::corners`].
pub const EDGES: [[usize; 2]; 12] =
    [[0, 1], [1, 2], [2, 7], [7, 0], [5, 4], [4, 3], [3, 6], [6, 5], [0, 5], [1, 4], [2, 3], [7, 6]];

/// Corners of the front face (the +x side of an object with yaw 0), in order around it.
pub const FRONT_FACE: [usize; 4] = [1, 2, 3, 4];

/// Points nearer than this in front of the camera are not projected, metres.
pub const NEAR_PLANE_M: f64 = 0.1;

/// Boxes with shorter sides are taken to have these where something is divided by them, metres.
const MIN_SIDE_M: f64 = 1e-3;

/// Corners of the box with these dimensions (length, height, width), bottom centre and yaw.
///
/// Generic over the scalar, so that the corner loss and the geometry are one formula.
pub fn corners<D: Scalar>(dimensions_lhw: [D; 3], location: [D; 3], yaw: D) -> [[D; 3]; 8] {
    let [length, height, width] = dimensions_lhw;
    let (sin, cos) = yaw.sin_cos();
    CORNER_SIGNS.map(|[along, up, across]| {
        let a = length * (0.5 * along);
        let b = width * (0.5 * across);
        [cos * a + sin * b + location[0], location[1] - height * up, cos * b - sin * a + location[2]]
    })
}

impl Box3d {
    /// The eight corners, metres, in the order of spec 5.5: top faces have the smaller y.
    pub fn corners(&self) -> [[f64; 3]; 8] {
        let Dimensions { height, width, length } = self.dimensions;
        corners([length, height, width], self.location, self.yaw)
    }

    /// The centre of the box, half its height above [`Box3d::location`].
    pub fn center(&self) -> [f64; 3] {
        let [x, y, z] = self.location;
        [x, y - self.dimensions.height / 2.0, z]
    }

    /// Observation angle: yaw less the angle of the ray to the object, in `(-pi, pi]`.
    pub fn alpha(&self) -> f64 {
        wrapped_angle(self.yaw - ray_angle(self.location))
    }

    /// `z` of the location, metres: of a camera that looks level its depth along the optical axis. (A [`Camera`] that
    /// looks down has its rotation in its projection, so that boxes stay upright.)
    pub fn depth_m(&self) -> f64 {
        self.location[2]
    }

    /// Distance over the ground from the camera to the location, metres.
    pub fn ground_distance_m(&self) -> f64 {
        self.location[0].hypot(self.location[2])
    }

    /// Distance from the camera to the centre of the box, metres.
    pub fn center_distance_m(&self) -> f64 {
        norm(&self.center())
    }

    /// Distance from the camera to the nearest point of the box, metres; 0 inside it.
    pub fn nearest_distance_m(&self) -> f64 {
        let [x, y, z] = self.center();
        let (sin, cos) = self.yaw.sin_cos();
        // The camera in the box's own axes; the turn is the transpose of the one in `corners`.
        let camera = [sin * z - cos * x, -y, -sin * x - cos * z];
        let half = [self.dimensions.length, self.dimensions.height, self.dimensions.width].map(|d| d / 2.0);
        norm(&[0, 1, 2].map(|axis| (camera[axis].abs() - half[axis]).max(0.0)))
    }

    /// The box around the projection, pixels, not clipped to any image; `None` when all of the box is behind the
    /// camera.
    ///
    /// Edges that cross the near plane are cut there, so a vehicle beside the camera keeps a true outline.
    pub fn projected(&self, camera: &Camera) -> Option<Box2d> {
        let corners = self.corners();
        let ahead = corners.iter().copied().filter(|c| c[2] >= NEAR_PLANE_M);
        let crossings = EDGES.iter().filter_map(|&[a, b]| near_plane_crossing(corners[a], corners[b]));
        Box2d::bounding(ahead.chain(crossings).filter_map(|point| camera.pixel_from_point(point)))
    }

    /// The box `factor` times as far away and as large: the same picture, but for the centimetres by which a fourth
    /// column moves the camera.
    pub fn scaled(&self, factor: f64) -> Self {
        let Dimensions { height, width, length } = self.dimensions;
        let dimensions = Dimensions { height: height * factor, width: width * factor, length: length * factor };
        Self { dimensions, location: self.location.map(|v| v * factor), yaw: self.yaw }
    }

    /// The box in other coordinates, into which `other_from_this` takes points; it is upright there, with the heading
    /// that it has as seen along their y axis.
    #[must_use]
    pub fn moved(&self, other_from_this: &Pose) -> Self {
        let (sin, cos) = self.yaw.sin_cos();
        let heading = other_from_this.rotation.map(|row| row[0] * cos - row[2] * sin);
        let location = other_from_this.apply(self.location);
        Self { dimensions: self.dimensions, location, yaw: (-heading[2]).atan2(heading[0]) }
    }

    /// The box of which this one is what [`Box3d::moved`] makes with `this_from_other`.
    #[must_use]
    pub fn moved_back(&self, this_from_other: &Pose) -> Self {
        let Pose { rotation: [across, _, ahead], .. } = this_from_other;
        let (sin, cos) = self.yaw.sin_cos();
        // No heading is lost unless one's y axis lies across the other's.
        let heading = solved([[across[0], across[2]], [ahead[0], ahead[2]]], [cos, -sin]).unwrap_or([cos, -sin]);
        let location = this_from_other.inverse().apply(self.location);
        Self { dimensions: self.dimensions, location, yaw: (-heading[1]).atan2(heading[0]) }
    }

    /// By so much depth, metres, the box can be moved over the ground along its ray until it overlaps the place where
    /// it was, seen from above, by no more than `overlap` (intersection over union). A car that is seen from behind can
    /// be moved farther than one that crosses.
    pub fn depth_tolerance_m(&self, overlap: f64) -> f64 {
        let Dimensions { width, length, .. } = self.dimensions;
        // Alpha is 0 for a car that crosses.
        let (along, across) = self.alpha().sin_cos();
        // Moved by t, the two share (length - t along) * (width - t across), which has to be this share of length *
        // width:
        let shared = 2.0 * overlap / (1.0 + overlap);
        let [by_length, by_width] = [along.abs() / length.max(MIN_SIDE_M), across.abs() / width.max(MIN_SIDE_M)];
        let sum = by_length + by_width;
        let root = (sum * sum - 4.0 * by_length * by_width * (1.0 - shared)).sqrt();
        let moved_m = 2.0 * (1.0 - shared) / (sum + root);
        moved_m * self.depth_m() / self.ground_distance_m().max(NEAR_PLANE_M)
    }

    /// The same box in a world mirrored left to right (`x` becomes `-x`).
    pub fn mirrored(&self) -> Self {
        let [x, y, z] = self.location;
        Self { location: [-x, y, z], yaw: wrapped_angle(std::f64::consts::PI - self.yaw), ..*self }
    }
}

impl Box2d {
    /// The box around this one after `map`.
    pub fn transformed(&self, map: &Affine2) -> Self {
        let [ax, ay] = map.apply([self.x1, self.y1]);
        let [bx, by] = map.apply([self.x2, self.y2]);
        Self::new(ax.min(bx), ay.min(by), ax.max(bx), ay.max(by))
    }
}

/// Angle of the ray from the camera to `location` on the ground plane, radians; 0 straight ahead, positive to the
/// right.
pub fn ray_angle(location: [f64; 3]) -> f64 {
    location[0].atan2(location[2])
}

/// Where the segment from `a` to `b` meets the near plane, if its ends lie on both sides of it.
pub fn near_plane_crossing(a: [f64; 3], b: [f64; 3]) -> Option<[f64; 3]> {
    let (da, db) = (a[2] - NEAR_PLANE_M, b[2] - NEAR_PLANE_M);
    if (da < 0.0) == (db < 0.0) {
        return None;
    }
    let t = da / (da - db);
    Some([0, 1, 2].map(|axis| a[axis] + t * (b[axis] - a[axis])))
}
