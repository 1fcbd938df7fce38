//! A world for tests: a textured road, a far wall, posts beside the road, and a car-like box that moves; seen by a
//! camera whose motion is exact.

use farsight_core::{Box2d, Camera};

pub(crate) const SIZE: [usize; 2] = [640, 200];
pub(crate) const HEIGHT_M: f64 = 1.6;
const FOCAL: f64 = 380.0;
const HORIZON: f64 = 85.0;
const WALL_M: f64 = 90.0;

/// Where the camera is, on the ground: x, z, the angle to the left of z, and a nod downwards, metres and radians.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Pose {
    pub(crate) x: f64,
    pub(crate) z: f64,
    pub(crate) yaw: f64,
    pub(crate) pitch: f64,
}

/// A flat thing that faces the camera's way: x from and to, height, z; metres.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Board {
    pub(crate) x: [f64; 2],
    pub(crate) height_m: f64,
    pub(crate) z: f64,
    pub(crate) seed: u32,
}

pub(crate) fn camera() -> Camera {
    Camera::from_intrinsics(FOCAL, FOCAL, 0.5 * (SIZE[0] as f64 - 1.0), HORIZON).unwrap()
}

fn hash(x: i64, y: i64, seed: u32) -> f64 {
    let mut h = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    h = (h ^ u64::from(seed)).wrapping_mul(0xD6E8_FEB8_6659_FD93);
    h ^= h >> 32;
    h = h.wrapping_mul(0xD6E8_FEB8_6659_FD93);
    (h >> 40) as f64 / (1_u64 << 24) as f64
}

/// Smooth noise from 0 to 1.
fn smooth(x: f64, y: f64, seed: u32) -> f64 {
    let (x0, y0) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * (3.0 - 2.0 * t);
    let (fx, fy) = (ease(x - x0), ease(y - y0));
    let at = |dx: i64, dy: i64| hash(x0 as i64 + dx, y0 as i64 + dy, seed);
    let (top, bottom) = (at(0, 0) + fx * (at(1, 0) - at(0, 0)), at(0, 1) + fx * (at(1, 1) - at(0, 1)));
    top + fy * (bottom - top)
}

/// Texture of all sizes down to what a pixel can show, `footprint_m` large.
fn texture(x: f64, y: f64, footprint_m: f64, seed: u32) -> f64 {
    let mut value = 0.0;
    for octave in 0..6 {
        let cell_m = 3.2 / f64::from(1 << octave);
        let kept = ((cell_m / footprint_m - 1.5) / 3.0).clamp(0.0, 1.0);
        value += kept * 45.0 * (smooth(x / cell_m, y / cell_m, seed + octave) - 0.5);
    }
    value
}

/// What a camera there sees, 8-bit RGB.
pub(crate) fn picture(pose: &Pose, boards: &[Board]) -> Vec<u8> {
    let (camera, (sp, cp), (sy, cy)) = (camera(), pose.pitch.sin_cos(), pose.yaw.sin_cos());
    let mut rgb = Vec::with_capacity(SIZE[0] * SIZE[1] * 3);
    for row in 0..SIZE[1] {
        for column in 0..SIZE[0] {
            let mut sum = 0.0;
            // Edges are as smooth as a lens makes them.
            for [du, dv] in [[-0.375, -0.125], [0.125, -0.375], [0.375, 0.125], [-0.125, 0.375]] {
                let [a, b, c] = camera.point_from_pixel([column as f64 + du, row as f64 + dv], 1.0);
                // Back from the nod, then from the turn.
                let (y, along) = (cp * b + sp * c, cp * c - sp * b);
                let (x, z) = (cy * a - sy * along, sy * a + cy * along);
                sum += brightness(pose, [x, y, z], boards);
            }
            rgb.extend([(0.25 * sum).round().clamp(0.0, 255.0) as u8; 3]);
        }
    }
    rgb
}

fn brightness(pose: &Pose, [x, y, z]: [f64; 3], boards: &[Board]) -> f64 {
    let mut nearest = ((WALL_M - pose.z) / z, None);
    for board in boards {
        let t = (board.z - pose.z) / z;
        let (at_x, at_y) = (pose.x + t * x, t * y);
        let is_hit = at_x > board.x[0] && at_x < board.x[1] && at_y < HEIGHT_M && at_y > HEIGHT_M - board.height_m;
        if t > 0.1 && t < nearest.0 && is_hit {
            nearest = (t, Some(board));
        }
    }
    let ground = if y > 0.0 { HEIGHT_M / y } else { f64::INFINITY };
    if ground < nearest.0 {
        let (at_x, at_z) = (pose.x + ground * x, pose.z + ground * z);
        95.0 + texture(at_x, at_z, ground * ground / (FOCAL * HEIGHT_M), 7)
    } else {
        let (t, board) = nearest;
        let seed = board.map_or(40, |board| board.seed);
        let (at_x, at_y) = (t * x + pose.x - board.map_or(0.0, |board| board.x[0]), t * y);
        130.0 + 1.2 * texture(at_x, at_y, t / FOCAL, seed)
    }
}

/// Posts on both sides of the road.
pub(crate) fn posts() -> Vec<Board> {
    (0..14)
        .map(|k| {
            let side = if k % 2 == 0 { -1.0 } else { 1.0 };
            let x = side * (6.0 + f64::from(k % 3));
            Board { x: [x - 0.5, x + 0.5], height_m: 4.0, z: 6.0 + 5.0 * f64::from(k), seed: 100 + 10 * k as u32 }
        })
        .collect()
}

/// Where the picture shows a board, pixels.
pub(crate) fn board_box(pose: &Pose, board: &Board) -> Box2d {
    let depth = board.z - pose.z;
    let [x1, x2] = board.x.map(|x| (x - pose.x) / depth * FOCAL + 0.5 * (SIZE[0] as f64 - 1.0));
    let [y1, y2] = [HEIGHT_M - board.height_m, HEIGHT_M].map(|y| y / depth * FOCAL + HORIZON);
    Box2d::new(x1, y1, x2, y2)
}
