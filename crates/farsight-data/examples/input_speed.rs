//! How long one core takes from an image file to the network's input: reading and decoding, then warp and normalisation
//! in one pass; what antialiasing costs and changes; and how long the estimate of the noise takes.
//!
//! `cargo run --release -p farsight-data --example input_speed -- IMAGE [WIDTHxHEIGHT] [ROUNDS]`; the image is timed as
//! it is and as a JPEG of quality 95, full colour resolution.
#![allow(clippy::print_stdout)]

use std::error::Error;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use farsight_core::input::{CHANNEL_STD, ChannelOrder, InputRules, Sampling};
use farsight_data::{network_input_into, noise_level, read_image};
use image::codecs::jpeg::JpegEncoder;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let image = PathBuf::from(arguments.first().ok_or("expected an image")?);
    let size = arguments.get(1).map_or("1280x384", String::as_str);
    let (width, height) = size.split_once('x').ok_or("expected WIDTHxHEIGHT")?;
    let rounds = arguments.get(2).map_or(Ok(101), |text| text.parse())?;
    let size = [width.parse()?, height.parse()?];
    let rules = InputRules { size, channels: ChannelOrder::Rgb, sampling: Sampling::PixelExact };

    let jpeg = std::env::temp_dir().join(format!("farsight-input-speed-{}.jpg", std::process::id()));
    JpegEncoder::new_with_quality(File::create(&jpeg)?, 95).encode_image(&read_image(&image)?)?;
    let told = [&image, &jpeg].into_iter().try_for_each(|path| tell(path, &rules, rounds));
    std::fs::remove_file(&jpeg)?;
    told
}

/// Prints median and range of each part.
fn tell(path: &Path, rules: &InputRules, rounds: usize) -> Result<(), Box<dyn Error>> {
    let [mut load, mut input, mut total] = [const { Vec::new() }; 3];
    let mut tensor = Vec::new();
    for _ in 0..rounds {
        let start = Instant::now();
        let image = read_image(path)?;
        load.push(start.elapsed());
        let loaded = Instant::now();
        let affine = rules.whole_image([image.width() as usize, image.height() as usize]);
        network_input_into(&mut tensor, &image, &affine, rules, None);
        std::hint::black_box(&tensor);
        input.push(loaded.elapsed());
        total.push(start.elapsed());
    }
    println!("{}", path.extension().unwrap_or_default().display());
    let image = read_image(path)?;
    let affine = rules.whole_image([image.width() as usize, image.height() as usize]);
    let mut antialiased = Vec::new();
    let antialias = InputRules { sampling: Sampling::Antialias, ..*rules };
    let times = (0..rounds).map(|_| {
        let start = Instant::now();
        network_input_into(&mut antialiased, &image, &affine, &antialias, None);
        start.elapsed()
    });
    let smooth: Vec<Duration> = times.collect();
    let times = (0..rounds).map(|_| {
        let start = Instant::now();
        std::hint::black_box(noise_level(&image));
        start.elapsed()
    });
    let noise: Vec<Duration> = times.collect();
    let parts = [
        ("load", load),
        ("warp and normalise", input),
        ("together", total),
        ("warp with antialias", smooth),
        ("estimate noise", noise),
    ];
    for (name, mut times) in parts {
        times.sort();
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let [fastest, median] = [times[0], times[times.len() / 2]].map(ms);
        println!("  {name:20} median {median:6.2} ms, fastest {fastest:6.2} ms");
    }
    let area = antialiased.len() / CHANNEL_STD.len();
    let change = |k: usize| 255.0 * f64::from((tensor[k] - antialiased[k]) * CHANNEL_STD[k / area]);
    let squares = (0..antialiased.len()).map(|k| change(k).powi(2)).sum::<f64>();
    println!("  antialiasing changes {:.1} of 255, root mean square", (squares / antialiased.len() as f64).sqrt());
    Ok(())
}
