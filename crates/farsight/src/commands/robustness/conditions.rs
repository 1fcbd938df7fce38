//! What images are made worse by: corruptions of any images, weather and light of rendered twins.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use farsight_data::kitti::read_split;
use farsight_data::{Corruption, Dataset, open_labelled};

use super::RobustnessArgs;
use crate::commands::synth;
use crate::printer::Printer;

/// One kind of worse images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Condition {
    Corruption(Corruption),
    Weather(Weather),
}

impl Condition {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Corruption(corruption) => corruption.name(),
            Self::Weather(weather) => weather.name(),
        }
    }
}

/// Weather and light that the renderer has severities of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Weather {
    Rain,
    Fog,
    Dusk,
    Night,
}

impl Weather {
    const ALL: [Self; 4] = [Self::Rain, Self::Fog, Self::Dusk, Self::Night];

    /// Its name in scene configs.
    const fn name(self) -> &'static str {
        match self {
            Self::Rain => "rain",
            Self::Fog => "fog",
            Self::Dusk => "dusk",
            Self::Night => "night",
        }
    }
}

/// A corruption of this name.
pub(super) fn corruption(text: &str) -> Result<Corruption, String> {
    let known = Corruption::ALL.into_iter().find(|corruption| corruption.name() == text);
    known.ok_or_else(|| format!("expected one of {}", Corruption::ALL.map(Corruption::name).join(", ")))
}

/// The images as they are, and all that is asked for.
pub(super) fn all(
    args: &RobustnessArgs,
    scratch: &Path,
    printer: &mut Printer,
) -> Result<(Arc<dyn Dataset>, Vec<Condition>)> {
    let nothing_said = args.corruptions.is_empty() && args.weather.is_empty();
    let corruptions = if nothing_said { Corruption::ALL.to_vec() } else { args.corruptions.clone() };
    let mut conditions: Vec<Condition> = corruptions.into_iter().map(Condition::Corruption).collect();
    if let Some(data) = &args.data {
        return Ok((open_labelled(data, args.split.as_deref())?, conditions));
    }
    let weather = if nothing_said { Weather::ALL.to_vec() } else { args.weather.clone() };
    conditions.extend(weather.into_iter().map(Condition::Weather));
    let clear = twins(args, "weather = { clear = 1.0 }\n", &scratch.join("clear"), printer)?;
    Ok((clear, conditions))
}

/// The twins in this weather: the same objects and cameras in the same places.
pub(super) fn rendered(
    args: &RobustnessArgs,
    weather: Weather,
    severity: u8,
    scratch: &Path,
    printer: &mut Printer,
) -> Result<Arc<dyn Dataset>> {
    let world = format!("weather = {{ {} = 1.0 }}\nseverity = {severity}\n", weather.name());
    twins(args, &world, &scratch.join(format!("{}-{severity}", weather.name())), printer)
}

fn twins(args: &RobustnessArgs, world: &str, out: &Path, printer: &mut Printer) -> Result<Arc<dyn Dataset>> {
    let kitti = args.twins.as_deref().context("expected --twins")?;
    let file = out.with_extension("toml");
    fs::write(&file, world).with_context(|| format!("{}: cannot be written", file.display()))?;
    let list = out.with_extension("txt");
    let all = ids(kitti)?;
    ensure!(!all.is_empty(), "{}: no frames", kitti.display());
    let count = args.frames.min(all.len());
    // Evenly over all, whose neighbours are often of one drive.
    let chosen: String = (0..count).map(|at| all[at * all.len() / count].clone() + "\n").collect();
    fs::write(&list, chosen).with_context(|| format!("{}: cannot be written", list.display()))?;
    synth::run(&synth::SynthArgs::twins(out, kitti, &list, args.seed).with_scene_config(&file), printer)?;
    Ok(open_labelled(out, None)?)
}

/// The validation split where there is one, else all label files.
fn ids(kitti: &Path) -> Result<Vec<String>> {
    let split = kitti.join("ImageSets/val.txt");
    if split.is_file() {
        return Ok(read_split(&split)?);
    }
    synth::label_ids(&kitti.join("training/label_2"))
}
