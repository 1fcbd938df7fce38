//! What values the maps of a network take on images, as static quantisation needs it.

use std::collections::BTreeMap;
use std::path::Path;

use farsight_graph::graph::NodeId;
use farsight_graph::quantize::{Histogram, Observer, Range, layers, maps};
use farsight_graph::transform::Network;
use farsight_onnx::{Facts, INPUT, OnnxModel, Target, write};

use crate::runner::{Runner, TensorView};
use crate::{EngineError, RtenRunner};

/// Runs a network on images and counts the values of every map that could be in 8 bits.
///
/// Memory: the maps of one image and about 64 kB a map, for any number of images.
pub struct Calibration {
    runner: RtenRunner,
    /// The input's own node, if it is among the maps: it needs no running.
    input: Option<NodeId>,
    /// In the order of the network's outputs, the input last.
    histograms: Vec<(NodeId, Histogram)>,
}

impl Calibration {
    /// For `network` in its deployable form, of which all that `output` needs is to be in 8 bits; `facts` are those of its model. It runs on so many
    /// threads; `None` takes one for each core.
    ///
    /// # Errors
    /// When rten cannot run the network.
    pub fn new(network: &Network, output: &str, facts: &Facts, threads: Option<usize>) -> Result<Self, EngineError> {
        let (input, mut maps): (Vec<NodeId>, Vec<NodeId>) = maps(&network.graph, &layers(&network.graph, output))
            .into_iter()
            .partition(|&id| network.graph.nodes[id].inputs.is_empty());
        let names = maps.iter().map(|id| format!("map {id}"));
        let mut tapped = network.clone();
        // The maps alone are outputs, in this order.
        tapped.graph.taps = names.zip(maps.iter().copied()).collect();
        let failed = |error: &dyn std::error::Error| EngineError::new("rten", error.to_string());
        let bytes = write(&tapped, facts, Target::Portable).map_err(|error| failed(&error))?;
        let file = OnnxModel::from_bytes(bytes, Path::new("the network under calibration"));
        let runner = RtenRunner::new(file.map_err(|error| failed(&error))?, threads)?;
        let input = input.first().copied();
        maps.extend(input);
        Ok(Self { runner, input, histograms: maps.into_iter().map(|id| (id, Histogram::default())).collect() })
    }

    /// Counts the values of all maps for one image.
    ///
    /// # Shapes
    /// `[batch, channels, height, width]`.
    ///
    /// # Errors
    /// When rten fails.
    pub fn observe(&mut self, image: TensorView<'_>) -> Result<(), EngineError> {
        let maps = self.runner.run(&[(INPUT, image)])?;
        for ((_, histogram), map) in self.histograms.iter_mut().zip(&maps) {
            histogram.add(&map.values);
        }
        if let (Some(_), Some((_, histogram))) = (self.input, self.histograms.last_mut()) {
            histogram.add(image.values);
        }
        Ok(())
    }

    /// The range that `observer` gives each map.
    pub fn ranges(&self, observer: Observer) -> BTreeMap<NodeId, Range> {
        self.histograms.iter().map(|(id, histogram)| (*id, histogram.range(observer))).collect()
    }
}
