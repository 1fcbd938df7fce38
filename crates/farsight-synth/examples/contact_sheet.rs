//! Renders a number of random scenes into one picture, smaller, in rows and columns.
//!
//! `cargo run --release -p farsight-synth --example contact_sheet -- sheet.png SEED FIRST COLUMNS ROWS [WIDTH]
//! [generic]`
#![allow(missing_docs, clippy::print_stdout)]

use std::time::Instant;

use farsight_synth::sensor::SensorModel;
use farsight_synth::{SceneConfig, generate_scene, render};
use image::{RgbImage, imageops};
use rand_pcg::Pcg64;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize, otherwise: u64| arguments.get(index).map_or(Ok(otherwise), |n| n.parse());
    let path = arguments.first().ok_or("where should the picture go?")?;
    let (seed, first) = (number(1, 1)?, number(2, 0)?);
    let (columns, rows, width) = (number(3, 2)? as u32, number(4, 6)? as u32, number(5, 828)? as u32);
    let is_generic = arguments.get(6).is_some_and(|word| word == "generic");
    let config = if is_generic { SceneConfig::generic() } else { SceneConfig::default() };
    let height = if is_generic { width * 9 / 16 } else { width * 375 / 1242 };
    let mut sheet = RgbImage::new(columns * width, rows * height);
    for cell in 0..columns * rows {
        let start = Instant::now();
        let generated = generate_scene(&config, seed, first + u64::from(cell));
        let built = start.elapsed();
        let picture = picture(&generated, first + u64::from(cell));
        let triangles: usize = generated.scene.objects.iter().map(|o| o.mesh.triangles.len()).sum();
        println!(
            "{}: {} objects, {triangles} triangles, built in {:.1} ms, all in {:.0} ms",
            first + u64::from(cell),
            generated.objects.len(),
            built.as_secs_f64() * 1e3,
            start.elapsed().as_secs_f64() * 1e3
        );
        let small = imageops::resize(&picture, width, height, imageops::FilterType::Triangle);
        let (column, row) = (cell % columns, cell / columns);
        imageops::replace(&mut sheet, &small, i64::from(column * width), i64::from(row * height));
    }
    sheet.save(path)?;
    Ok(())
}

fn picture(generated: &farsight_synth::LabelledScene, index: u64) -> RgbImage {
    let rendered = render::render(&generated.scene);
    let mut rng = Pcg64::new(7, u128::from(index));
    SensorModel::sample(&generated.scene.atmosphere, &mut rng).capture(&rendered)
}
