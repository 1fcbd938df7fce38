//! `vision_msgs/Detection3DArray` (version 4 of the package, ROS 2 Humble and later).

use crate::boxes::{Placed, covariance_m2};
use crate::cdr::Cdr;
use crate::recorded_frame::RecordedObject;

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
pub(crate) fn message(stamp: Stamp, frame: &str, found: &[RecordedObject]) -> Vec<u8> {
    let mut cdr = Cdr::new();
    header(&mut cdr, stamp, frame);
    cdr.u32(found.len() as u32);
    for RecordedObject { id, detection, .. } in found {
        let placed = Placed::of(&detection.box3d);
        header(&mut cdr, stamp, frame);
        // One hypothesis: its class, score and pose with covariance.
        cdr.u32(1);
        cdr.string(&detection.class.to_string());
        cdr.f64s(&[detection.score]);
        pose(&mut cdr, &placed);
        cdr.f64s(&covariance(covariance_m2(detection)));
        pose(&mut cdr, &placed);
        cdr.f64s(&placed.size_m);
        cdr.string(id);
    }
    cdr.into_bytes()
}

/// Six by six, row by row: position, then rotation about the axes.
fn covariance(position_m2: [[f64; 3]; 3]) -> [f64; 36] {
    let mut all = [0.0; 36];
    for (row, values) in position_m2.iter().enumerate() {
        all[6 * row..6 * row + 3].copy_from_slice(values);
    }
    all
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
