//! Throughput: many images, neighbouring ones side by side, as `farsight range` does a folder.

use std::convert::Infallible;
use std::fs;
use std::num::NonZero;
use std::ops::ControlFlow;
use std::path::Path;
use std::thread::available_parallelism;
use std::time::Instant;

use anyhow::Result;
use farsight::{Pipeline, read_image};
use serde::Serialize;

use crate::side_by_side::in_order;

/// Ticks of the clock of `/proc` in a second: Linux tells programs 100 whatever it uses itself.
const TICKS: f64 = 100.0;

/// What came of a stream of images.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Throughput {
    /// Images that were read and looked at; nothing is drawn.
    pub(super) images: usize,
    pub(super) side_by_side: usize,
    pub(super) images_per_s: f64,
    /// How many cores were at work in the mean, where the system tells.
    pub(super) cores_used: Option<f64>,
    /// Processor time of an image, milliseconds, all cores together.
    pub(super) cpu_ms: Option<f64>,
}

/// Reads the image at `path` so often and looks at it.
pub(super) fn throughput(path: &Path, images: usize, pipeline: &Pipeline) -> Result<Throughput> {
    let (cpu_before, start) = (cpu_s(), Instant::now());
    let mut failure = None;
    let look = |_: usize| -> Result<usize> {
        let image = read_image(path)?;
        let camera = super::camera(image.width() as usize, image.height() as usize)?;
        Ok(pipeline.detect(&image, &camera)?.len())
    };
    let Ok(()) = in_order::<_, _, Infallible>(0..images, pipeline.side_by_side(), look, |found| {
        failure = found.err();
        Ok(if failure.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    });
    if let Some(failure) = failure {
        return Err(failure);
    }
    let wall_s = start.elapsed().as_secs_f64();
    let used_s = cpu_before.zip(cpu_s()).map(|(before, after)| after - before);
    Ok(Throughput {
        images,
        side_by_side: pipeline.side_by_side(),
        images_per_s: images as f64 / wall_s,
        cores_used: used_s.map(|used_s| used_s / wall_s),
        cpu_ms: used_s.map(|used_s| 1e3 * used_s / images as f64),
    })
}

/// Cores of this machine, as far as this process may use them.
pub(in crate::commands) fn cores() -> usize {
    available_parallelism().map_or(1, NonZero::get)
}

/// Processor time of this process so far, seconds: Linux tells it in `/proc/self/stat`, in fields 14 and 15.
pub(super) fn cpu_s() -> Option<f64> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    // The name of the program, field 2, may have spaces and ends with the last parenthesis.
    let behind = stat.rsplit_once(')')?.1;
    let ticks = behind.split_whitespace().skip(11).take(2).map(str::parse::<f64>);
    let ticks = ticks.collect::<Result<Vec<f64>, _>>().ok()?;
    (ticks.len() == 2).then(|| ticks.iter().sum::<f64>() / TICKS)
}
