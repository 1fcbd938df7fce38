//! Renders every kind of object near the camera, at several angles, into one picture.
//!
//! `cargo run --release -p farsight-synth --example showroom -- showroom.png SEED`
#![allow(missing_docs, clippy::print_stdout)]

use farsight_core::{Box2d, Box3d, Camera, Dimensions, Label, ObjectClass};
use farsight_synth::sensor::SensorModel;
use farsight_synth::sizes::SizeStatistics;
use farsight_synth::{SceneConfig, render, scene_from_labels};
use image::{RgbImage, imageops};

const SIZE: [usize; 2] = [1242, 375];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("where should the picture go?")?;
    let seed: u64 = arguments.next().map_or(Ok(1), |n| n.parse())?;
    let camera = Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9)?;
    let rows = [
        (ObjectClass::Car, 9.0, 4.0),
        (ObjectClass::Car, 9.0, 4.0),
        (ObjectClass::Car, 14.0, 5.0),
        (ObjectClass::Van, 12.0, 5.5),
        (ObjectClass::Truck, 22.0, 10.0),
        (ObjectClass::Pedestrian, 6.0, 1.3),
        (ObjectClass::Cyclist, 7.0, 2.2),
        (ObjectClass::Tram, 30.0, 12.0),
    ];
    let mut sheet = RgbImage::new(1242, 375 * rows.len() as u32);
    for (row, (class, z, pitch)) in rows.into_iter().enumerate() {
        let labels: Vec<Label> = (0..5).map(|k| label(class.clone(), k, z, pitch, seed + row as u64)).collect();
        let generated = scene_from_labels(&SceneConfig::default(), &labels, &camera, SIZE, seed * 100 + row as u64);
        let triangles: usize = generated.scene.objects[2..].iter().map(|o| o.mesh.triangles.len()).sum();
        println!("{class}: {} triangles each", triangles / labels.len());
        let rendered = render::render(&generated.scene);
        let picture = SensorModel::IDEAL.capture(&rendered);
        imageops::replace(&mut sheet, &picture, 0, 375 * row as i64);
    }
    sheet.save(path)?;
    Ok(())
}

/// The k-th of five side by side, each turned further.
fn label(class: ObjectClass, k: usize, z: f64, pitch: f64, seed: u64) -> Label {
    let sizes = SizeStatistics::of(&class);
    let vary = |spread: &farsight_synth::sizes::Distribution, step: u64| {
        let share = ((seed * 7 + k as u64 * 5 + step) % 11) as f64 / 10.0 - 0.5;
        spread.at_z_score(2.0 * share)
    };
    let dimensions =
        Dimensions { height: vary(&sizes.height, 1), width: vary(&sizes.width, 2), length: vary(&sizes.length, 3) };
    let yaw = farsight_core::wrapped_angle(-1.4 + 1.1 * k as f64);
    let box3d = Box3d { dimensions, location: [(k as f64 - 2.0) * pitch, 1.65, z], yaw };
    let alpha = box3d.alpha();
    Label { class, truncation: 0.0, occlusion: 0, alpha, box2d: Box2d::new(0.0, 0.0, 1.0, 1.0), box3d }
}
