//! Meshes of those who take part in traffic, fitted exactly to given sizes.
//!
//! One file for each kind of object or part: `car`, `truck`, `person`, and what they are made of. Whoever calls
//! [`build`] chooses class, size and level of detail; where the object stands is not known here.
//!
//! Object coordinates: x along the heading, y **down** with 0 at the ground, z across; metres. A mesh's extents equal
//! its size.

mod bicycle;
mod body;
mod cabin;
mod car;
mod context;
mod faces;
mod human;
mod load;
mod lorry;
mod outfit;
mod paint;
mod person;
mod profiles;
mod shape;
mod style;
mod three_wheeler;
mod truck;
mod two_wheeler;
mod wheels;

pub(crate) use bicycle::bicycle;
pub(crate) use context::{BuildContext, Detail, Look, ObjectState, Paint, PlateFormat, STRIDE};
pub(crate) use shape::Shape;

use farsight_core::{Box3d, Dimensions, ObjectClass};

use crate::mesh_builder::{MeshBuilder, Turn};
use crate::scene::{Mesh, Object, Vec3};
use crate::vector::add;

/// The mesh of an object of `class` and `size`, in object coordinates.
pub(crate) fn build(class: &ObjectClass, size: Dimensions, context: &mut BuildContext) -> Mesh {
    let hwl = [size.height, size.width, size.length].map(|v| v as f32);
    let mesh = match class {
        ObjectClass::Car => car::car(hwl, context),
        ObjectClass::Van => car::van(hwl, context),
        ObjectClass::Truck => truck::truck(hwl, context),
        ObjectClass::Tram => truck::tram(hwl, context),
        ObjectClass::Pedestrian => person::standing(hwl, context),
        ObjectClass::PersonSitting => person::sitting(hwl, context),
        ObjectClass::Cyclist => person::cyclist(hwl, context),
        _ => truck::trailer(hwl, context),
    };
    fitted(mesh, hwl)
}

/// Someone who walks, at each of the [`STRIDE`] parts of two steps; `draw` builds one with this state, always of the
/// same draws. The longest step fills the box, the others are as long as they are.
pub(crate) fn walker(size: Dimensions, mut draw: impl FnMut(Option<u8>) -> Mesh) -> Vec<Mesh> {
    let hwl = [size.height, size.width, size.length].map(|v| v as f32);
    let meshes: Vec<Mesh> = (0..STRIDE).map(|part| draw(Some(part))).collect();
    let extents: Vec<[Vec3; 2]> = meshes.iter().filter_map(extents).collect();
    let Some(&longest) = extents.iter().max_by(|a, b| (a[1][0] - a[0][0]).total_cmp(&(b[1][0] - b[0][0]))) else {
        return meshes;
    };
    meshes.into_iter().map(|mesh| stretched(mesh, longest, hwl)).collect()
}

/// The mesh of someone who walks before it is fitted.
pub(crate) fn unfitted_walker(size: Dimensions, context: &mut BuildContext) -> Mesh {
    person::standing([size.height, size.width, size.length].map(|v| v as f32), context)
}

/// `mesh` stretched so that its extents are exactly the size (height, width, length), standing on y = 0.
fn fitted(mesh: Mesh, hwl: [f32; 3]) -> Mesh {
    match extents(&mesh) {
        Some(extents) => stretched(mesh, extents, hwl),
        None => mesh,
    }
}

/// The smallest and the largest coordinates.
fn extents(mesh: &Mesh) -> Option<[Vec3; 2]> {
    let first = mesh.vertices.first()?.position;
    let (mut low, mut high) = (first, first);
    for vertex in &mesh.vertices {
        for axis in 0..3 {
            low[axis] = low[axis].min(vertex.position[axis]);
            high[axis] = high[axis].max(vertex.position[axis]);
        }
    }
    Some([low, high])
}

/// `mesh` stretched so that these extents become the size.
fn stretched(mut mesh: Mesh, [low, high]: [Vec3; 2], [height, width, length]: [f32; 3]) -> Mesh {
    let to_low = [-length / 2.0, -height, -width / 2.0];
    let to_high = [length / 2.0, 0.0, width / 2.0];
    for vertex in &mut mesh.vertices {
        for axis in 0..3 {
            let share = (vertex.position[axis] - low[axis]) / (high[axis] - low[axis]).max(1e-6);
            vertex.position[axis] = to_low[axis] + share * (to_high[axis] - to_low[axis]);
        }
    }
    mesh
}

/// The mesh moved to where the box is.
pub(crate) fn placed(mesh: &Mesh, box3d: &Box3d, instance: u16) -> Object {
    let mut shape = MeshBuilder::default();
    shape.place(mesh, box3d.yaw, box3d.location.map(|v| v as f32));
    Object { mesh: shape.mesh, instance, casts_shadow: true }
}

