//! `vision_msgs/Detection3DArray` (version 4 of the package, ROS 2 Humble and later).

use crate::boxes::{Placed, covariance_m2};
use crate::cdr::Cdr;
use crate::moment::Found;

/// The name of the type.
pub(crate) const NAME: &str = "vision_msgs/msg/Detection3DArray";

/// Its definition and those of all types in it.
pub(crate) const SCHEMA: &str = include_str!("detection3d.txt");

/// Seconds and nanoseconds.
pub(crate) type Stamp = (u32, u32);

/// The message for what was found, all in `frame`.
///
/// The centre is that of the box. The box's own axes are x forward, y left, z up, and its size is along these: length,
/// width, height. The covariance is that of the position; rotations are not estimated and have 0.
pub(crate) fn message(stamp: Stamp, frame: &str, found: &[Found]) -> Vec<u8> {
    let mut cdr = Cdr::new();
    header(&mut cdr, stamp, frame);
    cdr.u32(found.len() as u32);
    for Found { id, detection, .. } in found {
        let placed = Placed::of(&detection.box3d);
        header(&mut cdr, stamp, frame);
        // One hypothesis: its class, score and pose with covariance.
        cdr.u32(1);
        cdr.string(&detection.class.to_string());
        cdr.f64s(&[detection.score]);
        pose(&mut cdr, &placed);
        let position = covariance_m2(detection);
        for row in 0..6 {
            cdr.f64s(&[0, 1, 2, 3, 4, 5].map(|column| if row < 3 && column < 3 { position[row][column] } else { 0.0 }));
        }
        pose(&mut cdr, &placed);
        cdr.f64s(&placed.size_m);
        cdr.string(id);
    }
    cdr.into_bytes()
}

fn header(cdr: &mut Cdr, (seconds, nanoseconds): Stamp, frame: &str) {
    cdr.i32(seconds.cast_signed());
    cdr.u32(nanoseconds);
    cdr.string(frame);
}

fn pose(cdr: &mut Cdr, placed: &Placed) {
    cdr.f64s(&placed.center_m);
    cdr.f64s(&placed.rotation);
}
