//! The whole pipeline: `cargo run --release --example quickstart -- photo.jpg --hfov 65` prints what is in the photo as
//! JSON.
#![allow(clippy::print_stdout, reason = "the answer of a program")]

use farsight::json::ImageRecord;
use farsight::{Camera, Pipeline, read_image};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, option, hfov_deg] = &arguments[..] else { return Err("expected IMAGE --hfov DEGREES".into()) };
    if option != "--hfov" {
        return Err(format!("{option} is unknown; expected --hfov DEGREES").into());
    }
    let pipeline = Pipeline::shipped()?;
    let image = read_image(path)?;
    let camera = Camera::from_hfov(hfov_deg.parse()?, image.width(), image.height())?;
    let objects = pipeline.detect(&image, &camera)?;
    let record = ImageRecord::new(path, &image, &camera, &objects, &pipeline);
    println!("{}", serde_json::to_string_pretty(&record)?);
    Ok(())
}
