//! Rolling exposure: each row of the picture is exposed at its own time.
//!
//! A point is seen by the row in which it lies, at that row's time, so it is drawn where it is then. All moves evenly
//! within a picture: the camera's car with its velocity, yaw rate and nodding, the others with their velocities.
//! Between the corners of a triangle times are interpolated, as places are; a camera that turns or nods shears and
//! stretches the picture by a linear map, under which that is exact.

use farsight_core::Camera;
use farsight_core::linear::solved;

use crate::generator::view::tilted;
use crate::scene::Vec3;

/// The row of a point follows from its time, and its time from its row: so often one after the other.
const ROUNDS: usize = 4;

/// Points beside the picture, or behind the camera, are no farther from the middle row's time than this, in readout
/// times.
const MOST: f64 = 1.5;

/// Nearer than this, metres, rows are no good.
const NEAR_M: f64 = 0.2;

/// What the rows of one picture see.
pub(super) struct Readout {
    /// From the first row to the last one, seconds.
    duration_s: f64,
    middle_row: f64,
    rows: f64,
    projection: [[f64; 4]; 3],
    /// Its change in a second.
    change: [[f64; 4]; 3],
    /// Inverse of its left part.
    inverse: [[f64; 3]; 3],
    /// To the left, rad/s.
    yaw_rate: f64,
}

impl Readout {
    /// Of a camera (as at the middle row) that yaws, pitches downwards and rolls, rad/s; none where all rows are
    /// exposed at once.
    pub(super) fn new(
        camera: &Camera,
        height: usize,
        readout_s: f64,
        [yaw_rate, pitch_rate, roll_rate]: [f64; 3],
    ) -> Option<Self> {
        /// So long differences are taken over, seconds.
        const INSTANT_S: f64 = 1e-3;
        if readout_s <= 0.0 || height < 2 {
            return None;
        }
        let later = tilted(camera, pitch_rate * INSTANT_S, roll_rate * INSTANT_S).projection;
        // So that a camera that does not turn does not change at all.
        let now = tilted(camera, 0.0, 0.0).projection;
        let change = [0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| (later[i][j] - now[i][j]) / INSTANT_S));
        let projection = camera.projection;
        let matrix = projection.map(|row| [row[0], row[1], row[2]]);
        let column = |j: usize| solved(matrix, [0, 1, 2].map(|i| if i == j { 1.0 } else { 0.0 }));
        let columns = [column(0)?, column(1)?, column(2)?];
        let inverse = [0, 1, 2].map(|i| [0, 1, 2].map(|j| columns[j][i]));
        let rows = (height - 1) as f64;
        Some(Self { duration_s: readout_s, middle_row: rows / 2.0, rows, projection, change, inverse, yaw_rate })
    }

    /// Where a point of the camera's level axes is to be drawn that is at `position` at the middle row's time and moves
    /// with `drift`, m/s, beside what the camera's turning does.
    pub(super) fn moved(&self, position: Vec3, drift: [f64; 3]) -> Vec3 {
        let start = position.map(f64::from);
        let [x, _, z] = start;
        let motion = [drift[0] + self.yaw_rate * z, drift[1], drift[2] - self.yaw_rate * x];
        let seen = |time_s: f64| {
            let [x, y, z] = [0, 1, 2].map(|axis| start[axis] + time_s * motion[axis]);
            [0, 1, 2].map(|i| {
                let row = |j: usize| self.projection[i][j] + time_s * self.change[i][j];
                row(0) * x + row(1) * y + row(2) * z + row(3)
            })
        };
        let at_middle = seen(0.0);
        let mut homogeneous = at_middle;
        for _ in 0..ROUNDS {
            homogeneous = seen(self.time_s(homogeneous));
        }
        // A difference, so that what does not move stays to the bit.
        let off = [0, 1, 2].map(|i| homogeneous[i] - at_middle[i]);
        let change = self.inverse.map(|row| row[0] * off[0] + row[1] * off[1] + row[2] * off[2]);
        [0, 1, 2].map(|axis| (start[axis] + change[axis]) as f32)
    }

    /// The time of the row that sees a homogeneous pixel, against the middle row.
    fn time_s(&self, [_, v, w]: [f64; 3]) -> f64 {
        let below = v - self.middle_row * w;
        let share = if w > NEAR_M { below / (w * self.rows) } else { below.signum() * MOST };
        self.duration_s * share.clamp(-MOST, MOST)
    }
}
