//! The camera of a scene, and what it can see.

use farsight_core::Camera;

use super::config::CameraRanges;
use crate::rng::SceneRng;

/// A camera in place.
#[derive(Debug, Clone)]
pub(crate) struct View {
    pub(crate) camera: Camera,
    pub(crate) image_size: [usize; 2],
    /// Above the ground, metres.
    pub(crate) height_m: f64,
    /// Sideways from where a driver would be, metres.
    pub(crate) lateral_m: f64,
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
        Self::new(Camera { projection }, image_size, height_m, lateral_m)
    }

    pub(crate) fn new(camera: Camera, image_size: [usize; 2], height_m: f64, lateral_m: f64) -> Self {
        let [width, height] = image_size.map(|side| side as f64);
        let edge = |u: f64| {
            let [x, _, z] = camera.point_from_pixel([u, height / 2.0], 1.0);
            x / z
        };
        Self { camera, image_size, height_m, lateral_m, sides: [edge(0.0), edge(width)] }
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

/// Rotation from the level frame into the camera's: pitch downwards, then roll.
fn turn(pitch: f64, roll: f64) -> [[f64; 3]; 3] {
    let (sp, cp, sr, cr) = (libm::sin(pitch), libm::cos(pitch), libm::sin(roll), libm::cos(roll));
    let pitched = [[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]];
    let rolled = [[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]];
    product(&rolled, &pitched)
}

fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    a.map(|row| [0, 1, 2].map(|j| (0..3).map(|i| row[i] * b[i][j]).sum()))
}
