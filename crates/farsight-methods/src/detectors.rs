//! From files to detectors: a file says its method by a tag, and here the tag becomes a detector.

use std::path::{Path, PathBuf};

use farsight_graph::init::initial_weights;
use farsight_graph::model::{FIRST_METHOD, Model, ModelError, method_of};
use farsight_graph::transform::Network;
use farsight_graph::weights::Weights;
use farsight_onnx::{Facts, LocalHeadFile, OnnxError, OnnxModel, OnnxProblem, Target, key};
use farsight_runtime::Runner;

use crate::DETECTORS;
use crate::detector::Detector;
use crate::file::with_own;
use crate::method::{DetectorMethod, Method};

pub use crate::file::{ReadError, config_of, facts_of};

/// What a detector can do with files.
pub(crate) struct Entry {
    tag: &'static str,
    from_weights: FromWeights,
    from_table: fn(toml::Table, Target, &Path) -> Result<Parts, ReadError>,
    make: Make,
    local_head: Option<&'static str>,
}

impl Entry {
    pub(crate) const fn new<C: DetectorMethod>() -> Self {
        Self {
            tag: C::METHOD,
            from_weights: parts_of::<C>,
            from_table: untrained_parts::<C>,
            make: detector_of::<C>,
            local_head: C::LOCAL_HEAD,
        }
    }

    /// That of a tag. Of a tag that is none it is the first method's, whose reader says what was expected.
    fn of(tag: Option<&str>) -> &'static Self {
        DETECTORS.iter().find(|entry| entry.tag == tag.unwrap_or(FIRST_METHOD)).unwrap_or(&DETECTORS[0])
    }
}

/// A network, or a part of one, ready to be started.
pub struct Part {
    /// Its ONNX form, with what the file says.
    pub onnx: OnnxModel,
    /// The network as it was trained, its outputs alone; none of an ONNX file.
    pub trained: Option<Network>,
}

/// The network of a detector.
pub struct DetectorNetwork {
    /// The network, or what of it is before its first sampler.
    pub first: Part,
    /// What comes after each sampler.
    pub later: Vec<Part>,
    entry: &'static Entry,
}

impl DetectorNetwork {
    /// The network without the head that need only be computed at the peaks, and the head, if it has such a one;
    /// `source` is only what errors call it.
    ///
    /// # Errors
    /// When the file is not what its metadata say.
    pub fn local_head(&self, source: &Path) -> Result<Option<LocalHeadFile>, OnnxError> {
        self.entry.local_head.map_or(Ok(None), |name| LocalHeadFile::new(&self.first.onnx, name, source))
    }

    /// The detector, whose network `runner` runs, and `later` its later parts; `head` is what the network that `runner`
    /// runs has left out. `source` is only what errors call it.
    ///
    /// # Errors
    /// When the file's config is none, or a part is missing.
    pub fn detector(
        &self,
        runner: Box<dyn Runner>,
        later: Vec<Box<dyn Runner>>,
        head: Option<&LocalHeadFile>,
        source: &Path,
    ) -> Result<Box<dyn Detector>, OnnxError> {
        (self.entry.make)(Runners { runner, later, head }, &self.first.onnx, source)
    }
}

/// What runs a detector.
struct Runners<'a> {
    runner: Box<dyn Runner>,
    later: Vec<Box<dyn Runner>>,
    head: Option<&'a LocalHeadFile>,
}

/// What becomes of the weights of a model file, in a form and for a target; the path is only what errors call it.
type FromWeights = fn(Weights, NetworkForm, Target, &Path) -> Result<Parts, ReadError>;
type Make = fn(Runners<'_>, &OnnxModel, &Path) -> Result<Box<dyn Detector>, OnnxError>;
type Parts = (Part, Vec<Part>);

/// Under which [`key::PART`] the parts of a network are known, by how many there are.
const PARTS: [&[&str]; 2] = [&["1 of 2", "2 of 2"], &["1 of 3", "2 of 3", "3 of 3"]];

/// The file of the part at this place beside that of the first, whose place is 0.
pub fn part_path(first: &Path, place: usize) -> PathBuf {
    match place {
        0 => first.to_owned(),
        1 => first.with_extension("second.onnx"),
        _ => first.with_extension("third.onnx"),
    }
}

/// In which form a network is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NetworkForm {
    /// As it was trained: the reference.
    AsTrained,
    /// With normalisation folded into the convolutions, as it is run.
    Deployable,
    /// Deployable, in 8 bits with the ranges that the model's file keeps.
    Int8,
}

