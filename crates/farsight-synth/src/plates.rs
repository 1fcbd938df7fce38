//! Where the number plates of labelled vehicles are, as far as the image shows them.

use farsight_core::{Box3d, Label, ObjectClass};
use farsight_data::annotations::{Plate, Plates};

use crate::render::Rendered;
use crate::scene::{LabelledObject, MaterialId, Mesh, Scene, Vec3};

/// The image shows a plate if what it shows there is no farther from it than this, metres of depth.
const APART_M: f64 = 0.1;

/// Where on a plate that is looked at, as shares from one end to the other.
const LOOKED_AT: [f64; 3] = [0.15, 0.5, 0.85];

/// The plates that the image shows of those who have a label, in the order of the labels.
pub(crate) fn plates(scene: &Scene, objects: &[LabelledObject], rendered: &Rendered, labels: &[Label]) -> Plates {
    let labelled = labels.iter().enumerate().filter(|(_, label)| label.class != ObjectClass::DontCare);
    let plates = labelled.filter_map(|(place, label)| {
        let labelled = objects.iter().find(|labelled| labelled.box3d == label.box3d)?;
        let mesh = &scene.objects.iter().find(|object| object.instance == labelled.instance)?.mesh;
        let ends = [1.0, -1.0].into_iter().filter_map(|end| ends_of(mesh, labelled.plate?, &labelled.box3d, end));
        let mut seen = ends.filter(|ends| is_seen(scene, rendered, ends));
        seen.next().map(|ends| Plate { label: place, ends })
    });
    Plates(plates.collect())
}

/// The middles of the right and the left edge of the plate at the front (1) or the rear (-1), as seen by somebody who
/// stands before it; none when the camera is behind it.
fn ends_of(mesh: &Mesh, plate: MaterialId, box3d: &Box3d, end: f64) -> Option<[[f64; 3]; 2]> {
    let (sin, cos) = (libm::sin(box3d.yaw), libm::cos(box3d.yaw));
    let ahead = [end * cos, -end * sin];
    let local = |position: Vec3| {
        let [x, z] = [0, 2].map(|axis| f64::from(position[axis]) - box3d.location[axis]);
        [x * ahead[0] + z * ahead[1], x * ahead[1] - z * ahead[0]]
    };
    let corners = mesh.triangles.iter().filter(|triangle| triangle.material == plate);
    let corners = corners.flat_map(|triangle| triangle.vertices).map(|k| mesh.vertices[k as usize].position);
    let corners: Vec<Vec3> = corners.filter(|&corner| local(corner)[0] > 0.0).collect();
    let middle = mean(&corners)?;
    let is_before = middle[0] * ahead[0] + middle[2] * ahead[1] < 0.0;
    let across = local(middle.map(|at| at as f32))[1];
    let (right, left): (Vec<Vec3>, Vec<Vec3>) = corners.iter().partition(|corner| local(**corner)[1] < across);
    if is_before { Some([mean(&right)?, mean(&left)?]) } else { None }
}

fn mean(points: &[Vec3]) -> Option<[f64; 3]> {
    let sum = |axis: usize| points.iter().map(|point| f64::from(point[axis])).sum::<f64>();
    (!points.is_empty()).then(|| [0, 1, 2].map(|axis| sum(axis) / points.len() as f64))
}

/// Whether nothing stands before the plate, and it is within the image.
fn is_seen(scene: &Scene, rendered: &Rendered, [right, left]: &[[f64; 3]; 2]) -> bool {
    let [width, height] = rendered.size;
    LOOKED_AT.iter().all(|share| {
        let point = [0, 1, 2].map(|axis| right[axis] + share * (left[axis] - right[axis]));
        let Some([u, v]) = scene.camera.pixel_from_point(point) else { return false };
        let (column, row) = (u.round(), v.round());
        let is_inside = column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64;
        is_inside && {
            let seen = rendered.depth_m[row as usize * width + column as usize];
            (f64::from(seen) - point[2]).abs() < APART_M
        }
    })
}
