//! The bonnet of the car that carries the camera.

use super::builder::SceneBuilder;
use crate::mesh_builder::MeshBuilder;
use crate::palette::{any_color, grey};
use crate::rng::SceneRng;
use crate::scene::Vec3;

/// Stations along the bonnet and points across it.
const ALONG: usize = 7;
const ACROSS: usize = 13;

/// Puts a bonnet between camera and road, where a car of a usual size has it; whether it is in the picture is the
/// camera's matter.
pub(crate) fn add_bonnet(builder: &mut SceneBuilder, rng: &mut SceneRng) {
    // From the foot of the windscreen to the nose, ahead of the camera; heights above the ground.
    let near = rng.range32(0.55, 1.3);
    let far = near + rng.range32(0.8, 1.25);
    let (cowl, nose) = (rng.range32(0.92, 1.18), rng.range32(0.72, 0.92));
    let camera = builder.ground.at_camera as f32;
    // It ends below the camera, whatever the car.
    let cowl = cowl.min(camera - rng.range32(0.22, 0.4));
    let nose = nose.min(cowl - 0.05);
    let half = rng.range32(0.62, 0.82);
    let aside = rng.range32(-0.35, 0.35);
    let color = match rng.weighted(&[(0, 3.0), (1, 2.0), (2, 1.0)]) {
        0 => grey(rng.range32(0.012, 0.08)),
        1 => grey(rng.range32(0.4, 0.78)),
        _ => any_color(rng),
    };
    let paint = builder.palette.glossy(color, 0.7, 90.0, rng.range32(0.04, 0.14));
    let crease = rng.range32(0.0, 0.03);
    let point = |row: usize, column: usize| -> Vec3 {
        let t = row as f32 / (ALONG - 1) as f32;
        let across = column as f32 / (ACROSS - 1) as f32 * 2.0 - 1.0;
        // Round from side to side and over the nose.
        let top = cowl + (nose - cowl) * t * t;
        let fall = 0.16 * across * across * across * across + 0.03 * across * across;
        let ridge = crease * libm::cosf(across * std::f32::consts::PI * 1.5);
        let narrow = 1.0 - 0.14 * t * t;
        let ahead = near + (far - near) * t - 0.12 * across * across * t;
        [aside + across * half * narrow, camera - top + fall + ridge, ahead]
    };
    let sections: Vec<Vec<Vec3>> =
        (0..ALONG).map(|row| (0..ACROSS).map(|column| point(row, column)).collect()).collect();
    let mut shape = MeshBuilder::default();
    shape.loft(&sections, |_, _| Some(paint));
    let dark = builder.palette.matte(grey(0.01));
    // What is between bonnet and camera: the dark foot of the windscreen, from side to side.
    let level = camera - cowl + 0.03;
    let wide = half + 0.1;
    let sill = [[aside - wide, level, 0.05], [aside + wide, level, 0.05]];
    let edge = [[aside + wide, level + 0.14, near + 0.02], [aside - wide, level + 0.14, near + 0.02]];
    shape.quad([sill[0], sill[1], edge[0], edge[1]], dark, 0);
    if rng.chance(0.5) {
        // Wipers at the foot of the windscreen.
        for x in [-0.35, 0.25] {
            let at = |dx: f32, up: f32| [aside + x + dx, camera - cowl - up, near - 0.03];
            shape.tube(at(0.0, 0.01), at(0.5, 0.03), [0.008; 2], 4, dark);
        }
    }
    builder.solid.place(&shape.mesh, 0.0, [0.0; 3]);
}
