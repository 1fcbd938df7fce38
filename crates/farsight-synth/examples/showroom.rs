//! Renders every kind of object near the camera, at several angles, into one picture.
//!
//! `cargo run --release -p farsight-synth --example showroom -- showroom.png SEED [REGION]`
//!
//! With a region, a row for each kind of vehicle in its table.
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
    if let Some(region) = arguments.next() {
        return kinds(&region, seed, &path);
    }
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

/// Two rows of the table side by side, each kind of vehicle from four sides.
fn kinds(region: &str, seed: u64, path: &str) -> Result<(), Box<dyn std::error::Error>> {
    const CELL: [u32; 2] = [640, 150];
    let file = format!("{}/src/region/tables/{region}.toml", env!("CARGO_MANIFEST_DIR"));
    let table: toml::Table = toml::from_str(&std::fs::read_to_string(file)?)?;
    let config: SceneConfig = toml::from_str(&format!("regions = {{ {region} = 1.0 }}\nunusual_share = 0.0"))?;
    let vehicles = table["vehicles"].as_array().ok_or("no vehicles")?;
    let mut sheet = RgbImage::new(2 * CELL[0], CELL[1] * vehicles.len().div_ceil(2) as u32);
    for (row, kind) in vehicles.iter().enumerate() {
        let median = |name: &str| kind[name][1].as_float().unwrap_or_default();
        let dimensions =
            Dimensions { height: median("height_m"), width: median("width_m"), length: median("length_m") };
        let class = ObjectClass::from_name(kind["class"].as_str().unwrap_or_default());
        let reach = dimensions.length.max(2.2 * dimensions.height);
        let labels: Vec<Label> = [-1.2, 2.6, 0.25, -2.2]
            .into_iter()
            .enumerate()
            .map(|(k, yaw)| {
                let location = [(k as f64 - 1.5) * 1.0 * reach, 1.65, 3.0 + 2.2 * reach];
                let box3d = Box3d { dimensions, location, yaw };
                let (alpha, box2d) = (box3d.alpha(), Box2d::new(0.0, 0.0, 1.0, 1.0));
                Label { class: class.clone(), truncation: 0.0, occlusion: 0, alpha, box2d, box3d }
            })
            .collect();
        let size = CELL.map(|side| side as usize * 2);
        let camera = Camera::from_intrinsics(800.0, 800.0, f64::from(CELL[0]), 140.0)?;
        let generated = scene_from_labels(&config, &labels, &camera, size, seed * 100 + row as u64);
        let picture = SensorModel::IDEAL.capture(&render::render(&generated.scene));
        let small = imageops::resize(&picture, CELL[0], CELL[1], imageops::FilterType::Triangle);
        println!("row {}, column {}: {}", row / 2, row % 2, kind["name"]);
        imageops::replace(
            &mut sheet,
            &small,
            i64::from(CELL[0]) * (row as i64 % 2),
            i64::from(CELL[1]) * (row as i64 / 2),
        );
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
