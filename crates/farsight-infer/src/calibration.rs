//! What values the maps of a network take on images, as static quantisation needs it.

use std::collections::BTreeMap;
use std::path::Path;

use farsight_net::graph::NodeId;
use farsight_net::onnx::{Facts, INPUT, OnnxModel, Target, write};
use farsight_net::quantize::{Histogram, Observer, Range, layers, maps};
use farsight_net::transform::Network;

use crate::EngineError;
use crate::engine::batch_size;
use crate::library::{Failure, unpanicked};
use crate::rten::{NAME, Network as RtenNetwork};

/// Runs a network on images and counts the values of every map that could be in 8 bits.
///
/// Memory: the maps of one image and about 64 kB a map, for any number of images.
pub struct Calibration {
    network: RtenNetwork,
    /// The input's own node, if it is among the maps: it needs no running.
    input: Option<NodeId>,
    /// In the order of the network's outputs, the input last.
    histograms: Vec<(NodeId, Histogram)>,
}

impl Calibration {
    /// For `network` in its deployable form; `facts` are those of its model. It runs on so many threads; `None` takes one for each core.
    ///
    /// # Errors
    /// When rten cannot run the network.
    pub fn new(network: &Network, facts: &Facts, threads: Option<usize>) -> Result<Self, EngineError> {
        let (input, mut maps): (Vec<NodeId>, Vec<NodeId>) = maps(&network.graph, &layers(&network.graph))
            .into_iter()
            .partition(|&id| network.graph.nodes[id].inputs.is_empty());
        let names: Vec<String> = maps.iter().map(|id| format!("map {id}")).collect();
        let mut tapped = network.clone();
        tapped.graph.taps.extend(names.iter().cloned().zip(maps.iter().copied()));
        let network = unpanicked(NAME, || {
            let bytes = write(&tapped, facts, Target::Portable)?;
            let file = OnnxModel::from_bytes(bytes, Path::new("the network under calibration"))?;
            RtenNetwork::new(file.into_bytes(), INPUT, &names, threads)
        })?;
        let input = input.first().copied();
        maps.extend(input);
        Ok(Self { network, input, histograms: maps.into_iter().map(|id| (id, Histogram::default())).collect() })
    }

    /// Counts the values of all maps for one image.
    ///
    /// # Shapes
    /// As for [`crate::Engine::head_maps`].
    ///
    /// # Errors
    /// When rten fails.
    pub fn observe(&mut self, input: &[f32], input_size: [usize; 2]) -> Result<(), EngineError> {
        let values = unpanicked(NAME, || {
            let [width, height] = input_size;
            let maps = self.network.run(input, [batch_size(input, input_size), 3, height, width])?;
            maps.into_iter().map(|map| Ok(map.into_shape_vec::<f32, 4>()?.1)).collect::<Result<Vec<_>, Failure>>()
        })?;
        for ((_, histogram), values) in self.histograms.iter_mut().zip(&values) {
            histogram.add(values);
        }
        if let (Some(_), Some((_, histogram))) = (self.input, self.histograms.last_mut()) {
            histogram.add(input);
        }
        Ok(())
    }

    /// The range that `observer` gives each map.
    pub fn ranges(&self, observer: Observer) -> BTreeMap<NodeId, Range> {
        self.histograms.iter().map(|(id, histogram)| (*id, histogram.range(observer))).collect()
    }
}
