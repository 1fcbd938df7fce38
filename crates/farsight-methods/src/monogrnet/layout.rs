//! How many numbers there are of a box, and how finely it is looked at.

/// Numbers of a box in the image.
pub const BOX_NUMBERS: usize = 4;

/// Numbers of the corners of a box in space.
pub const CORNER_NUMBERS: usize = 24;

/// Samples along each side of a box.
pub const SIDE: usize = 16;

/// Input pixels per cell of the grid.
pub const CELL_STRIDE: usize = 32;

/// Input pixels per cell of the maps that are read at boxes.
pub const MAP_STRIDE: usize = 8;
