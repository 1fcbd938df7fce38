//! What a finished frame costs, step by step, on one thread: the scene, its picture, the sensor, the labels.
//!
//! `cargo run --release -p farsight-synth --example render_speed -- [FRAMES] [SEED] [FOLDER for the images]`
//!
//! Times are of the processor, not of the clock, where the system tells them (Linux): other programs do not spoil them
//! much.
#![allow(missing_docs, clippy::print_stdout)]

use std::path::PathBuf;
use std::sync::LazyLock;
use std::time::Instant;

use farsight_synth::labels::LabelRules;
use farsight_synth::render::render;
use farsight_synth::sensor::SensorModel;
use farsight_synth::{SceneConfig, generate_scene};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

static START: LazyLock<Instant> = LazyLock::new(Instant::now);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let frames: u64 = arguments.next().map_or(Ok(10), |n| n.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(1), |n| n.parse())?;
    let folder = arguments.next().map(PathBuf::from);
    let config = SceneConfig::default();
    let mut times = vec![Vec::new(); 5];
    for index in 0..frames {
        let mut marks = vec![now_ms()];
        let generated = generate_scene(&config, seed, index);
        marks.push(now_ms());
        let rendered = render(&generated.scene);
        marks.push(now_ms());
        let mut rng = Pcg64Mcg::seed_from_u64(seed ^ index);
        let photo = SensorModel::sample(&generated.scene.atmosphere, &mut rng).capture(&rendered);
        marks.push(now_ms());
        let labels = LabelRules::default().labels(&generated.scene, &generated.objects, &rendered);
        marks.push(now_ms());
        let steps: Vec<f64> = marks.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let triangles: usize = generated.scene.objects.iter().map(|o| o.mesh.triangles.len()).sum();
        println!(
            "{index}: {triangles} triangles, {} lamps, {} labels, {steps:.1?} ms",
            generated.scene.lamps.len(),
            labels.len()
        );
        for (all, step) in times.iter_mut().zip(steps.iter().copied().chain([steps.iter().sum()])) {
            all.push(step);
        }
        if let Some(folder) = &folder {
            photo.save(folder.join(format!("{index:06}.png")))?;
        }
    }
    for (name, mut all) in ["scene", "render", "sensor", "labels", "in all"].into_iter().zip(times) {
        all.sort_by(f64::total_cmp);
        let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
        println!("{name}: median {:.1} ms, mean {mean:.1} ms, most {:.1} ms", all[all.len() / 2], all[all.len() - 1]);
    }
    Ok(())
}

/// Time that this thread has run, or that has passed where the system does not tell, milliseconds.
fn now_ms() -> f64 {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split_ascii_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| START.elapsed().as_secs_f64() * 1e3, |ns| ns / 1e6)
}
