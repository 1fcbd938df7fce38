//! What a run writes down while it learns: one JSON line a record, and the same numbers as TensorBoard events.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use farsight_files::write_quickly;
use prost::Message;
use serde::{Deserialize, Serialize};

/// The numbers, beside the loss, by which the steps of a task are judged.
pub trait Metrics: Copy + Default + Serialize {
    /// What it learns from, in the plural.
    const SAMPLES: &'static str;

    /// The numbers by name.
    fn named(&self) -> Vec<(&'static str, f64)>;

    /// What `joined` makes of each number of `self` and that of `other`.
    #[must_use]
    fn zip_with(&self, other: &Self, joined: impl Fn(f64, f64) -> f64) -> Self;
}

/// Numbers of one step, or means over the steps since the record before.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Record<T> {
    /// Optimiser steps done.
    pub step: u64,
    /// Epoch of the batch, from 0.
    pub epoch: u64,
    /// What is minimised.
    pub loss: f64,
    /// What else the step is judged by.
    #[serde(flatten)]
    pub metrics: T,
    /// Learning rate of the step.
    pub learning_rate: f64,
    /// Norm of the gradient before clipping.
    pub gradient_norm: f64,
    /// Samples a second since the record before.
    pub samples_per_second: f64,
}

/// A record whose numbers have names instead of a type.
#[derive(Debug, Clone, PartialEq)]
pub struct StepSummary {
    /// Optimiser steps done.
    pub step: u64,
    /// Epoch of the batch, from 0.
    pub epoch: u64,
    /// What is minimised.
    pub loss: f64,
    /// What else the step is judged by.
    pub metrics: Vec<(&'static str, f64)>,
    /// Learning rate of the step.
    pub learning_rate: f64,
    /// Samples a second since the record before.
    pub samples_per_second: f64,
    /// What the samples are, in the plural.
    pub samples: &'static str,
}

impl<T: Metrics> Record<T> {
    /// The same with names.
    pub(crate) fn summary(&self) -> StepSummary {
        let Self { step, epoch, loss, metrics, learning_rate, samples_per_second, .. } = self;
        StepSummary {
            step: *step,
            epoch: *epoch,
            loss: *loss,
            metrics: metrics.named(),
            learning_rate: *learning_rate,
            samples_per_second: *samples_per_second,
            samples: T::SAMPLES,
        }
    }

    /// The numbers by the names that TensorBoard shows.
    fn scalars(&self) -> impl Iterator<Item = (String, f64)> {
        let named = self.metrics.named().into_iter().map(|(name, value)| (format!("loss/{name}"), value));
        let others = [
            ("loss/total", self.loss),
            ("train/learning_rate", self.learning_rate),
            ("train/gradient_norm", self.gradient_norm),
            ("train/samples_per_second", self.samples_per_second),
        ];
        named.chain(others.map(|(name, value)| (name.to_owned(), value)))
    }
}

/// What a step was like.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step<T> {
    pub(crate) loss: f64,
    pub(crate) metrics: T,
    pub(crate) gradient_norm: f64,
    pub(crate) samples: usize,
}

/// Sums over the steps since the last record that was written.
pub(crate) struct Window<T> {
    started: Instant,
    steps: usize,
    sums: Step<T>,
}

impl<T: Metrics> Window<T> {
    pub(crate) fn new() -> Self {
        let sums = Step { loss: 0.0, metrics: T::default(), gradient_norm: 0.0, samples: 0 };
        Self { started: Instant::now(), steps: 0, sums }
    }

    /// Counts `step_output`, and makes a record of it with the speed so far.
    pub(crate) fn add(&mut self, step_output: &Step<T>, step: u64, epoch: u64, learning_rate: f64) -> Record<T> {
        let Step { loss, metrics, gradient_norm, samples } = *step_output;
        self.steps += 1;
        self.sums.loss += loss;
        self.sums.metrics = self.sums.metrics.zip_with(&metrics, |sum, term| sum + term);
        self.sums.gradient_norm += gradient_norm;
        self.sums.samples += samples;
        let samples_per_second = self.samples_per_second();
        Record { step, epoch, loss, metrics, learning_rate, gradient_norm, samples_per_second }
    }

    /// A record of the means, and a new window.
    pub(crate) fn finish(&mut self, step: u64, epoch: u64, learning_rate: f64) -> Record<T> {
        let samples_per_second = self.samples_per_second();
        let Self { steps, sums, .. } = std::mem::replace(self, Self::new());
        let count = steps.max(1) as f64;
        Record {
            step,
            epoch,
            loss: sums.loss / count,
            metrics: sums.metrics.zip_with(&T::default(), |sum, _| sum / count),
            learning_rate,
            gradient_norm: sums.gradient_norm / count,
            samples_per_second,
        }
    }

