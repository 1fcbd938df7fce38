//! Laws that scenes of every world obey.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used)] // Each test uses some of it, and its helpers may panic.

use farsight_core::overlap::Block;
use farsight_core::{Box3d, Dimensions};
use farsight_synth::LabelledScene;
use farsight_synth::scene::Object;

/// Meshes are stored in single precision, in scene coordinates of up to 100 m.
const EXTENT_TOLERANCE_M: f64 = 2e-4;

/// Extents of an object along its box's own axes: least and largest.
fn extents(object: &Object, box3d: &Box3d) -> [[f64; 2]; 3] {
    let (sin, cos) = box3d.yaw.sin_cos();
    let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
    for vertex in &object.mesh.vertices {
        let [x, y, z] = [0, 1, 2].map(|i| f64::from(vertex.position[i]) - box3d.location[i]);
        for (bound, value) in bounds.iter_mut().zip([cos * x - sin * z, y, sin * x + cos * z]) {
            *bound = [bound[0].min(value), bound[1].max(value)];
        }
    }
    bounds
}

pub fn assert_fills_its_box(generated: &LabelledScene, what: &str) {
    for labelled in &generated.objects {
        let object = generated.scene.objects.iter().find(|o| o.instance == labelled.instance).unwrap();
        let Dimensions { height, width, length } = labelled.box3d.dimensions;
        let expected = [[-length / 2.0, length / 2.0], [-height, 0.0], [-width / 2.0, width / 2.0]];
        for (axis, (found, expected)) in extents(object, &labelled.box3d).iter().zip(expected).enumerate() {
            for (found, expected) in found.iter().zip(expected) {
                let error = (found - expected).abs();
                assert!(error < EXTENT_TOLERANCE_M, "{what}: {:?} axis {axis}: {found} for {expected}", labelled.class);
            }
        }
    }
}

/// No two objects stand in one place.
pub fn assert_nobody_touches(generated: &LabelledScene, what: &str) {
    let blocks: Vec<Block> = generated.objects.iter().map(|a| Block::new(&a.box3d)).collect();
    for (i, a) in blocks.iter().enumerate() {
        for (j, b) in blocks.iter().enumerate().skip(i + 1) {
            assert!(a.intersection_area(b) <= 0.0, "{what}: objects {i} and {j}");
        }
    }
}

/// All numbers are finite, and triangles name corners and materials that are there.
pub fn assert_sound(generated: &LabelledScene, what: &str) {
    let materials = generated.scene.materials.len();
    for object in &generated.scene.objects {
        for vertex in &object.mesh.vertices {
            let numbers = vertex.position.iter().chain(&vertex.normal).chain(&vertex.uv);
            assert!(numbers.clone().all(|v| v.is_finite()), "{what}: {vertex:?}");
        }
        for triangle in &object.mesh.triangles {
            assert!(usize::from(triangle.material) < materials, "{what}");
            assert!(triangle.vertices.iter().all(|&v| (v as usize) < object.mesh.vertices.len()), "{what}");
        }
    }
}
