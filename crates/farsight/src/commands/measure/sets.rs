//! Which data sets are measured, and with which stages of the pipeline.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::{Parser, ValueEnum};
use serde::Deserialize;

use super::MeasureArgs;
use crate::pipeline_args::{EffortName, PrecisionName, RoadArgs, SecondStageArgs};

/// The config of `farsight measure`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sets {
    pub(super) sets: Vec<MeasuredSet>,
}

/// One data set.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MeasuredSet {
    /// What documents call it by.
    pub(super) name: String,
    /// What tables call it.
    pub(super) title: String,
    /// Name of the folder that the command line gives.
    pub(super) folder: String,
    /// A file beside the config, or a name in the folder's `ImageSets`; all frames by default.
    split: Option<PathBuf>,
    /// Whether cars, vans, trucks and trams are one class; figures are then of vehicles.
    #[serde(default)]
    pub(super) vehicles: bool,
    /// Whether its labels have boxes in the image alone; there are no figures of distances then.
    #[serde(default)]
    pub(super) boxes_only: bool,
    /// Options of `farsight eval` about the pipeline.
    #[serde(default)]
    options: Vec<String>,
}

/// What differs from the pipeline that is measured otherwise, as the command line says it.
#[derive(Debug, Parser)]
#[command(no_binary_name = true)]
pub(super) struct Overrides {
    /// Instead of the model that is measured otherwise.
    #[arg(long)]
    pub(super) model: Option<PathBuf>,
    /// Instead of the precision of the others.
    #[arg(long, value_enum)]
    pub(super) precision: Option<PrecisionName>,
    #[command(flatten)]
    pub(super) second_stage: SecondStageArgs,
    #[arg(long, value_enum, default_value_t = EffortName::Normal)]
    pub(super) effort: EffortName,
    #[command(flatten)]
    pub(super) road: RoadArgs,
}

/// An option and its value, where it is not the default.
fn chosen<T: ValueEnum + Default + PartialEq>(option: &str, value: &T) -> Vec<String> {
    let name = value.to_possible_value().filter(|_| *value != T::default());
    name.map_or_else(Vec::new, |name| vec![option.to_owned(), name.get_name().to_owned()])
}

impl Sets {
    /// Reads a config and checks it.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let text = farsight_files::read_config(path).with_context(|| format!("{shown}: cannot be read"))?;
        let sets: Self = toml::from_str(&text).with_context(|| format!("{shown}: not a list of data sets"))?;
        for (i, set) in sets.sets.iter().enumerate() {
            let is_first = sets.sets.iter().position(|other| other.name == set.name) == Some(i);
            ensure!(is_first, "{shown}: two data sets are called \"{}\"", set.name);
            set.overrides().with_context(|| format!("{shown}: {}: options", set.name))?;
        }
        Ok(sets)
    }
}

impl MeasuredSet {
    /// What its options ask for.
    pub(super) fn overrides(&self) -> Result<Overrides> {
        Ok(Overrides::try_parse_from(&self.options)?)
    }

    /// Its split, where the config is in the folder `beside`.
    pub(super) fn split_in(&self, beside: &Path) -> Option<PathBuf> {
        let split = self.split.as_ref()?;
        let file = beside.join(split);
        Some(if file.is_file() { file } else { split.clone() })
    }

    /// The command that gives the same figures, with the folder's name for the folder; the config is in the folder
    /// `beside`.
    pub(super) fn eval_command(&self, beside: &Path, args: &MeasureArgs) -> Result<String> {
        let Overrides { model, precision, .. } = self.overrides()?;
        // Those of its options are named below.
        let model = args.model.as_deref().filter(|_| model.is_none());
        let precision = precision.is_none().then_some(args.engine.precision);
        let split = self.split_in(beside);
        let mut words = vec!["farsight eval --data".to_owned(), self.folder.to_uppercase()];
        let named = |option: &str, path: &Path| [option.to_owned(), path.display().to_string()];
        words.extend(split.iter().flat_map(|split| named("--split", split)));
        words.extend(model.and_then(Path::file_name).into_iter().flat_map(|model| named("--model", Path::new(model))));
        words.extend(self.options.iter().cloned());
        words.extend(chosen("--engine", &args.engine.engine));
        words.extend(precision.into_iter().flat_map(|precision| chosen("--precision", &precision)));
        words.extend(self.vehicles.then(|| "--vehicles".to_owned()));
        Ok(words.join(" "))
    }
}