    fn samples_per_second(&self) -> f64 {
        self.sums.samples as f64 / self.started.elapsed().as_secs_f64()
    }
}

/// The files that records go to.
#[derive(Debug)]
pub struct MetricsWriter {
    lines: File,
    events: EventWriter,
}

impl MetricsWriter {
    /// Opens `metrics.jsonl` and an event file in `folder`. Records after `steps`, of a run that was killed later than
    /// its last checkpoint, are dropped: they will be written again.
    ///
    /// # Errors
    /// When a file cannot be read or written.
    pub fn open(folder: &Path, steps: u64) -> io::Result<Self> {
        #[derive(Deserialize)]
        struct Step {
            step: u64,
        }
        let path = folder.join("metrics.jsonl");
        let before = if path.exists() { fs::read_to_string(&path)? } else { String::new() };
        let kept = |line: &&str| serde_json::from_str::<Step>(line).is_ok_and(|record| record.step <= steps);
        let text: String = before.lines().filter(kept).flat_map(|line| [line, "\n"]).collect();
        write_quickly(&path, |file| file.write_all(text.as_bytes())).map_err(|error| error.source)?;
        let lines = OpenOptions::new().append(true).open(&path)?;
        Ok(Self { lines, events: EventWriter::create(folder, steps)? })
    }

    /// Writes what a validation measured after so many steps to both files.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write_validation(&mut self, step: u64, measured: &[(String, f64)]) -> io::Result<()> {
        let numbers = measured.iter().map(|(name, value)| (name.clone(), serde_json::Value::from(*value)));
        let validation: serde_json::Map<String, serde_json::Value> = numbers.collect();
        let line = serde_json::json!({ "step": step, "validation": validation }).to_string() + "\n";
        self.lines.write_all(line.as_bytes())?;
        self.events.scalars(step, measured.iter().map(|(name, value)| (format!("validation/{name}"), *value)))
    }

    /// Writes a record to both files: as a line, and as numbers with names.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write<T: Metrics>(&mut self, record: &Record<T>) -> io::Result<()> {
        let line = serde_json::to_string(record)? + "\n";
        self.lines.write_all(line.as_bytes())?;
        self.events.scalars(record.step, record.scalars())
    }
}

/// Writes TensorBoard's event files: protocol buffers in checksummed records.
///
/// The crates for this bring an image library of 2021 with them; the part that is needed is this small.
#[derive(Debug)]
struct EventWriter {
    file: File,
}

#[derive(Clone, PartialEq, Message)]
struct Event {
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(string, optional, tag = "3")]
    file_version: Option<String>,
    #[prost(message, optional, tag = "5")]
    summary: Option<Summary>,
}

#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    value: Vec<SummaryValue>,
}

#[derive(Clone, PartialEq, Message)]
struct SummaryValue {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(float, optional, tag = "2")]
    simple_value: Option<f32>,
}

impl EventWriter {
    fn create(folder: &Path, steps: u64) -> io::Result<Self> {
        let name =
            |attempt: u32| PathBuf::from(format!("events.out.tfevents.{}.{steps}.{attempt}", wall_time() as u64));
        let mut attempt = 0;
        let file = loop {
            match OpenOptions::new().write(true).create_new(true).open(folder.join(name(attempt))) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => attempt += 1,
                other => break other?,
            }
        };
        let mut writer = Self { file };
        let version = Some("brain.Event:2".to_owned());
        writer.record(&Event { wall_time: wall_time(), step: 0, file_version: version, summary: None })?;
        Ok(writer)
    }

    fn scalars(&mut self, step: u64, scalars: impl IntoIterator<Item = (String, f64)>) -> io::Result<()> {
        let value =
            scalars.into_iter().map(|(tag, value)| SummaryValue { tag, simple_value: Some(value as f32) }).collect();
        let summary = Some(Summary { value });
        self.record(&Event { wall_time: wall_time(), step: step as i64, file_version: None, summary })
    }

    fn record(&mut self, event: &Event) -> io::Result<()> {
        let body = event.encode_to_vec();
        let length = (body.len() as u64).to_le_bytes();
        let mut record = Vec::with_capacity(body.len() + 16);
        record.extend(length);
        record.extend(masked_checksum(&length).to_le_bytes());
        record.extend(&body);
        record.extend(masked_checksum(&body).to_le_bytes());
        self.file.write_all(&record)
    }
}

/// CRC-32C, turned and shifted as the record format asks.
fn masked_checksum(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

fn wall_time() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |elapsed| elapsed.as_secs_f64())
}
