//! What a config, a model file or an ONNX file is of, told without running it: a file says its method by a tag.

use std::path::Path;

use farsight_graph::graph::Graph;
use farsight_graph::model::{FIRST_METHOD, Model, ModelError, method_of};
use farsight_graph::weights::Weights;
use farsight_onnx::{Facts, OnnxError, OnnxModel, Target, key};

use crate::METHODS;
use crate::file::config_of;
use crate::method::Method;

/// What a method says of its files.
pub(crate) struct Entry {
    tag: &'static str,
    is_detector: bool,
    /// Whether it is trained here, in whatever build.
    is_trained: bool,
    of_model: OfModel,
    of_onnx: fn(&OnnxModel, &Path) -> Result<Description, OnnxError>,
    of_table: fn(toml::Table) -> Result<Description, String>,
}

/// What a model file describes, and what it says of itself.
type OfModel = fn(Weights, &Path) -> Result<(Description, Facts), ModelError>;

impl Entry {
    pub(crate) const fn new<C: Method>(is_detector: bool, is_trained: bool) -> Self {
        Self {
            tag: C::METHOD,
            is_detector,
            is_trained,
            of_model: |weights, path| Ok(Description::of_model(&Model::<C>::from_weights(weights, path)?)),
            of_onnx: |onnx, path| Ok(Description::of_config(&config_of::<C>(onnx, path)?)),
            of_table: |table| {
                let config: C = table.try_into().map_err(|error: toml::de::Error| format!("[model]: {error}"))?;
                config.problem().map_or_else(|| Ok(Description::of_config(&config)), Err)
            },
        }
    }

    /// That of a tag. Of a tag that is none it is the first method's, whose reader says what was expected.
    fn of(tag: Option<&str>) -> &'static Self {
        METHODS.iter().find(|entry| entry.tag == tag.unwrap_or(FIRST_METHOD)).unwrap_or(&METHODS[0])
    }
}

/// Tags of the methods that can be trained, in whatever build.
pub fn trained_methods() -> impl Iterator<Item = &'static str> {
    METHODS.iter().filter(|entry| entry.is_trained).map(|entry| entry.tag)
}

/// Whether the method of this tag finds objects in whole images; others look at what was found.
pub fn is_detector(tag: &str) -> bool {
    METHODS.iter().any(|entry| entry.is_detector && entry.tag == tag)
}

/// What a network is, told without running it.
pub struct Description {
    /// Tag of its method.
    pub method: &'static str,
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
    fn of_config<C: Method>(config: &C) -> Self {
        let (input, facts) = (config.counted_input(), config.facts());
        Self { method: C::METHOD, name: C::NAME, input, graph: config.graph(), facts }
    }

    /// That of a model, which may be narrower than its config says, and what its file says of itself.
    pub fn of_model<C: Method>(model: &Model<C>) -> (Self, Facts) {
        let described = Self { graph: model.graph.clone(), ..Self::of_config(&model.config) };
        (described, Facts::new(model, Target::default()))
    }

    /// That of the table `[model]` of a training's config; none of a method that is not trained here.
    ///
    /// # Errors
    /// What is wrong with the table.
    pub fn of_table(tag: &str, table: toml::Table) -> Option<Result<Self, String>> {
        let entry = METHODS.iter().find(|entry| entry.is_trained && entry.tag == tag)?;
        Some((entry.of_table)(table))
    }

    /// That of a model file (safetensors) of ours, and what the file says of itself.
    ///
    /// # Errors
    /// When the file is none, or broken.
    pub fn of_model_file(path: &Path) -> Result<(Self, Facts), ModelError> {
        let weights = Weights::read(path)?;
        let entry = Entry::of(Some(method_of(&weights)));
        (entry.of_model)(weights, path)
    }

    /// That of an ONNX file of ours; `source` is only what errors call it.
    ///
    /// # Errors
    /// When the file's config is none.
    pub fn of_onnx(onnx: &OnnxModel, source: &Path) -> Result<Self, OnnxError> {
        (Entry::of(onnx.facts().get(key::METHOD)).of_onnx)(onnx, source)
    }
}
