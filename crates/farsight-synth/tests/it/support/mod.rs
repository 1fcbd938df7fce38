//! Scenes made by hand, for tests and for measuring.
#![allow(dead_code, unreachable_pub, clippy::expect_used)] // Each test uses some of it, and it is used by nothing else.

use farsight_core::Camera;
use farsight_synth::scene::{
    Atmosphere, Color, InstanceId, Material, MaterialId, Mesh, Object, Pattern, Scene, Sky, Sun, Triangle, Vec3, Vertex,
};
use farsight_synth::sensor::Device;

/// Height of the camera above the ground, metres.
pub const CAMERA_HEIGHT_M: f32 = 1.65;

/// A surface of one colour.
pub fn plain(color: Color) -> Material {
    Material { color, pattern: Pattern::Plain, specular: 0.0, shininess: 20.0, reflectivity: 0.0, emission: [0.0; 3] }
}

/// A flat quadrilateral, corners in order around it; uv in metres along its first and last side.
pub fn quad(corners: [Vec3; 4], material: MaterialId, layer: u8) -> Mesh {
    let side = |i: usize| [0, 1, 2].map(|axis| corners[i][axis] - corners[0][axis]);
    let (along, up) = (side(1), side(3));
    let cross =
        [along[1] * up[2] - along[2] * up[1], along[2] * up[0] - along[0] * up[2], along[0] * up[1] - along[1] * up[0]];
    let length = |v: Vec3| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let normal = cross.map(|c| c / length(cross));
    let (w, h) = (length(along), length(up));
    let uv = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
    let vertices = [0, 1, 2, 3].map(|i| Vertex { position: corners[i], normal, uv: uv[i] });
    let triangles = [[0, 1, 2], [0, 2, 3]].map(|vertices| Triangle { vertices, material, layer });
    Mesh { vertices: vertices.to_vec(), triangles: triangles.to_vec() }
}

/// Both meshes in one.
pub fn joined(mut a: Mesh, b: Mesh) -> Mesh {
    let offset = a.vertices.len() as u32;
    a.vertices.extend(b.vertices);
    a.triangles.extend(b.triangles.iter().map(|t| Triangle { vertices: t.vertices.map(|v| v + offset), ..*t }));
    a
}

/// An upright block standing on `bottom` (centre of its lower face), sides along the axes, size along x, y and z.
pub fn block(bottom: Vec3, size: Vec3, material: MaterialId) -> Mesh {
    let [x, y, z] = bottom;
    let [hx, hz] = [size[0] / 2.0, size[2] / 2.0];
    let (x0, x1, y0, y1, z0, z1) = (x - hx, x + hx, y - size[1], y, z - hz, z + hz);
    let faces = [
        [[x0, y1, z0], [x1, y1, z0], [x1, y0, z0], [x0, y0, z0]],
        [[x1, y1, z1], [x0, y1, z1], [x0, y0, z1], [x1, y0, z1]],
        [[x0, y1, z1], [x0, y1, z0], [x0, y0, z0], [x0, y0, z1]],
        [[x1, y1, z0], [x1, y1, z1], [x1, y0, z1], [x1, y0, z0]],
        [[x0, y0, z0], [x1, y0, z0], [x1, y0, z1], [x0, y0, z1]],
        [[x0, y1, z0], [x1, y1, z0], [x1, y1, z1], [x0, y1, z1]],
    ];
    faces.into_iter().map(|face| quad(face, material, 0)).fold(Mesh::default(), joined)
}

/// A mesh as part of a scene.
pub fn object(mesh: Mesh, instance: InstanceId) -> Object {
    Object { mesh, instance, casts_shadow: true }
}

/// A mesh that throws no shadow.
pub fn flat(mesh: Mesh) -> Object {
    Object { mesh, instance: 0, casts_shadow: false }
}

/// KITTI's camera, roughly.
pub fn camera() -> Camera {
    Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).expect("a camera")
}

/// An empty scene at noon under a blue sky.
pub fn empty(camera: Camera, image_size: [usize; 2]) -> Scene {
    Scene {
        camera,
        image_size,
        objects: Vec::new(),
        materials: vec![plain([0.5, 0.5, 0.5])],
        sun: Sun { direction: [0.48, -0.8, -0.36], color: [0.95, 0.9, 0.8], shadow: 1.0, canopy: None },
        lamps: Vec::new(),
        sky: Sky {
            zenith: [0.12, 0.25, 0.6],
            horizon: [0.55, 0.65, 0.8],
            ground: [0.18, 0.17, 0.15],
            ambient: 0.6,
            clouds: 0.4,
            cloud_color: [0.8, 0.8, 0.82],
            skyline: 0.13,
            seed: 5,
            photograph: None,
        },
        atmosphere: Atmosphere { fog_color: [0.6, 0.66, 0.75], fog_density: 0.002, wetness: 0.0, rain: 0.0 },
        device: Device::Any,
    }
}

