//! The camera of a scene, and what it can see.

use farsight_core::Camera;
use farsight_core::linear::solved;

use super::config::CameraRanges;
use crate::rng::SceneRng;
use crate::sensor::Device;

/// A camera in place.
#[derive(Debug, Clone)]
pub(crate) struct View {
    pub(crate) camera: Camera,
    pub(crate) image_size: [usize; 2],
    /// Above the ground, metres.
    pub(crate) height_m: f64,
    /// Sideways from where a driver would be, metres.
    pub(crate) lateral_m: f64,
    /// To the right of the road's way, radians, from -pi to pi.
    pub(crate) heading_rad: f64,
    pub(crate) device: Device,
    /// The bonnet of its own car is where it would be.
    pub(crate) has_bonnet: bool,
    /// How far the camera goes along its road, metres.
    pub(crate) travel_m: f64,
    /// Tangents of the angles to the image's left and right edge.
    sides: [f64; 2],
}

impl View {
    pub(crate) fn sample(ranges: &[CameraRanges], rng: &mut SceneRng) -> Self {
        let table: Vec<(usize, f64)> = ranges.iter().map(|r| r.share).enumerate().collect();
        let ranges = &ranges[rng.weighted(&table)];
        let image_size = rng.pick(&ranges.image_sizes);
        let [width, height] = image_size.map(|side| side as f64);
        let focal = width * rng.log_range(ranges.focal_widths[0], ranges.focal_widths[1]);
        let center_x = width * (ranges.center[0] + rng.symmetric(ranges.center_reach));
        let center_y = height * (ranges.center[1] + rng.symmetric(ranges.center_reach));
        let pitch = rng.range(ranges.pitch_deg[0], ranges.pitch_deg[1]).to_radians();
        let roll = rng.symmetric(ranges.roll_deg).to_radians();
        let offset = [rng.symmetric(ranges.offset_m), rng.symmetric(ranges.offset_m) * 0.05, 0.0];
        let intrinsics = [[focal, 0.0, center_x], [0.0, focal, center_y], [0.0, 0.0, 1.0]];
        let turned = product(&intrinsics, &turn(pitch, roll));
        let projection = turned.map(|row| {
            let fourth = (0..3).map(|i| row[i] * offset[i]).sum();
            [row[0], row[1], row[2], fourth]
        });
        let height_m = rng.range(ranges.height_m[0], ranges.height_m[1]);
        let lateral_m = rng.symmetric(ranges.lateral_m);
        let [least, most] = ranges.heading_deg;
        let turned = least != 0.0 || most != 0.0;
        let heading = if turned { rng.range(least, most) } else { 0.0 };
        Self {
            heading_rad: farsight_core::wrapped_angle(heading.to_radians()),
            device: ranges.device,
            has_bonnet: ranges.bonnet > 0.0 && rng.chance(ranges.bonnet),
            ..Self::new(Camera { projection }, image_size, height_m, lateral_m)
        }
    }

    pub(crate) fn new(camera: Camera, image_size: [usize; 2], height_m: f64, lateral_m: f64) -> Self {
        let [width, height] = image_size.map(|side| side as f64);
        let edge = |u: f64| {
            let [x, _, z] = camera.point_from_pixel([u, height / 2.0], 1.0);
            x / z
        };
        Self {
            camera,
            image_size,
            height_m,
            lateral_m,
            heading_rad: 0.0,
            device: Device::Any,
            has_bonnet: false,
            travel_m: 0.0,
            sides: [edge(0.0), edge(width)],
        }
    }

    /// The same view, counting as seen all that any row of the image shows, not only the middle one: cameras that look
    /// down see more at their feet.
    pub(crate) fn widened(mut self) -> Self {
        /// Rays flatter to the image's plane than this see sideways without end, metres along it a metre ahead.
        const WIDEST: f64 = 12.0;
        let [width, height] = self.image_size.map(|side| side as f64);
        let edge = |u: f64, v: f64, side: f64| {
            // Two points of the ray tell its direction.
            let [a, b] = [1.0, 2.0].map(|depth| self.ray_point([u, v], depth));
            let [across, ahead] = [b[0] - a[0], b[2] - a[2]];
            if ahead > across.abs() / WIDEST { across / ahead } else { side * WIDEST }
        };
        let rows = [0.0, height / 2.0, height];
        let left = rows.map(|v| edge(-0.5, v, -1.0)).into_iter().fold(f64::INFINITY, f64::min);
        let right = rows.map(|v| edge(width - 0.5, v, 1.0)).into_iter().fold(f64::NEG_INFINITY, f64::max);
        self.sides = [left, right];
        self
    }

