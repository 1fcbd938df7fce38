//! A SMOKE network as an ONNX file: what the file says, and such files read back.

use std::path::Path;

use farsight_core::DepthReference;
use farsight_core::input::{CHANNEL_MEAN, CHANNEL_STD};
use farsight_onnx::{Facts, LocalHeadFile, OnnxError, OnnxModel, OnnxProblem, Target, is_safetensors, key};
use farsight_runtime::Runner;
use serde_json::json;

use super::network::Backbone;
use super::{SmokeConfig, SmokeDetector, SmokeModel, SparseHead};
use crate::detector::Detector;
use crate::file::{ReadError, config_of, facts_of};
use crate::method::{DetectorMethod, Method};

/// The ONNX form of a SMOKE network, and its config.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorFile {
    /// The network.
    pub onnx: OnnxModel,
    /// What it is.
    pub config: SmokeConfig,
}

impl DetectorFile {
    /// Reads a model of either kind: an ONNX file, or a model file of ours (safetensors), which becomes one in memory,
    /// for `target`.
    ///
    /// # Errors
    /// When the file cannot be read or is neither.
    pub fn read(path: &Path, target: Target) -> Result<Self, ReadError> {
        if is_safetensors(path).map_err(|error| OnnxError::new(path, OnnxProblem::Read(error)))? {
            Ok(Self::from_model(&SmokeModel::read(path)?, target, path)?)
        } else {
            Ok(Self::from_onnx(OnnxModel::read(path)?, path)?)
        }
    }

    /// The ONNX form of `model`; `source` is only what errors call it.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub fn from_model(model: &SmokeModel, target: Target, source: &Path) -> Result<Self, OnnxError> {
        let onnx = OnnxModel::from_model(model, &Self::facts(model, target), target, source)?;
        Ok(Self { onnx, config: model.config.clone() })
    }

    /// A file that is in memory already; `source` is only what errors call it.
    ///
    /// # Errors
    /// When the bytes are not a SMOKE network of ours.
    pub fn from_bytes(bytes: Vec<u8>, source: &Path) -> Result<Self, OnnxError> {
        Self::from_onnx(OnnxModel::from_bytes(bytes, source)?, source)
    }

    /// An ONNX file whose config is SMOKE's; `source` is only what errors call it.
    ///
    /// # Errors
    /// When its config is none, or its outputs are not those that the config promises.
    pub fn from_onnx(onnx: OnnxModel, source: &Path) -> Result<Self, OnnxError> {
        let config: SmokeConfig = config_of(&onnx, source)?;
        Ok(Self { onnx, config })
    }

    /// What is known about `model`, for its ONNX file.
    pub fn facts(model: &SmokeModel, target: Target) -> Facts {
        facts_of(model, target)
    }
}

impl Method for SmokeConfig {
    fn counted_input(&self) -> [usize; 2] {
        self.input
    }

    fn facts(&self) -> Vec<(&'static str, String)> {
        let classes: Vec<&str> = self.classes.iter().map(|class| class.class.name()).collect();
        let [width, height] = self.input;
        let [first, second] = match self.backbone {
            Backbone::Dla34 => {
                [("channels", format!("{:?}", self.channels())), ("stem", format!("{:?}", self.stem).to_lowercase())]
            }
            other => [("backbone", other.name().to_owned()), ("neck channels", self.neck_width().to_string())],
        };
        vec![
            ("input", format!("{width} x {height} pixels")),
            ("classes", classes.join(", ")),
            first,
            second,
            ("normalisation", format!("{:?}", self.norm).to_lowercase()),
            ("neck", format!("{:?}", self.neck).to_lowercase()),
            ("MSFE", format!("{:?}", self.msfe).to_lowercase()),
            ("depth", depth(&self.depth)),
        ]
    }

    fn onnx_facts(&self) -> Vec<(&'static str, String)> {
        let classes: Vec<&str> = self.classes.iter().map(|class| class.class.name()).collect();
        let [width, height] = self.input;
        let normalisation = json!({"order": self.quirks.channels, "mean": CHANNEL_MEAN, "std": CHANNEL_STD});
        vec![
            (key::CLASSES, classes.join(",")),
            (key::INPUT_SIZE, format!("{width}x{height}")),
            (key::NORMALISATION, normalisation.to_string()),
            (key::REFERENCE, json!({"depth": self.depth, "classes": self.classes}).to_string()),
        ]
    }
}

fn depth(depth: &DepthReference) -> String {
    let DepthReference { mean_m, std_m, focal_px, error } = depth;
    let focal = focal_px.map_or(String::new(), |px| format!(" at a focal length of {px:.1} pixels of the input"));
    let bars = if error.is_some() { ", with error bars" } else { "" };
    format!("{mean_m:.2} m, give or take {std_m:.2} m{focal}{bars}")
}

impl DetectorMethod for SmokeConfig {
    const NOT_PRUNED: Option<&'static str> = None;

    fn detector(
        self,
        runner: Box<dyn Runner>,
        _: Vec<Box<dyn Runner>>,
        head: Option<&LocalHeadFile>,
    ) -> Option<Box<dyn Detector>> {
        Some(Box::new(SmokeDetector::new(runner, &self, head.map(SparseHead::new))))
    }
}
