//! Renders a number of random scenes into one picture, smaller, in rows and columns.
//!
//! `cargo run --release -p farsight-synth --example contact_sheet -- sheet.png SEED FIRST COLUMNS ROWS [WIDTH]
//! [generic | WORLD.toml]`
#![allow(missing_docs, clippy::print_stdout)]

use std::time::Instant;

use farsight_core::Label;
use farsight_synth::{SceneConfig, SceneStream};
use image::{Rgb, RgbImage, imageops};

/// Height of a cell over its width, where images have many shapes.
const CELL: [u32; 2] = [5, 8];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize, otherwise: u64| arguments.get(index).map_or(Ok(otherwise), |n| n.parse());
    let path = arguments.first().ok_or("where should the picture go?")?;
    let (seed, first) = (number(1, 1)?, number(2, 0)?);
    let (columns, rows, width) = (number(3, 2)? as u32, number(4, 6)? as u32, number(5, 828)? as u32);
    let config = match arguments.get(6).map(String::as_str) {
        None => SceneConfig::default(),
        Some("generic") => SceneConfig::generic(),
        Some(file) => toml::from_str(&std::fs::read_to_string(file)?)?,
    };
    let height = if arguments.get(6).is_some() { width * CELL[0] / CELL[1] } else { width * 375 / 1242 };
    let boxes = arguments.get(7).is_some_and(|word| word == "boxes");
    let stream = SceneStream { config, seed };
    let mut sheet = RgbImage::new(columns * width, rows * height);
    for cell in 0..columns * rows {
        let start = Instant::now();
        let frame = stream.frame(first + u64::from(cell));
        println!("{}: {} labels, {:.0} ms", frame.id, frame.labels.len(), start.elapsed().as_secs_f64() * 1e3);
        let mut image = frame.image;
        if boxes {
            frame.labels.iter().for_each(|label| outline(&mut image, label));
        }
        let scale = (f64::from(width) / f64::from(image.width())).min(f64::from(height) / f64::from(image.height()));
        let size = [image.width(), image.height()].map(|side| (f64::from(side) * scale) as u32);
        let small = imageops::resize(&image, size[0], size[1], imageops::FilterType::Triangle);
        let (column, row) = (cell % columns, cell / columns);
        imageops::replace(&mut sheet, &small, i64::from(column * width), i64::from(row * height));
    }
    sheet.save(path)?;
    Ok(())
}

/// Draws a label's 2D box.
fn outline(image: &mut RgbImage, label: &Label) {
    let [x1, y1, x2, y2] = [label.box2d.x1, label.box2d.y1, label.box2d.x2, label.box2d.y2].map(|v| v.max(0.0) as u32);
    let (right, bottom) = (x2.min(image.width() - 1), y2.min(image.height() - 1));
    let color = Rgb(if label.class.name() == "DontCare" { [128, 128, 128] } else { [0, 255, 0] });
    for x in x1..=right {
        image.put_pixel(x, y1.min(bottom), color);
        image.put_pixel(x, bottom, color);
    }
    for y in y1..=bottom {
        image.put_pixel(x1.min(right), y, color);
        image.put_pixel(right, y, color);
    }
}
