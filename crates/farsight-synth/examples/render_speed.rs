//! Renders a street made by hand a number of times on one thread and says how long a frame takes; writes the picture when told where.
//!
//! `cargo run --release -p farsight-synth --example render_speed -- 10 street.png`
#![allow(missing_docs, clippy::print_stdout)]

#[path = "../tests/support/mod.rs"]
mod support;

use std::time::Instant;

use farsight_synth::render::render;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let frames: usize = arguments.next().map_or(Ok(5), |n| n.parse())?;
    let scene = support::street();
    let triangles: usize = scene.objects.iter().map(|o| o.mesh.triangles.len()).sum();
    let mut times = Vec::new();
    let mut rendered = render(&scene);
    for _ in 0..frames {
        let start = Instant::now();
        rendered = render(&scene);
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    println!("{triangles} triangles: median {:.1} ms, least {:.1} ms", times[times.len() / 2], times[0]);
    if let Some(path) = arguments.next() {
        let bytes = rendered.color.iter().flatten().map(|&c| (c.clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0) as u8);
        let [width, height] = rendered.size.map(|s| s as u32);
        let image = image::RgbImage::from_raw(width, height, bytes.collect()).ok_or("no image")?;
        image.save(path)?;
    }
    Ok(())
}
