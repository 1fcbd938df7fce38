//! Encode and decode: between a box in the scene and what stands at a cell of the grid. `decode(encode(x)) = x`, at any
//! cell.

use farsight_core::{Box3d, ClassReference, Dimensions, wrapped_angle};

use super::grid::Grid;

/// What offsets of the place are divided by, metres: x, y, z (authors' code).
const PLACE_STD_M: [f64; 3] = [0.5, 0.36, 0.5];

/// What logarithms of sizes are divided by: height, width, length (authors' code).
const LOG_SIZE_STD: [f64; 3] = [0.085, 0.067, 0.115];

/// What stands at one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoded {
    /// From the cell's middle on the ground to the middle of the box's bottom.
    pub place: [f64; 3],
    /// Logarithms of height, width and length over those of the class.
    pub size: [f64; 3],
    /// Cosine and sine of the yaw.
    pub cos_sin: [f64; 2],
}

/// The two directions of the code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Codec<'a> {
    /// Where the cells are.
    pub grid: &'a Grid,
    /// The classes, whose sizes count.
    pub classes: &'a [ClassReference],
}

impl Codec<'_> {
    /// Height, width and length, metres, that the sizes of a class are relative to.
    fn reference(&self, class: usize) -> [f64; 3] {
        let [length, height, width] = self.classes[class].dimensions_lhw;
        [height, width, length]
    }

    /// What stands at `cell` (column, row) for `object` of a class.
    pub fn encode(&self, object: &Box3d, class: usize, cell: [usize; 2]) -> Encoded {
        let (center, reference) = (self.grid.center(cell), self.reference(class));
        let Dimensions { height, width, length } = object.dimensions;
        let sides = [height, width, length];
        let (sin, cos) = object.yaw.sin_cos();
        Encoded {
            place: [0, 1, 2].map(|axis| (object.location[axis] - center[axis]) / PLACE_STD_M[axis]),
            size: [0, 1, 2].map(|side| (sides[side] / reference[side]).ln() / LOG_SIZE_STD[side]),
            cos_sin: [cos, sin],
        }
    }

    /// The box that stands at `cell`.
    pub fn decode(&self, encoded: &Encoded, class: usize, cell: [usize; 2]) -> Box3d {
        let (center, reference) = (self.grid.center(cell), self.reference(class));
        let [height, width, length] =
            [0, 1, 2].map(|side| reference[side] * (encoded.size[side] * LOG_SIZE_STD[side]).exp());
        let [cos, sin] = encoded.cos_sin;
        Box3d {
            dimensions: Dimensions { height, width, length },
            location: [0, 1, 2].map(|axis| center[axis] + encoded.place[axis] * PLACE_STD_M[axis]),
            yaw: wrapped_angle(sin.atan2(cos)),
        }
    }
}

#[cfg(test)]
mod tests {
    use farsight_core::ClassReference;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_is_encoded_comes_back(
            x in -40.0..40.0, y in 0.5..2.5, z in 0.5..80.0, yaw in -3.1..3.1, height in 0.5..4.0, length in 0.5..12.0,
            class in 0_usize..3, column in 0_usize..160, row in 0_usize..160,
        ) {
            let (grid, classes) = (Grid::default(), ClassReference::smoke());
            let codec = Codec { grid: &grid, classes: &classes };
            let object = Box3d { dimensions: Dimensions { height, width: 1.7, length }, location: [x, y, z], yaw };
            let back = codec.decode(&codec.encode(&object, class, [column, row]), class, [column, row]);
            prop_assert!(back.location.iter().zip(object.location).all(|(a, b)| (a - b).abs() < 1e-9), "{back:?}");
            prop_assert!(wrapped_angle(back.yaw - object.yaw).abs() < 1e-9);
            let sides = |one: &Box3d| [one.dimensions.height, one.dimensions.width, one.dimensions.length];
            prop_assert!(sides(&back).iter().zip(sides(&object)).all(|(a, b)| (a - b).abs() < 1e-9), "{back:?}");
        }
    }
}