/// A point of an object, given in object coordinates, in the scene.
pub(crate) fn point_of(box3d: &Box3d, point: Vec3) -> Vec3 {
    add(Turn::new(box3d.yaw).apply(point), box3d.location.map(|v| v as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::palette::Palette;
    use crate::rng::SceneRng;
    use crate::scene::{Pattern, Triangle};
    use crate::sizes::SizeStatistics;
    use crate::vector::{cross, dot, length, scale, sub};

    /// Surfaces nearer than this to each other, metres, flicker.
    const APART_M: f32 = 0.001;

    fn points(mesh: &Mesh, triangle: &Triangle) -> [Vec3; 3] {
        triangle.vertices.map(|k| mesh.vertices[k as usize].position)
    }

    /// How deep inside a triangle a point of its plane lies, metres; negative outside.
    fn depth_inside([a, b, c]: [Vec3; 3], normal: Vec3, point: Vec3) -> f32 {
        let edge = |from: Vec3, to: Vec3| dot(cross(normal, sub(to, from)), sub(point, from)) / length(sub(to, from));
        edge(a, b).min(edge(b, c)).min(edge(c, a))
    }

    /// Whether the middle of `triangle` lies on `other`, in the same plane.
    fn rests_on(triangle: [Vec3; 3], other: [Vec3; 3]) -> bool {
        let normal = |[a, b, c]: [Vec3; 3]| cross(sub(b, a), sub(c, a));
        let (mine, its) = (normal(triangle), normal(other));
        let (my_length, its_length) = (length(mine), length(its));
        if my_length < 2e-4 || its_length < 2e-4 || dot(mine, its).abs() < 0.999 * my_length * its_length {
            return false;
        }
        let unit = scale(its, 1.0 / its_length);
        let middle = scale(add(add(triangle[0], triangle[1]), triangle[2]), 1.0 / 3.0);
        dot(unit, sub(middle, other[0])).abs() < APART_M && depth_inside(other, unit, middle) > 0.01
    }

    /// An object of a class, of a size drawn for it, and its materials.
    fn built(class: &ObjectClass, [seed, index]: [u64; 2], detail: Detail) -> (Mesh, Palette) {
        let mut rng = SceneRng::new(seed, index, 0);
        let size = SizeStatistics::of(class).sample(&mut rng);
        let mut palette = Palette::default();
        let state = ObjectState { moving: seed.is_multiple_of(2), ..ObjectState::default() };
        let mesh = build(
            class,
            size,
            &mut BuildContext { palette: &mut palette, rng, detail, state, unusual: false, plate: None, look: None },
        );
        (mesh, palette)
    }

    #[test]
    fn no_two_materials_flicker_in_one_place() {
        use ObjectClass::{Car, Cyclist, Misc, Pedestrian, Tram, Truck, Van};
        for (k, class) in [Car, Van, Truck, Tram, Misc, Cyclist, Pedestrian].into_iter().enumerate() {
            // Cars and vans have the most pieces.
            let seeds = if k < 2 { 20 } else { 8 };
            for seed in 0..seeds {
                let (mesh, palette) = built(&class, [seed, k as u64], Detail::Near);
                for a in &mesh.triangles {
                    let place = points(&mesh, a);
                    let rival = mesh
                        .triangles
                        .iter()
                        .find(|b| b.layer == a.layer && b.material != a.material && rests_on(place, points(&mesh, b)));
                    let material = |t: &Triangle| palette.materials[usize::from(t.material)];
                    assert!(
                        rival.is_none(),
                        "{class:?}, seed {seed}: {place:?} of {:?} lies on {:?}",
                        material(a),
                        rival.map(material)
                    );
                }
            }
        }
    }

    #[test]
    fn one_looks_into_near_cars_only() {
        let is_sheer = |palette: &Palette, triangle: &Triangle| {
            matches!(palette.materials[usize::from(triangle.material)].pattern, Pattern::Transparent { .. })
        };
        for class in [ObjectClass::Car, ObjectClass::Van] {
            for (detail, transparent) in [(Detail::Near, true), (Detail::Middle, true), (Detail::Far, false)] {
                for seed in 0..40 {
                    let (mesh, palette) = built(&class, [seed, 0], detail);
                    let found = mesh.triangles.iter().any(|triangle| is_sheer(&palette, triangle));
                    assert_eq!(found, transparent, "{class:?}, seed {seed}, {detail:?}");
                }
            }
        }
    }

    #[test]
    fn those_who_ride_stay_within_their_car() {
        let extents = |class: &ObjectClass, seed: u64, moving: bool| {
            let mut rng = SceneRng::new(seed, 0, 0);
            let size = SizeStatistics::of(class).sample(&mut rng);
            let hwl = [size.height, size.width, size.length].map(|v| v as f32);
            let mut palette = Palette::default();
            let state = ObjectState { moving, ..ObjectState::default() };
            let mut context = BuildContext {
                palette: &mut palette,
                rng,
                detail: Detail::Middle,
                state,
                unusual: false,
                plate: None,
                look: None,
            };
            // As it is before it is stretched to its size.
            let mesh = if *class == ObjectClass::Van { car::van } else { car::car }(hwl, &mut context);
            let most = |axis: usize| mesh.vertices.iter().map(|v| v.position[axis].abs()).fold(0.0, f32::max);
            [most(0), most(1), most(2)].map(f32::to_bits)
        };
        for class in [ObjectClass::Car, ObjectClass::Van] {
            for seed in 0..40 {
                let [ridden, parked] = [true, false].map(|moving| extents(&class, seed, moving));
                assert_eq!(ridden, parked, "{class:?}, seed {seed}");
            }
        }
    }
}
