//! What a run writes down while it learns: one JSON line a record, and the same numbers as TensorBoard events.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use farsight_files::write_quickly;
use prost::Message;
use serde::{Deserialize, Serialize};

use crate::loss::LossTerms;

/// Numbers of one step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Record {
    /// Optimiser steps done.
    pub step: u64,
    /// Epoch of the batch, from 0.
    pub epoch: u64,
    /// Sum of the terms.
    pub loss: f64,
    /// Terms of the loss, means since the record before.
    #[serde(flatten)]
    pub terms: LossTerms,
    /// Learning rate of the step.
    pub learning_rate: f64,
    /// Norm of the gradient before clipping.
    pub gradient_norm: f64,
    /// Images a second since the record before.
    pub samples_per_second: f64,
}

impl Record {
    /// The numbers by the names that TensorBoard shows.
    pub fn scalars(&self) -> impl Iterator<Item = (String, f64)> {
        let terms = self.terms.named().map(|(name, value)| (format!("loss/{name}"), value));
        let others = [
            ("loss/total", self.loss),
            ("train/learning_rate", self.learning_rate),
            ("train/gradient_norm", self.gradient_norm),
            ("train/samples_per_second", self.samples_per_second),
        ];
        terms.into_iter().chain(others.map(|(name, value)| (name.to_owned(), value)))
    }
}

/// The files that records go to.
#[derive(Debug)]
pub struct MetricsWriter {
    lines: File,
    events: EventWriter,
}

impl MetricsWriter {
    /// Opens `metrics.jsonl` and an event file in `folder`. Records after `steps`, of a run that was killed later than its last
    /// checkpoint, are dropped: they will be written again.
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

    /// Writes a record of this step to both files: as a line, and as numbers with names.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(
        &mut self,
        step: u64,
        record: &impl Serialize,
        scalars: impl IntoIterator<Item = (String, f64)>,
    ) -> io::Result<()> {
        let line = serde_json::to_string(record)? + "\n";
        self.lines.write_all(line.as_bytes())?;
        self.events.scalars(step, scalars)
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
