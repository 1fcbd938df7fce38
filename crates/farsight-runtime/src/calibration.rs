//! What values the maps of a network take on images, as static quantisation needs it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use farsight_graph::graph::NodeId;
use farsight_graph::quantize::{Histogram, Observer, Range, maps};
use farsight_graph::transform::Network;
use farsight_onnx::{Facts, INPUT, OnnxModel, Target, TensorInfo};

use crate::runner::{Runner, Tensor, TensorView};
use crate::{EngineError, RtenRunner};

/// Runs a network on images and counts the values of every map that could be in 8 bits.
///
/// It is a runner like any other, so a whole pipeline can be calibrated with what it shows to its networks; sharers
/// count together.
///
/// Memory: the maps of one image and about 64 kB a map, for any number of images.
pub struct Calibration {
    runner: Box<dyn Runner>,
    /// The outputs that are asked for come first, the maps follow.
    outputs: Vec<TensorInfo>,
    /// The input's own node, if it is among the maps: it needs no running.
    input: Option<NodeId>,
    /// In the order of the maps, the input last.
    histograms: Arc<Mutex<Vec<(NodeId, Histogram)>>>,
}

impl Calibration {
    /// For `network` in its deployable form, of which `layers` are to be in 8 bits, with the outputs that are asked
    /// for; `facts` are those of its model. It runs on so many threads; `None` takes one for each core.
    ///
    /// # Errors
    /// When rten cannot run the network.
    pub fn new(
        network: &Network,
        layers: &BTreeSet<NodeId>,
        outputs: &[&str],
        facts: &Facts,
        threads: Option<usize>,
    ) -> Result<Self, EngineError> {
        let (input, mut maps): (Vec<NodeId>, Vec<NodeId>) =
            maps(&network.graph, layers).into_iter().partition(|&id| network.graph.nodes[id].inputs.is_empty());
        let names = maps.iter().map(|id| format!("map {id}"));
        let mut tapped = network.clone();
        tapped.graph.taps.retain(|(name, _)| outputs.contains(&name.as_str()));
        let asked = tapped.graph.taps.len();
        tapped.graph.taps.extend(names.zip(maps.iter().copied()));
        let failed = |error: &dyn std::error::Error| EngineError::new("rten", error.to_string());
        let source = Path::new("the network under calibration");
        let file = OnnxModel::from_network(&tapped, facts, Target::Portable, source);
        let runner = RtenRunner::new(file.map_err(|error| failed(&error))?, threads)?;
        let outputs = runner.outputs()[..asked].to_vec();
        let input = input.first().copied();
        maps.extend(input);
        let histograms = maps.into_iter().map(|id| (id, Histogram::default())).collect();
        Ok(Self { runner: Box::new(runner), outputs, input, histograms: Arc::new(Mutex::new(histograms)) })
    }

    /// Counts the values of all maps for one image.
    ///
    /// # Shapes
    /// `[batch, channels, height, width]`.
    ///
    /// # Errors
    /// When rten fails.
    pub fn observe(&mut self, image: TensorView<'_>) -> Result<(), EngineError> {
        self.run(&[(INPUT, image)]).map(|_| ())
    }

    /// The range that `observer` gives each map.
    pub fn ranges(&self, observer: Observer) -> BTreeMap<NodeId, Range> {
        let histograms = self.histograms.lock().unwrap_or_else(PoisonError::into_inner);
        histograms.iter().map(|(id, histogram)| (*id, histogram.range(observer))).collect()
    }

    /// The same network, counting into the same histograms.
    ///
    /// # Errors
    /// When rten fails.
    pub fn try_clone(&self) -> Result<Self, EngineError> {
        let (outputs, histograms) = (self.outputs.clone(), self.histograms.clone());
        Ok(Self { runner: self.runner.share()?, outputs, input: self.input, histograms })
    }
}

impl Runner for Calibration {
    fn engine(&self) -> &str {
        self.runner.engine()
    }

    fn inputs(&self) -> &[TensorInfo] {
        self.runner.inputs()
    }

    fn outputs(&self) -> &[TensorInfo] {
        &self.outputs
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        let mut answers = self.runner.run(inputs)?;
        let maps = answers.split_off(self.outputs.len());
        let mut histograms = self.histograms.lock().unwrap_or_else(PoisonError::into_inner);
        for ((_, histogram), map) in histograms.iter_mut().zip(&maps) {
            histogram.add(&map.values);
        }
        if let (Some(_), Some((_, histogram)), Some((_, image))) = (self.input, histograms.last_mut(), inputs.first()) {
            histogram.add(image.values);
        }
        Ok(answers)
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        Ok(Box::new(self.try_clone()?))
    }
}
