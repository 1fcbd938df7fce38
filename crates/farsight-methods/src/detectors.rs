//! Which methods detect: a file says its method by a tag, and here the tag becomes a detector.

use std::path::{Path, PathBuf};

use farsight_graph::graph::Graph;
use farsight_graph::model::{METHOD_KEY, Model, ModelError, NetworkConfig};
use farsight_graph::transform::Network;
use farsight_graph::weights::Weights;
use farsight_onnx::{Facts, OnnxError, OnnxModel, OnnxProblem, Target, key, write};
use farsight_runtime::Runner;

use crate::Detector;
use crate::centernet3d::CenterNet3dConfig;
use crate::detector::WholeNetwork;
use crate::gs3d::Gs3dConfig;
use crate::monodle::MonoDleConfig;
use crate::oftnet::OftNetConfig;
use crate::ssd::SsdConfig;

pub use crate::file::{ReadError, config_of};

/// What a method of [`METHODS`] can do with files.
struct Method {
    tag: &'static str,
    /// Whether it is trained here.
    is_trained: bool,
    onnx: FromWeights,
    make: Make,
    describe_model: DescribeModel,
    describe_onnx: fn(&OnnxModel, &Path) -> Result<Description, OnnxError>,
    describe_table: fn(toml::Table) -> Result<Description, String>,
}

impl Method {
    const fn new<C: WholeNetwork>(is_trained: bool) -> Self {
        Self {
            tag: C::METHOD,
            is_trained,
            onnx: parts_of::<C>,
            make: detector_of::<C>,
            describe_model: |weights, path| Ok(Description::of_model(&Model::<C>::from_weights(weights, path)?)),
            describe_onnx: |onnx, path| Ok(Description::new(&config_of::<C>(onnx, path)?)),
            describe_table: |table| {
                let config: C = table.try_into().map_err(|error: toml::de::Error| error.to_string())?;
                config.problem().map_or_else(|| Ok(Description::new(&config)), Err)
            },
        }
    }
}

/// The methods. SMOKE has a way of its own ([`crate::smoke::DetectorFile`]): its regression head may be computed at the
/// peaks alone.
const METHODS: [Method; 5] = [
    Method::new::<CenterNet3dConfig>(true),
    Method::new::<MonoDleConfig>(true),
    Method::new::<OftNetConfig>(true),
    Method::new::<Gs3dConfig>(true),
    Method::new::<SsdConfig>(false),
];

/// Tags of the methods listed here that can be trained, in whatever build.
pub fn trained_methods() -> impl Iterator<Item = &'static str> {
    METHODS.iter().filter(|method| method.is_trained).map(|method| method.tag)
}

/// What a model file describes, and what it says of itself.
type DescribeModel = fn(Weights, &Path) -> Result<(Description, Facts), ModelError>;

/// What a config of a detector describes.
pub struct Description {
    /// What such a network is called, with its article.
    pub name: &'static str,
    /// Width and height, pixels, of the input for which multiply-accumulates are counted.
    pub input: [usize; 2],
    /// The network.
    pub graph: Graph,
    /// What there is to tell of it, by name.
    pub facts: Vec<(&'static str, String)>,
}

impl Description {
    fn new<C: WholeNetwork>(config: &C) -> Self {
        Self { name: C::NAME, input: config.counted_input(), graph: config.graph(), facts: config.facts() }
    }

    /// That of a model, and what its file says of itself.
    pub fn of_model<C: WholeNetwork>(model: &Model<C>) -> (Self, Facts) {
        (Self::new(&model.config), Facts::new(model, Target::default()))
    }

    /// That of the table `[model]` of a training's config, if its method is listed here.
    ///
    /// # Errors
    /// What is wrong with the table.
    pub fn of_table(tag: &str, table: toml::Table) -> Option<Result<Self, String>> {
        let method = METHODS.iter().find(|method| method.is_trained && method.tag == tag)?;
        Some((method.describe_table)(table))
    }

