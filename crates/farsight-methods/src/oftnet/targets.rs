//! What the network is asked to answer for one image.

use farsight_core::{Box3d, ClassReference, Dimensions, Label};

use super::codec::{Codec, Encoded};

/// Width of the Gaussian around an object's place, metres (standard deviation).
const SIGMA_M: f64 = 1.0;

/// Targets of one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// How near to an object each cell is, `[classes, rows, columns]`: 1 at its place.
    pub heatmap: Vec<f32>,
    /// The cells under objects: class, column and row, and what stands there.
    pub cells: Vec<(usize, [usize; 2], Encoded)>,
}

/// Targets for `labels`. Objects of other classes are left out; those outside the grid reach into it by their
/// Gaussians.
pub fn targets(labels: &[Label], codec: &Codec<'_>) -> Targets {
    let grid = codec.grid;
    let mut heatmap = vec![0.0_f32; codec.classes.len() * grid.cells()];
    let mut cells = Vec::new();
    for label in labels {
        let Some(class) = class_of(label, codec.classes) else { continue };
        let channel = &mut heatmap[class * grid.cells()..][..grid.cells()];
        for (place, value) in channel.iter_mut().enumerate() {
            let cell = [place % grid.columns, place / grid.columns];
            let center = grid.center(cell);
            let [dx, dz] = [0, 2].map(|axis| center[axis] - label.box3d.location[axis]);
            let near = (-(dx * dx + dz * dz) / (2.0 * SIGMA_M * SIGMA_M)).exp();
            *value = value.max(near as f32);
            if is_under(&label.box3d, [dx, dz]) {
                cells.push((class, cell, codec.encode(&label.box3d, class, cell)));
            }
        }
    }
    Targets { heatmap, cells }
}

fn class_of(label: &Label, classes: &[ClassReference]) -> Option<usize> {
    classes.iter().position(|known| known.class == label.class)
}

/// Whether a place so far (x and z, metres) from that of `object` lies under it.
fn is_under(object: &Box3d, [dx, dz]: [f64; 2]) -> bool {
    let (sin, cos) = object.yaw.sin_cos();
    let Dimensions { width, length, .. } = object.dimensions;
    let along = cos * dx - sin * dz;
    let across = sin * dx + cos * dz;
    along.abs() <= length / 2.0 && across.abs() <= width / 2.0
}

#[cfg(test)]
mod tests {
    use farsight_core::{Box2d, ObjectClass};

    use super::super::grid::Grid;
    use super::*;

    fn car(location: [f64; 3], yaw: f64) -> Label {
        let box3d = Box3d { dimensions: Dimensions { height: 1.5, width: 1.6, length: 4.0 }, location, yaw };
        let box2d = Box2d::new(0.0, 0.0, 1.0, 1.0);
        Label { class: ObjectClass::Car, truncation: 0.0, occlusion: 0, alpha: 0.0, box2d, box3d }
    }

    #[test]
    fn cells_under_an_object_are_those_between_its_corners() {
        let (grid, classes) = (Grid::default(), ClassReference::smoke());
        let codec = Codec { grid: &grid, classes: &classes };
        for yaw in [0.0, 0.6, 1.6, -2.4] {
            let label = car([3.1, 1.6, 17.3], yaw);
            let targets = targets(std::slice::from_ref(&label), &codec);
            // As many as its ground holds, but for those on its edges.
            let expected = 4.0 * 1.6 / (grid.cell_m * grid.cell_m);
            assert!((targets.cells.len() as f64 - expected).abs() < 8.0, "{} of {expected}", targets.cells.len());
            let corners = label.box3d.corners();
            for (_, cell, encoded) in &targets.cells {
                let [x, _, z] = grid.center(*cell);
                let reach = corners.iter().map(|corner| corner[0]).fold(f64::NEG_INFINITY, f64::max);
                let depth = corners.iter().map(|corner| corner[2]).fold(f64::NEG_INFINITY, f64::max);
                assert!(x <= reach && z <= depth);
                assert!((codec.decode(encoded, 0, *cell).location[0] - 3.1).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn cells_beside_a_turned_object_are_not_under_it() {
        // Along x at yaw 0, along z at a quarter turn.
        let object = car([0.0; 3], 0.0).box3d;
        assert!(is_under(&object, [1.9, 0.0]) && !is_under(&object, [0.0, 1.9]));
        let turned = Box3d { yaw: std::f64::consts::FRAC_PI_2, ..object };
        assert!(is_under(&turned, [0.0, 1.9]) && !is_under(&turned, [1.9, 0.0]));
        // Its front, as the corners of boxes have it.
        let diagonal = Box3d { yaw: 0.5, ..object };
        let corners = diagonal.corners();
        let inside = corners.iter().all(|corner| is_under(&diagonal, [corner[0] * 0.99, corner[2] * 0.99]));
        let outside = corners.iter().any(|corner| is_under(&diagonal, [corner[0] * 1.01, corner[2] * 1.01]));
        assert!(inside && !outside);
    }

    #[test]
    fn the_heatmap_is_highest_at_the_place_and_of_its_class_alone() {
        let (grid, classes) = (Grid::default(), ClassReference::smoke());
        let codec = Codec { grid: &grid, classes: &classes };
        let place = grid.center([90, 40]);
        let targets = targets(&[car(place, 0.3)], &codec);
        let at = |class: usize, [column, row]: [usize; 2]| {
            targets.heatmap[class * grid.cells() + row * grid.columns + column]
        };
        let car = classes.iter().position(|known| known.class == ObjectClass::Car).unwrap();
        assert!((at(car, [90, 40]) - 1.0).abs() < 1e-6);
        // A metre aside is one standard deviation.
        assert!((at(car, [92, 40]) - (-0.5_f32).exp()).abs() < 1e-6);
        assert!((at(car, [90, 42]) - (-0.5_f32).exp()).abs() < 1e-6);
        let others: f32 = (0..3).filter(|class| *class != car).map(|class| at(class, [90, 40])).sum();
        assert!(others.abs() < 1e-12);
    }
}
