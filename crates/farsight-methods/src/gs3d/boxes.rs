//! The first network's answers: a 2D box and the angle under which its object is seen, at the cell of the box's centre.

use farsight_core::Box2d;
use farsight_core::peaks::Peak;
use farsight_runtime::TensorView;

use crate::center_map::{Heading, value_at};

/// What stands at one cell, after activations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoded {
    /// Column and row of the cell that holds the box's centre.
    pub cell: [usize; 2],
    /// Position of the centre within the cell, cells.
    pub offset: [f64; 2],
    /// Width and height, cells.
    pub size: [f64; 2],
    /// The observation angle.
    pub heading: Heading,
}

impl Encoded {
    /// What stands at the cell of a box (cells) whose object is seen under `alpha`; none where the centre has no cell.
    pub fn new(box2d: &Box2d, alpha: f64) -> Option<Self> {
        let center = [f64::midpoint(box2d.x1, box2d.x2), f64::midpoint(box2d.y1, box2d.y2)];
        center.iter().all(|v| *v >= 0.0).then(|| Self {
            cell: center.map(|v| v as usize),
            offset: center.map(f64::fract),
            size: [box2d.width(), box2d.height()],
            heading: Heading::from_alpha(alpha),
        })
    }

    /// What the maps of offsets, sizes and headings say at the cell of a peak.
    pub fn at(peak: &Peak, [offset, size, heading]: [&TensorView<'_>; 3]) -> Self {
        let cell = peak.cell;
        let pair = |map: &TensorView<'_>| [value_at(map, 0, cell), value_at(map, 1, cell)];
        let heading = Heading::from_channels(|channel| value_at(heading, channel, cell));
        Self { cell, offset: pair(offset), size: pair(size), heading }
    }

    /// The box, cells.
    pub fn box2d(&self) -> Box2d {
        let [x, y] = [0, 1].map(|axis| self.cell[axis] as f64 + self.offset[axis]);
        let [width, height] = self.size.map(|side| side.max(0.0));
        Box2d::new(x - width / 2.0, y - height / 2.0, x + width / 2.0, y + height / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use farsight_core::wrapped_angle;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_is_encoded_comes_back(
            x in 0.0..300.0, y in 0.0..80.0, width in 0.5..60.0, height in 0.5..40.0, alpha in -3.1..3.1,
        ) {
            let box2d = Box2d::new(x, y, x + width, y + height);
            let encoded = Encoded::new(&box2d, alpha).unwrap();
            let found = encoded.box2d();
            for (a, b) in [(found.x1, box2d.x1), (found.y1, box2d.y1), (found.x2, box2d.x2), (found.y2, box2d.y2)] {
                prop_assert!((a - b).abs() < 1e-9, "{found:?}");
            }
            prop_assert!(wrapped_angle(encoded.heading.alpha() - alpha).abs() < 1e-9);
        }
    }
}
