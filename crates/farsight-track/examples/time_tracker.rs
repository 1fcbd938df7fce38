//! Times the tracker alone: `cargo run --release -p farsight-track --example time_tracker [OBJECTS] [FRAMES]`.
#![allow(clippy::unwrap_used, reason = "an example")]

#[path = "../tests/street/mod.rs"]
#[allow(dead_code, reason = "made for the tests")]
mod street;

use std::io::Write;
use std::time::Instant;

use farsight_track::{Frame, Tracker};
use street::{Car, Chance, IMAGE_SIZE, camera};

fn main() -> std::io::Result<()> {
    let mut numbers = std::env::args().skip(1).map(|text| text.parse::<u32>());
    let objects = numbers.next().map_or(50, Result::unwrap);
    let frames = numbers.next().map_or(1000, Result::unwrap);
    let (chance, camera) = (&mut Chance::new(1), camera());
    let cars: Vec<Car> = (0..objects)
        .map(|_| {
            let z = chance.between(10.0, 80.0);
            Car::new([z * chance.between(-0.6, 0.6), z], [0.0, 0.0])
        })
        .collect();
    let mut tracker = Tracker::default();
    let mut times_ms = Vec::new();
    let mut told = 0;
    for frame in 0..frames {
        let seen: Vec<_> = cars
            .iter()
            .map(|car| car.seen((0.02 * chance.normal()).exp(), 0.05, (0.01 * chance.normal()).exp()))
            .collect();
        let time_s = f64::from(frame) * 0.1;
        let frame =
            Frame { time_s, image_size: IMAGE_SIZE, camera: &camera, detections: &seen, ego: None, looks_cut: false };
        let start = Instant::now();
        told = tracker.update(&frame).unwrap().len();
        times_ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times_ms.sort_by(f64::total_cmp);
    let at = |share: f64| times_ms[((times_ms.len() - 1) as f64 * share) as usize];
    let (median, most) = (at(0.5), at(0.95));
    writeln!(
        std::io::stdout(),
        "{objects} objects, {frames} frames, {told} tracks at the end: median {median:.3} ms, 95% {most:.3} ms a frame"
    )
}