    /// That of a model file (safetensors) of ours, and what the file says of itself, if its method is listed here.
    ///
    /// # Errors
    /// When the file is of such a method and broken.
    pub fn of_model_file(path: &Path) -> Result<Option<(Self, Facts)>, ModelError> {
        let Some(method) = method_of_file(path) else { return Ok(None) };
        (method.describe_model)(Weights::read(path)?, path).map(Some)
    }

    /// That of an ONNX file of ours, if its method is listed here; `source` is only what errors call it.
    ///
    /// # Errors
    /// When the file's config is none.
    pub fn of_onnx(onnx: &OnnxModel, source: &Path) -> Result<Option<Self>, OnnxError> {
        let tag = onnx.facts().get(key::METHOD);
        let method = tag.and_then(|tag| METHODS.iter().find(|method| method.tag == tag));
        method.map(|method| (method.describe_onnx)(onnx, source)).transpose()
    }
}

/// The method that a model file says.
fn method_of_file(path: &Path) -> Option<&'static Method> {
    let metadata = Weights::read_metadata(path).unwrap_or_default();
    let tag = metadata.get(METHOD_KEY)?;
    METHODS.iter().find(|method| method.tag == tag)
}

/// A network of such a method, or a part of one, ready to be started.
pub struct Part {
    /// Its ONNX form, with what the file says.
    pub onnx: OnnxModel,
    /// The network as it was trained, its outputs alone; none of an ONNX file.
    pub trained: Option<Network>,
}

/// The network of such a method.
pub struct DetectorNetwork {
    /// The network, or what of it is before its sampler.
    pub first: Part,
    /// What comes after the sampler; none of methods without one.
    pub second: Option<Part>,
    make: Make,
}

impl DetectorNetwork {
    fn new<C: WholeNetwork>(parts: Parts) -> Self {
        let (first, second) = parts;
        Self { first, second, make: detector_of::<C> }
    }

    /// The detector, whose network `runner` runs, and `second` its second part; `source` is only what errors call it.
    ///
    /// # Errors
    /// When the file's config is none, or a part is missing.
    pub fn detector(
        &self,
        runner: Box<dyn Runner>,
        second: Option<Box<dyn Runner>>,
        source: &Path,
    ) -> Result<Box<dyn Detector>, OnnxError> {
        (self.make)(runner, second, &self.first.onnx, source)
    }
}

/// What becomes of the weights of a model file, in a form and for a target; the path is only what errors call it.
type FromWeights = fn(Weights, NetworkForm, Target, &Path) -> Result<Parts, ReadError>;
type Make = fn(Box<dyn Runner>, Option<Box<dyn Runner>>, &OnnxModel, &Path) -> Result<Box<dyn Detector>, OnnxError>;
type Parts = (Part, Option<Part>);

/// Under which [`key::PART`] the first and the second part of a network are known.
const PARTS: [&str; 2] = ["1 of 2", "2 of 2"];

