//! `farsight bench --compare`: engines, precisions and efforts in turns in one run.

use std::path::Path;
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use farsight::Pipeline;
use farsight_core::statistics::{quantile, sorted};
use farsight_files::{MeasuredTable, write_atomically};
use serde::Serialize;

use super::stream::{Throughput, cores, cpu_s, throughput};
use super::{BenchArgs, Pass, WARM_UP, pass};
use crate::pipeline_args::{self, EffortName, EngineArgs, EngineName, PipelineArgs, PrecisionName};
use crate::printer::{Printer, counted};

/// Times that each variant has its turn.
const ROUNDS: usize = 5;

/// One way to run the pipeline: `ENGINE[:PRECISION[:EFFORT]]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Variant {
    engine: EngineName,
    precision: PrecisionName,
    effort: EffortName,
}

impl FromStr for Variant {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut words = text.split(':');
        let engine = word(words.next())?.unwrap_or_default();
        let (precision, effort) = (word(words.next())?.unwrap_or_default(), word(words.next())?.unwrap_or_default());
        match words.next() {
            Some(_) => Err("expected ENGINE[:PRECISION[:EFFORT]]".to_owned()),
            None => Ok(Self { engine, precision, effort }),
        }
    }
}

fn word<T: ValueEnum>(word: Option<&str>) -> Result<Option<T>, String> {
    let names = || {
        let names = T::value_variants().iter().filter_map(ValueEnum::to_possible_value);
        names.map(|name| name.get_name().to_owned()).collect::<Vec<_>>().join(", ")
    };
    word.map(|word| T::from_str(word, false).map_err(|_| format!("\"{word}\": expected one of {}", names())))
        .transpose()
}

fn name(value: &impl ValueEnum) -> String {
    value.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
}

impl Variant {
    /// What the user asked for, run so.
    fn pipeline(self, args: &BenchArgs, images: usize, printer: &mut Printer) -> Result<Pipeline> {
        let engine = EngineArgs { engine: self.engine, precision: self.precision, ..args.pipeline.engine.clone() };
        let chosen = PipelineArgs { engine, effort: self.effort, ..args.pipeline.clone() };
        pipeline_args::open(&chosen.builder(printer)?.images(images)).with_context(|| self.to_string())
    }
}

impl std::fmt::Display for Variant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}:{}", name(&self.engine), name(&self.precision), name(&self.effort))
    }
}

/// A variant with its networks, and what was measured.
struct Candidate {
    variant: Variant,
    /// For one image at a time, and for a stream.
    pipelines: [Pipeline; 2],
    rounds: Vec<Round>,
}

/// One turn of a variant.
#[derive(Debug, Clone, Copy, Serialize)]
struct Round {
    /// From the image file to the detections, one image at a time, medians of the runs, milliseconds.
    total_ms: f64,
    detector_ms: f64,
    refine_ms: f64,
    /// Processor time of these runs, for one image.
    cpu_ms: Option<f64>,
    stream: Throughput,
}

/// Figures of a variant.
#[derive(Debug, Serialize)]
struct Row {
    variant: String,
    engine: String,
    precision: String,
    effort: String,
    rounds: Vec<Round>,
}

/// Runs the command.
pub(super) fn run(args: &BenchArgs, image: &Path, printer: &mut Printer) -> Result<()> {
    ensure!(
        args.batch == 1 && args.input.is_none(),
        "--compare times the pipeline as it is; expected no --batch and no --input"
    );
    ensure!(
        args.pipeline.engine.engine_path.is_none(),
        "--compare looks for the libraries of its engines itself (`farsight doctor` says where); expected no --engine-path"
    );
    let mut candidates = Vec::new();
    for &variant in &args.compare {
        let pipelines = [variant.pipeline(args, 1, printer)?, variant.pipeline(args, args.images, printer)?];
        for _ in 0..WARM_UP {
            pass(image, 1, &pipelines[0])?;
        }
        throughput(image, WARM_UP * pipelines[1].side_by_side(), &pipelines[1])?;
        candidates.push(Candidate { variant, pipelines, rounds: Vec::new() });
    }
    for _ in 0..ROUNDS {
        for Candidate { pipelines: [single, many], rounds, .. } in &mut candidates {
            rounds.push(round(args, image, single, many)?);
        }
    }
    let rows: Vec<Row> = candidates.iter().map(row).collect();
    let images = counted(args.images, "image");
    printer.heading(&format!(
        "{}: in turns, {ROUNDS} rounds of {} and a stream of {images}, {}; medians",
        candidates[0].pipelines[0].info().name,
        counted(args.runs, "run"),
        counted(cores(), "core")
    ));
    let table = table(&rows, &command(args));
    let columns: Vec<&str> = table.columns.iter().map(String::as_str).collect();
    for line in &table.markdown(&columns).unwrap_or_default() {
        printer.line(line);
    }
    if let Some(path) = &args.table {
        table.write(path)?;
    }
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&rows)? + "\n";
        write_atomically(path, |file| file.write_all(text.as_bytes()))?;
    }
    Ok(())
}

