//! A SMOKE network as an ONNX file: what the file says, and such files read back.

use std::path::Path;

use farsight_core::input::{CHANNEL_MEAN, CHANNEL_STD};
use farsight_onnx::{Facts, OnnxError, OnnxModel, OnnxProblem, Target, is_safetensors, key};
use serde_json::json;

use super::codec::CHANNELS;
use super::network::{LOGITS, REGRESSION};
use super::{SmokeConfig, SmokeModel};
use crate::file::{ReadError, config_of};

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
        for (name, expected) in [(LOGITS, config.classes.len()), (REGRESSION, CHANNELS)] {
            let output = onnx.outputs().iter().find(|output| output.name == name);
            if let Some(found) = output.and_then(|output| output.channels)
                && found != expected
            {
                let problem = OnnxProblem::Channels { name, found: found as u64, expected };
                return Err(OnnxError::new(source, problem));
            }
        }
        Ok(Self { onnx, config })
    }

    /// What is known about `model`, for its ONNX file.
    pub fn facts(model: &SmokeModel, target: Target) -> Facts {
        let config = &model.config;
        let mut facts = Facts::new(model, target);
        let classes: Vec<&str> = config.classes.iter().map(|class| class.class.name()).collect();
        let [width, height] = config.input;
        facts.set(key::CLASSES, classes.join(","));
        facts.set(key::INPUT_SIZE, format!("{width}x{height}"));
        let normalisation = json!({"order": config.quirks.channels, "mean": CHANNEL_MEAN, "std": CHANNEL_STD});
        facts.set(key::NORMALISATION, normalisation.to_string());
        facts.set(key::REFERENCE, json!({"depth": config.depth, "classes": config.classes}).to_string());
        facts
    }
}