/// The file of the second part beside that of the first.
pub fn second_path(first: &Path) -> PathBuf {
    first.with_extension("second.onnx")
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

/// The network of a model file (safetensors) of ours, if it is of a method that is listed here.
///
/// # Errors
/// When the file is of such a method and broken.
pub fn from_model_file(path: &Path, form: NetworkForm, target: Target) -> Result<Option<DetectorNetwork>, ReadError> {
    let Some(method) = method_of_file(path) else { return Ok(None) };
    let weights = Weights::read(path).map_err(ModelError::from)?;
    let (first, second) = (method.onnx)(weights, form, target, path)?;
    Ok(Some(DetectorNetwork { first, second, make: method.make }))
}

/// The network of `model`; `source` is only what errors call it.
///
/// # Errors
/// When the weights do not fit the network.
pub fn from_model<C: WholeNetwork>(
    model: &Model<C>,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<DetectorNetwork, ReadError> {
    Ok(DetectorNetwork::new::<C>(parts_of_model(model, form, target, source)?))
}

/// The network of an ONNX file of ours, if it is of a method that is listed here; a second part is read from the file
/// beside it ([`second_path`]).
///
/// # Errors
/// When that is missing or of another model, or the file itself is a second part.
pub fn from_onnx(onnx: OnnxModel, path: &Path) -> Result<Option<DetectorNetwork>, OnnxError> {
    let tag = onnx.facts().get(key::METHOD);
    let Some(method) = tag.and_then(|tag| METHODS.iter().find(|method| method.tag == tag)) else { return Ok(None) };
    let second = second_part(&onnx, path)?.map(|onnx| Part { onnx, trained: None });
    Ok(Some(DetectorNetwork { first: Part { onnx, trained: None }, second, make: method.make }))
}

/// The second part that belongs to the first part `onnx`, which is the file `path`; none of a whole network.
fn second_part(onnx: &OnnxModel, path: &Path) -> Result<Option<OnnxModel>, OnnxError> {
    let part = |onnx: &OnnxModel| onnx.facts().get(key::PART).map(str::to_owned);
    let [first, second] = PARTS;
    match part(onnx) {
        None => return Ok(None),
        Some(found) if found == first => {}
        Some(found) => return Err(OnnxError::new(path, OnnxProblem::Part { found, expected: first })),
    }
    let beside = second_path(path);
    let file = OnnxModel::read(&beside)?;
    let found = part(&file).unwrap_or_else(|| "no part".to_owned());
    if found != second {
        return Err(OnnxError::new(&beside, OnnxProblem::Part { found, expected: second }));
    }
    let hash = |onnx: &OnnxModel| onnx.facts().get(key::WEIGHTS_SHA256).map(str::to_owned);
    if hash(&file) != hash(onnx) {
        return Err(OnnxError::new(&beside, OnnxProblem::OtherPart(path.to_owned())));
    }
    Ok(Some(file))
}

/// The network of any model of ours that has no parts, in this form; `source` is only what errors call it.
///
/// # Errors
/// When the weights do not fit the network, or its file keeps no ranges for 8 bits.
pub fn in_form<C: NetworkConfig>(
    model: &Model<C>,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<OnnxModel, ReadError> {
    Ok(parts_of_model(model, form, target, source)?.0.onnx)
}

fn parts_of<C: NetworkConfig>(
    weights: Weights,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<Parts, ReadError> {
    parts_of_model(&Model::<C>::from_weights(weights, source)?, form, target, source)
}

fn parts_of_model<C: NetworkConfig>(
    model: &Model<C>,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<Parts, ReadError> {
    let facts = Facts::new(model, target);
    let failed = |error| OnnxError::new(source, OnnxProblem::Weights(error));
    let written = |network: &Network, facts: &Facts| -> Result<OnnxModel, OnnxError> {
        OnnxModel::from_bytes(write(network, facts, target).map_err(failed)?, source)
    };
    let mut networks = Network::new(model).parts(C::OUTPUTS).into_iter();
    let (Some(first), second) = (networks.next(), networks.next()) else { unreachable!("a network has a part") };
    let Some(second) = second else {
        let onnx = match form {
            NetworkForm::Deployable => OnnxModel::from_model(model, &facts, target, source)?,
            NetworkForm::Int8 => OnnxModel::from_model_in_int8(model, &facts, target, source)?,
            NetworkForm::AsTrained => written(&first, &facts)?,
        };
        return Ok((Part { onnx, trained: Some(first) }, None));
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
    Ok((part(first, PARTS[0])?, Some(part(second, PARTS[1])?)))
}

fn detector_of<C: WholeNetwork>(
    runner: Box<dyn Runner>,
    second: Option<Box<dyn Runner>>,
    onnx: &OnnxModel,
    source: &Path,
) -> Result<Box<dyn Detector>, OnnxError> {
    let missing =
        || OnnxError::new(source, OnnxProblem::Part { found: "a whole network".to_owned(), expected: PARTS[0] });
    config_of::<C>(onnx, source)?.detector(runner, second).ok_or_else(missing)
}