fn round(args: &BenchArgs, image: &Path, single: &Pipeline, many: &Pipeline) -> Result<Round> {
    let before = cpu_s();
    let passes = (0..args.runs).map(|_| pass(image, 1, single)).collect::<Result<Vec<Pass>>>()?;
    let used_s = before.zip(cpu_s()).map(|(before, after)| after - before);
    let median = |time: fn(&Pass) -> f64| median(passes.iter().map(time));
    Ok(Round {
        total_ms: median(|pass| 1e3 * pass.times.total().as_secs_f64()),
        detector_ms: median(|pass| 1e3 * (pass.times.warp + pass.times.network + pass.times.decode).as_secs_f64()),
        refine_ms: median(|pass| 1e3 * pass.times.refine.as_secs_f64()),
        cpu_ms: used_s.map(|used_s| 1e3 * used_s / args.runs as f64),
        stream: throughput(image, args.images, many)?,
    })
}

fn row(Candidate { variant, rounds, .. }: &Candidate) -> Row {
    Row {
        variant: variant.to_string(),
        engine: name(&variant.engine),
        precision: name(&variant.precision),
        effort: name(&variant.effort),
        rounds: rounds.clone(),
    }
}

pub(in crate::commands) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    quantile(&sorted(values), 0.5)
}

/// The figures as documents quote them. Ratios are medians over the rounds, against the first row.
fn table(rows: &[Row], command: &str) -> MeasuredTable {
    let mut table = MeasuredTable::new(
        command,
        [
            "engine",
            "precision",
            "effort",
            "one image, ms",
            "detector",
            "second stages",
            "a stream, images/s",
            "cores at work",
            "processor time, ms",
            "time of an image of the stream, ratio",
        ],
    );
    for row in rows {
        let of = |value: fn(&Round) -> f64| format!("{:.1}", median(row.rounds.iter().map(value)));
        let told = |value: fn(&Throughput) -> Option<f64>, digits: usize| {
            let values: Option<Vec<f64>> = row.rounds.iter().map(|round| value(&round.stream)).collect();
            values.map_or("-".to_owned(), |values| format!("{:.digits$}", median(values)))
        };
        let ratios = rows[0].rounds.iter().zip(&row.rounds);
        let ratio = median(ratios.map(|(first, own)| first.stream.images_per_s / own.stream.images_per_s));
        table.rows.push(vec![
            row.engine.clone(),
            row.precision.clone(),
            row.effort.clone(),
            of(|round| round.total_ms),
            of(|round| round.detector_ms),
            of(|round| round.refine_ms),
            of(|round| round.stream.images_per_s),
            told(|stream| stream.cores_used, 2),
            told(|stream| stream.cpu_ms, 0),
            format!("{ratio:.2}"),
        ]);
    }
    table
}

/// How this run was asked for, without where its files are written.
fn command(args: &BenchArgs) -> String {
    let variants: Vec<String> = args.compare.iter().map(Variant::to_string).collect();
    let model = args.pipeline.model.as_ref().map_or_else(String::new, |model| format!(" --model {}", model.display()));
    let image = args.image.as_ref().map_or_else(String::new, |image| format!(" --image {}", image.display()));
    let BenchArgs { runs, images, .. } = args;
    format!("farsight bench{model}{image} --runs {runs} --images {images} --compare {}", variants.join(","))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_are_read_and_mistakes_told() {
        let read = |text: &str| text.parse::<Variant>().map(|variant| variant.to_string());
        assert_eq!(read("rten").as_deref(), Ok("rten:f32:normal"));
        assert_eq!(read("openvino:int8:fast").as_deref(), Ok("openvino:int8:fast"));
        assert!(read("tract").unwrap_err().contains("expected one of rten, onnxruntime"));
        assert!(read("rten:f64").unwrap_err().contains("expected one of f32, bf16, int8"));
        assert!(read("rten:f32:best:more").is_err());
    }

    #[test]
    fn ratios_are_of_rounds() {
        let round = |images_per_s: f64| Round {
            total_ms: 10.0,
            detector_ms: 6.0,
            refine_ms: 3.0,
            cpu_ms: None,
            stream: Throughput { images: 8, side_by_side: 2, images_per_s, cores_used: None, cpu_ms: Some(12.4) },
        };
        let row = |rates: [f64; 3]| Row {
            variant: String::new(),
            engine: "rten".to_owned(),
            precision: "f32".to_owned(),
            effort: "normal".to_owned(),
            rounds: rates.map(round).to_vec(),
        };
        // The machine was busy in the second round: the ratio does not show it.
        let table = table(&[row([10.0, 5.0, 10.0]), row([20.0, 10.0, 20.0])], "");
        assert_eq!(table.rows[0][6..], ["10.0", "-", "12", "1.00"]);
        assert_eq!(table.rows[1][6..], ["20.0", "-", "12", "0.50"]);
    }
}