/// The network of a detector's model file (safetensors) of ours.
///
/// # Errors
/// When the file is none, or broken.
pub fn from_model_file(path: &Path, form: NetworkForm, target: Target) -> Result<DetectorNetwork, ReadError> {
    let weights = Weights::read(path).map_err(ModelError::from)?;
    let entry = Entry::of(Some(method_of(&weights)));
    let (first, later) = (entry.from_weights)(weights, form, target, path)?;
    Ok(DetectorNetwork { first, later, entry })
}

/// The network of `model`; `source` is only what errors call it.
///
/// # Errors
/// When the weights do not fit the network.
pub fn from_model<C: DetectorMethod>(
    model: &Model<C>,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<DetectorNetwork, ReadError> {
    let (first, later) = parts_of_model(model, &facts_of(model, target), form, target, source)?;
    Ok(DetectorNetwork { first, later, entry: Entry::of(Some(C::METHOD)) })
}

/// The same, where the hash of its weights ([`Weights::sha256`]) is known.
///
/// # Errors
/// As [`from_model`].
pub fn from_hashed_model<C: DetectorMethod>(
    model: &Model<C>,
    weights_sha256: &str,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<DetectorNetwork, ReadError> {
    let facts = with_own(Facts::with_hash(model, weights_sha256, target), model);
    let (first, later) = parts_of_model(model, &facts, form, target, source)?;
    Ok(DetectorNetwork { first, later, entry: Entry::of(Some(C::METHOD)) })
}

/// The network that the table `[model]` of a training's config describes, with random weights; `source` is only what
/// errors call it. None of a method that is no detector.
///
/// # Errors
/// When the table describes no network.
pub fn untrained(
    tag: &str,
    table: toml::Table,
    target: Target,
    source: &Path,
) -> Option<Result<DetectorNetwork, ReadError>> {
    let entry = DETECTORS.iter().find(|entry| entry.tag == tag)?;
    let parts = (entry.from_table)(table, target, source);
    Some(parts.map(|(first, later)| DetectorNetwork { first, later, entry }))
}

/// The network of an ONNX file of ours; later parts are read from the files beside it ([`part_path`]).
///
/// # Errors
/// When one of them is missing or of another model, or the file itself is a later part.
pub fn from_onnx(onnx: OnnxModel, path: &Path) -> Result<DetectorNetwork, OnnxError> {
    let later = later_parts(&onnx, path)?;
    Ok(from_parts(onnx, later))
}

/// The network whose parts are in memory.
pub fn from_parts(first: OnnxModel, later: Vec<OnnxModel>) -> DetectorNetwork {
    let entry = Entry::of(first.facts().get(key::METHOD));
    let part = |onnx| Part { onnx, trained: None };
    DetectorNetwork { first: part(first), later: later.into_iter().map(part).collect(), entry }
}

/// The later parts that belong to the first part `onnx`, which is the file `path`; none of a whole network.
fn later_parts(onnx: &OnnxModel, path: &Path) -> Result<Vec<OnnxModel>, OnnxError> {
    let part = |onnx: &OnnxModel| onnx.facts().get(key::PART).map(str::to_owned);
    let Some(found) = part(onnx) else { return Ok(Vec::new()) };
    let Some(names) = PARTS.iter().find(|names| names[0] == found) else {
        // The parts are as many as the first that there is says.
        let names = PARTS.iter().find(|names| names.contains(&found.as_str())).unwrap_or(&PARTS[0]);
        return Err(OnnxError::new(path, OnnxProblem::Part { found, expected: names[0] }));
    };
    let hash = |onnx: &OnnxModel| onnx.facts().get(key::WEIGHTS_SHA256).map(str::to_owned);
    let read = |(place, expected): (usize, &&'static str)| {
        let beside = part_path(path, place);
        let file = OnnxModel::read(&beside)?;
        let found = part(&file).unwrap_or_else(|| "no part".to_owned());
        if found != *expected {
            return Err(OnnxError::new(&beside, OnnxProblem::Part { found, expected }));
        }
        if hash(&file) != hash(onnx) {
            return Err(OnnxError::new(&beside, OnnxProblem::OtherPart(path.to_owned())));
        }
        Ok(file)
    };
    names.iter().enumerate().skip(1).map(read).collect()
}

/// The network of any model of ours that has no parts, in this form; `source` is only what errors call it.
///
/// # Errors
/// When the weights do not fit the network, or its file keeps no ranges for 8 bits.
pub fn in_form<C: Method>(
    model: &Model<C>,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<OnnxModel, ReadError> {
    Ok(parts_of_model(model, &facts_of(model, target), form, target, source)?.0.onnx)
}

fn parts_of<C: Method>(weights: Weights, form: NetworkForm, target: Target, source: &Path) -> Result<Parts, ReadError> {
    let model = Model::<C>::from_weights(weights, source)?;
    parts_of_model(&model, &facts_of(&model, target), form, target, source)
}

/// The parts of a network with random weights.
fn untrained_parts<C: Method>(table: toml::Table, target: Target, source: &Path) -> Result<Parts, ReadError> {
    let bad = |problem: String| ModelError::BadConfig { path: source.to_owned(), problem };
    let config: C = table.try_into().map_err(|error: toml::de::Error| bad(error.to_string()))?;
    if let Some(problem) = config.problem() {
        return Err(bad(problem).into());
    }
    let weights = initial_weights(&config.graph(), 0);
    let model = Model::new(config, weights)?;
    parts_of_model(&model, &facts_of(&model, target), NetworkForm::Deployable, target, source)
}

fn parts_of_model<C: Method>(
    model: &Model<C>,
    facts: &Facts,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<Parts, ReadError> {
    let failed = |error| OnnxError::new(source, OnnxProblem::Weights(error));
    let written = |network: &Network, facts: &Facts| -> Result<OnnxModel, OnnxError> {
        OnnxModel::from_network(network, facts, target, source)
    };
    let networks = Network::new(model).parts(C::OUTPUTS);
    let names = PARTS.into_iter().find(|names| names.len() == networks.len());
    let mut networks = networks.into_iter();
    let Some(first) = networks.next() else { unreachable!("a network has a part") };
    let Some(names) = names else {
        let onnx = match form {
            NetworkForm::Deployable => OnnxModel::from_model(model, facts, target, source)?,
            NetworkForm::Int8 => OnnxModel::from_model_in_int8(model, facts, target, source)?,
            NetworkForm::AsTrained => written(&first, facts)?,
        };
        return Ok((Part { onnx, trained: Some(first) }, Vec::new()));
    };
    let part = |trained: Network, name: &str| -> Result<Part, ReadError> {
        let mut facts = facts.clone();
        facts.set(key::PART, name.to_owned());
        let onnx = match form {
            NetworkForm::Deployable => written(&trained.clone().batch_norm_folded().map_err(failed)?, &facts)?,
            NetworkForm::AsTrained => written(&trained, &facts)?,
            NetworkForm::Int8 => return Err(OnnxError::new(source, OnnxProblem::NoRanges).into()),
        };
        Ok(Part { onnx, trained: Some(trained) })
    };
    let later = networks.zip(&names[1..]).map(|(network, name)| part(network, name)).collect::<Result<_, _>>()?;
    Ok((part(first, names[0])?, later))
}

fn detector_of<C: DetectorMethod>(
    runners: Runners<'_>,
    onnx: &OnnxModel,
    source: &Path,
) -> Result<Box<dyn Detector>, OnnxError> {
    let Runners { runner, later, head } = runners;
    let missing =
        || OnnxError::new(source, OnnxProblem::Part { found: "a whole network".to_owned(), expected: "its parts" });
    config_of::<C>(onnx, source)?.detector(runner, later, head).ok_or_else(missing)
}
