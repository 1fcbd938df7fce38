//! How many augmented training samples a second the loader prepares from a data set, and what they spend their time on.
//!
//! `cargo run --release -p farsight-data --example loader_speed -- --data DIR`, and `--size 1280x384`, `--workers 2`,
//! `--seconds 10`
#![allow(clippy::print_stdout)]

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_data::{
    AugmentationConfig, Dataset, DatasetError, ItemKey, Loader, LoaderConfig, Position, Sample, Transform, open_dataset,
};

/// Frames of which each stage is timed alone.
const BREAKDOWN_FRAMES: usize = 64;

struct Arguments {
    data: String,
    size: [usize; 2],
    workers: usize,
    seconds: u64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = arguments()?;
    let dataset = open_dataset(Path::new(&arguments.data), None)?;
    let rules = InputRules { size: arguments.size, channels: ChannelOrder::Rgb, sampling: Sampling::PixelExact };
    let policy = AugmentationConfig::default();

    println!("{} frames, input {}x{}", dataset.len(), rules.size[0], rules.size[1]);
    breakdown(&*dataset, &policy, &rules)?;
    let rate = samples_per_second(dataset, policy, rules, &arguments)?;
    println!("loader, {} workers: {rate:.1} samples/s", arguments.workers);
    Ok(())
}

/// Each stage on one thread, mean milliseconds a frame.
fn breakdown(dataset: &dyn Dataset, policy: &AugmentationConfig, rules: &InputRules) -> Result<(), DatasetError> {
    let frames = dataset.len().min(BREAKDOWN_FRAMES);
    let mean_ms = |total: Duration| total.as_secs_f64() * 1e3 / frames as f64;
    let [mut decode, mut text, mut augmented, mut plain] = [Duration::ZERO; 4];
    for index in 0..frames {
        let (image, time) = timed(|| dataset.image(index));
        let image = image?;
        decode += time;
        text += timed(|| dataset.camera(index).and_then(|_| dataset.labels(index))).1;
        let size = [image.width() as usize, image.height() as usize];
        let mut rng = ItemKey { epoch: 0, index, seed: 0 }.rng();
        augmented += timed(|| policy.draw(&mut rng, size, rules).input(&image, rules)).1;
        plain += timed(|| Transform::identity(size, rules).input(&image, rules)).1;
    }
    println!("image decode                {:6.2} ms", mean_ms(decode));
    println!("calibration and labels      {:6.2} ms", mean_ms(text));
    println!("warp, jitter and normalise  {:6.2} ms", mean_ms(augmented));
    println!("the same, not augmented     {:6.2} ms", mean_ms(plain));
    Ok(())
}

fn samples_per_second(
    dataset: Arc<dyn Dataset>,
    policy: AugmentationConfig,
    rules: InputRules,
    arguments: &Arguments,
) -> Result<f64, Box<dyn Error>> {
    let config = LoaderConfig {
        items: dataset.len(),
        batch_size: 8,
        seed: 0,
        shuffle: true,
        drop_last: true,
        workers: arguments.workers,
        prefetch: 2,
        start: Position::default(),
        epochs: None,
    };
    let mut loader = Loader::new(&config, move |key| sample(&*dataset, &policy, &rules, key))?;

    let start = Instant::now();
    let mut samples = 0;
    while start.elapsed() < Duration::from_secs(arguments.seconds) {
        let Some(batch) = loader.next() else { break };
        samples += batch?.items.len();
    }
    Ok(samples as f64 / start.elapsed().as_secs_f64())
}

fn sample(
    dataset: &dyn Dataset,
    policy: &AugmentationConfig,
    rules: &InputRules,
    key: ItemKey,
) -> Result<Sample, DatasetError> {
    let frame = dataset.item(key)?;
    Ok(policy.draw(&mut key.rng(), frame.image_size(), rules).apply(&frame, rules))
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, Duration) {
    let start = Instant::now();
    let result = std::hint::black_box(work());
    (result, start.elapsed())
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut arguments = Arguments { data: String::new(), size: [1280, 384], workers: 2, seconds: 10 };
    let mut words = std::env::args().skip(1);
    while let Some(name) = words.next() {
        let value = words.next().ok_or_else(|| format!("{name} needs a value"))?;
        match name.as_str() {
            "--data" => arguments.data = value,
            "--size" => {
                let (width, height) = value.split_once('x').ok_or("--size expects WIDTHxHEIGHT")?;
                arguments.size = [width.parse()?, height.parse()?];
            }
            "--workers" => arguments.workers = value.parse()?,
            "--seconds" => arguments.seconds = value.parse()?,
            _ => return Err(format!("{name} is not known; expected --data, --size, --workers or --seconds").into()),
        }
    }
    if arguments.data.is_empty() {
        return Err("--data is missing; expected the folder of a data set".into());
    }
    Ok(arguments)
}