/// The ground from just behind the camera to `far` metres, in squares of `step` metres.
pub fn ground(far: f32, step: f32, material: MaterialId) -> Mesh {
    let normal = [0.0, -1.0, 0.0];
    let (columns, rows) = ((far / step) as u32, (far / step) as u32 + 2);
    let mut mesh = Mesh::default();
    for row in 0..=rows {
        for column in 0..=columns {
            let (x, z) = ((column as f32 - columns as f32 / 2.0) * step, row as f32 * step - 2.0 * step);
            mesh.vertices.push(Vertex { position: [x, CAMERA_HEIGHT_M, z], normal, uv: [x, z] });
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let a = row * (columns + 1) + column;
            let (b, c, d) = (a + 1, a + columns + 2, a + columns + 1);
            mesh.triangles.extend([[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, material, layer: 0 }));
        }
    }
    mesh
}

/// A street with all patterns: asphalt, markings, houses, trees, a pane of glass, and three blocks for vehicles
/// (instances 1 to 3).
pub fn street() -> Scene {
    let mut scene = empty(camera(), [1242, 375]);
    let noise = |color, other, scale| Material {
        pattern: Pattern::Noise { other, scale, amount: 0.8, seed: 1 },
        ..plain(color)
    };
    let y = CAMERA_HEIGHT_M;
    scene.materials = vec![
        noise([0.11, 0.11, 0.115], [0.19, 0.185, 0.18], 0.6),
        Material { pattern: Pattern::Worn { scale: 0.2, wear: 0.2, seed: 2 }, ..plain([0.75, 0.75, 0.7]) },
        noise([0.08, 0.16, 0.04], [0.17, 0.22, 0.07], 1.5),
        Material {
            pattern: Pattern::Bricks {
                other: [0.5, 0.48, 0.45],
                size: [0.24, 0.08],
                joint: 0.012,
                variation: 0.5,
                seed: 3,
            },
            ..plain([0.4, 0.16, 0.1])
        },
        Material {
            pattern: Pattern::Windows {
                other: [0.04, 0.05, 0.06],
                pitch: [2.5, 3.0],
                fill: [0.45, 0.5],
                lit: 0.1,
                seed: 4,
            },
            reflectivity: 0.1,
            ..plain([0.6, 0.55, 0.45])
        },
        Material {
            pattern: Pattern::Leaves { other: [0.12, 0.2, 0.03], scale: 0.35, density: 0.65, seed: 5 },
            ..plain([0.03, 0.08, 0.015])
        },
        Material { specular: 0.6, shininess: 60.0, reflectivity: 0.06, ..plain([0.5, 0.02, 0.02]) },
        Material { specular: 0.6, shininess: 60.0, reflectivity: 0.06, ..plain([0.6, 0.62, 0.65]) },
        Material {
            pattern: Pattern::Stripes { other: [0.7, 0.1, 0.1], period: 0.5, share: 0.5 },
            ..plain([0.8, 0.8, 0.8])
        },
        Material {
            pattern: Pattern::Transparent { share: 0.5 },
            specular: 0.9,
            reflectivity: 0.2,
            ..plain([0.02, 0.03, 0.03])
        },
    ];
    scene.objects.push(flat(ground(120.0, 2.0, 2)));
    scene.objects.push(flat(quad([[-5.0, y, -1.0], [5.0, y, -1.0], [5.0, y, 120.0], [-5.0, y, 120.0]], 0, 1)));
    for i in 0..20_u8 {
        let z = 4.0 + 6.0 * f32::from(i);
        let marking = quad([[-0.08, y, z], [0.08, y, z], [0.08, y, z + 3.0], [-0.08, y, z + 3.0]], 1, 2);
        scene.objects.push(flat(marking));
    }
    for i in 0..6_u8 {
        let z = 12.0 + 15.0 * f32::from(i);
        let material = if i % 2 == 0 { 3 } else { 4 };
        scene.objects.push(object(block([-13.0, y, z], [8.0, 9.0, 12.0], material), 0));
        scene.objects.push(object(tree([8.0, y, z]), 0));
    }
    let shelter = [[-4.4, y, 14.0], [-4.4, y, 17.0], [-4.4, y - 2.3, 17.0], [-4.4, y - 2.3, 14.0]];
    scene.objects.push(object(quad(shelter, 9, 0), 0));
    scene.objects.push(object(block([12.0, y, 50.0], [0.2, 1.0, 80.0], 8), 0));
    scene.objects.push(object(block([2.4, y, 9.0], [1.7, 1.5, 4.2], 6), 1));
    scene.objects.push(object(block([-2.6, y, 22.0], [1.8, 1.6, 4.5], 7), 2));
    scene.objects.push(object(block([2.6, y, 40.0], [1.8, 1.5, 4.3], 6), 3));
    scene
}

/// A trunk and a crown of crossed quadrilaterals of leaves.
fn tree(foot: Vec3) -> Mesh {
    let [x, y, z] = foot;
    let mut mesh = block(foot, [0.3, 2.5, 0.3], 2);
    for i in 0..8_u8 {
        let turn = f32::from(i) * 0.39;
        let (dx, dz) = (2.0 * libm::cosf(turn), 2.0 * libm::sinf(turn));
        let (low, high) = (y - 1.8, y - 6.0);
        let corners = [[x - dx, low, z - dz], [x + dx, low, z + dz], [x + dx, high, z + dz], [x - dx, high, z - dz]];
        mesh = joined(mesh, quad(corners, 5, 0));
    }
    mesh
}