    /// The same view, counting as seen all that a camera sees which goes so far along its road.
    pub(crate) fn travelling(self, travel_m: f64) -> Self {
        /// Metres sideways for each metre ahead: roads bend.
        const WIDEST: f64 = 12.0;
        Self { travel_m, sides: [-WIDEST, WIDEST], ..self }
    }

    /// A point of a pixel's ray, `depth` metres along the camera's axis.
    fn ray_point(&self, [u, v]: [f64; 2], depth: f64) -> [f64; 3] {
        let rows = self.camera.projection;
        let matrix = [0, 1, 2].map(|i| [rows[i][0], rows[i][1], rows[i][2]]);
        let right = [u * depth - rows[0][3], v * depth - rows[1][3], depth - rows[2][3]];
        solved(matrix, right).unwrap_or([0.0, 0.0, depth])
    }

    /// The view of a world in which left and right have changed places.
    pub(crate) fn mirrored(self) -> Self {
        let [left, right] = self.sides;
        Self {
            camera: self.camera.mirrored(self.image_size[0]),
            lateral_m: -self.lateral_m,
            heading_rad: -self.heading_rad,
            sides: [-right, -left],
            ..self
        }
    }

    /// Whether the camera is on a mast instead of a vehicle.
    pub(crate) fn is_on_mast(&self) -> bool {
        self.height_m > 3.4
    }

    /// Whether it looks against the way that its lane goes.
    pub(crate) fn looks_back(&self) -> bool {
        self.heading_rad.abs() > std::f64::consts::FRAC_PI_2
    }

    /// The direction of the road where it leads away from the camera, radians to the right of its axis.
    pub(crate) fn road_turn(&self) -> f64 {
        let back = if self.looks_back() { std::f64::consts::PI } else { 0.0 };
        farsight_core::wrapped_angle(back - self.heading_rad)
    }

    pub(crate) fn focal_px(&self) -> f64 {
        self.camera.focal_x()
    }

    /// Whether anything within `radius` of a point on the ground may be seen.
    pub(crate) fn sees(&self, [x, z]: [f64; 2], radius: f64) -> bool {
        let beyond = |tangent: f64, side: f64| {
            // Distance of the point from the plane through the image's edge.
            side * (x - tangent * z) / (1.0 + tangent * tangent).sqrt()
        };
        z > -radius && beyond(self.sides[0], -1.0) < radius && beyond(self.sides[1], 1.0) < radius
    }
}

/// A camera turned by a pitch downwards and a roll, radians, beside those that its projection has already.
pub(crate) fn tilted(camera: &Camera, pitch: f64, roll: f64) -> Camera {
    let rows = camera.projection.map(|row| [row[0], row[1], row[2]]);
    let dot = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let [first, second, axis] = rows;
    let (cx, cy) = (dot(&first, &axis), dot(&second, &axis));
    let focal = |row: &[f64; 3], center: f64| {
        let along = [0, 1, 2].map(|i| row[i] - center * axis[i]);
        dot(&along, &along).sqrt()
    };
    let (fx, fy) = (focal(&first, cx), focal(&second, cy));
    let intrinsics = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]];
    let inverse = [[1.0 / fx, 0.0, -cx / fx], [0.0, 1.0 / fy, -cy / fy], [0.0, 0.0, 1.0]];
    let change = product(&product(&intrinsics, &turn(pitch, roll)), &inverse);
    let projection =
        change.map(|row| [0, 1, 2, 3].map(|j| (0..3).map(|i| row[i] * camera.projection[i][j]).sum::<f64>()));
    Camera { projection }
}

/// Rotation from the level frame into the camera's: pitch downwards, then roll.
pub(crate) fn turn(pitch: f64, roll: f64) -> [[f64; 3]; 3] {
    let (sp, cp, sr, cr) = (libm::sin(pitch), libm::cos(pitch), libm::sin(roll), libm::cos(roll));
    let pitched = [[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]];
    let rolled = [[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]];
    product(&rolled, &pitched)
}

fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    a.map(|row| [0, 1, 2].map(|j| (0..3).map(|i| row[i] * b[i][j]).sum()))
}
