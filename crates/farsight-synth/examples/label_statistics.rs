//! What `sizes.rs` and the traffic are made from: sizes, distances, directions and numbers of the objects in a folder
//! of KITTI label files.
//!
//! `cargo run --release -p farsight-synth --example label_statistics -- LABEL_DIR`, or `drawn:COUNT` for the labels of
//! that many random scenes, to compare.
#![allow(missing_docs, clippy::print_stdout)]

use std::path::Path;

use farsight_core::{Label, ObjectClass};
use farsight_data::kitti::read_labels;
use farsight_synth::labels::LabelRules;
use farsight_synth::sizes::PERCENTILES;
use farsight_synth::{SceneConfig, generate_scene, render};
use rayon::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let source = std::env::args().nth(1).ok_or("which folder of labels?")?;
    let frames = match source.strip_prefix("drawn:") {
        Some(count) => drawn(count.parse()?),
        None => read(Path::new(&source))?,
    };
    println!("{} frames", frames.len());
    for class in ObjectClass::KITTI.iter().filter(|class| **class != ObjectClass::DontCare) {
        let objects: Vec<&Label> = frames.iter().flatten().filter(|label| label.class == *class).collect();
        if !objects.is_empty() {
            describe(class, &objects, &frames);
        }
    }
    Ok(())
}

fn read(folder: &Path) -> Result<Vec<Vec<Label>>, Box<dyn std::error::Error>> {
    let mut paths: Vec<_> = std::fs::read_dir(folder)?.map(|e| e.map(|e| e.path())).collect::<Result<_, _>>()?;
    paths.retain(|path| path.extension().is_some_and(|e| e == "txt"));
    paths.sort();
    paths.iter().map(|path| Ok(read_labels(path)?)).collect()
}

fn drawn(count: u64) -> Vec<Vec<Label>> {
    let config = SceneConfig::default();
    let labels = |index| {
        let generated = generate_scene(&config, 1, index);
        LabelRules::default().labels(&generated.scene, &generated.objects, &render::render(&generated.scene))
    };
    (0..count).into_par_iter().map(labels).collect()
}

fn describe(class: &ObjectClass, objects: &[&Label], frames: &[Vec<Label>]) {
    let share = |fits: &dyn Fn(&Label) -> bool| {
        objects.iter().filter(|label| fits(label)).count() as f64 / objects.len() as f64
    };
    let values = |value: fn(&Label) -> f64| objects.iter().map(|label| value(label)).collect::<Vec<f64>>();
    println!("{class}: {}", objects.len());
    spread("  height", values(|l| l.box3d.dimensions.height));
    spread("  width", values(|l| l.box3d.dimensions.width));
    spread("  length", values(|l| l.box3d.dimensions.length));
    let correlation = shared(objects);
    println!("  mean correlation of the three {correlation:.2}, its root {:.2}", correlation.max(0.0).sqrt());
    percentiles("  depth", values(|l| l.box3d.location[2]));
    percentiles("  lateral", values(|l| l.box3d.location[0]));
    percentiles("  bottom", values(|l| l.box3d.location[1]));
    let eighths: Vec<String> = (0..8)
        .map(|k| {
            let low = std::f64::consts::PI * (f64::from(k) / 4.0 - 1.0);
            format!("{:.2}", share(&|l| (low..low + std::f64::consts::FRAC_PI_4).contains(&l.box3d.yaw)))
        })
        .collect();
    println!("  yaw in eighths from -pi: {}", eighths.join(" "));
    let occluded: Vec<String> = (0..4).map(|k| format!("{:.2}", share(&|l| l.occlusion == k))).collect();
    println!("  occlusion 0 to 3: {}; truncated {:.2}", occluded.join(" "), share(&|l| l.truncation > 0.05));
    let counts = frames.iter().map(|frame| frame.iter().filter(|label| label.class == *class).count() as f64);
    let counts: Vec<f64> = counts.collect();
    println!("  per frame {:.2}", counts.iter().sum::<f64>() / counts.len() as f64);
    percentiles("  per frame", counts);
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn deviation(values: &[f64]) -> f64 {
    let center = mean(values);
    (values.iter().map(|v| (v - center) * (v - center)).sum::<f64>() / values.len() as f64).sqrt()
}

fn at(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

fn spread(name: &str, mut values: Vec<f64>) {
    let center = mean(&values);
    values.sort_by(f64::total_cmp);
    let row: Vec<String> = PERCENTILES.iter().map(|percent| format!("{:.2}", at(&values, percent / 100.0))).collect();
    println!("{name}: mean {center:.3}, at {PERCENTILES:?} %: {}", row.join(" "));
}

fn percentiles(name: &str, mut values: Vec<f64>) {
    values.sort_by(f64::total_cmp);
    let row: Vec<String> = [0.05, 0.25, 0.5, 0.75, 0.95].iter().map(|&p| format!("{:.2}", at(&values, p))).collect();
    println!("{name} at 5, 25, 50, 75, 95 %: {}", row.join(" "));
}

/// Mean of the three correlations between height, width and length.
fn shared(objects: &[&Label]) -> f64 {
    let columns: Vec<Vec<f64>> = [0, 1, 2]
        .map(|k| {
            let size = |label: &&Label| {
                let d = label.box3d.dimensions;
                [d.height, d.width, d.length][k]
            };
            objects.iter().map(size).collect()
        })
        .to_vec();
    let correlation = |a: &[f64], b: &[f64]| {
        let (ma, mb) = (mean(a), mean(b));
        let product = a.iter().zip(b).map(|(x, y)| (x - ma) * (y - mb)).sum::<f64>() / a.len() as f64;
        product / (deviation(a) * deviation(b)).max(1e-12)
    };
    let [a, b, c] = [&columns[0], &columns[1], &columns[2]];
    (correlation(a, b) + correlation(a, c) + correlation(b, c)) / 3.0
}
