//! Ranges of a network's maps as they stand in the header of its model file.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::{Quantization, Range, layers};
use crate::graph::{Graph, NodeId, Op};

/// Key of the header under which the ranges stand as JSON.
pub const RANGES_KEY: &str = "farsight.ranges";

/// What values the maps of a network take, measured on images: all that 8 bits need beside the weights.
///
/// Maps are known by their places in the deployable form of the network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredRanges {
    /// Nodes of that form: of another number these are the ranges of another network.
    nodes: usize,
    /// Lowest and highest value by place.
    maps: BTreeMap<NodeId, [f32; 2]>,
}

impl StoredRanges {
    /// The ranges of the maps of `graph`.
    pub fn new(graph: &Graph, ranges: &BTreeMap<NodeId, Range>) -> Self {
        Self { nodes: graph.nodes.len(), maps: ranges.iter().map(|(id, range)| (*id, range.ends())).collect() }
    }

    /// Those of a model file with this header; none where it has none that can be read.
    pub fn of_header(metadata: &BTreeMap<String, String>) -> Option<Self> {
        serde_json::from_str(metadata.get(RANGES_KEY)?).ok()
    }

    /// As they stand in the header.
    pub fn to_text(&self) -> String {
        serde_json::json!(self).to_string()
    }

    /// What of `graph` is in 8 bits: all that [`layers_of`] has. None where these are not its ranges.
    pub fn quantization(&self, graph: &Graph, outputs: &[&str]) -> Option<Quantization> {
        let fits = self.nodes == graph.nodes.len() && self.maps.keys().all(|id| *id < self.nodes);
        let ranges = self.maps.iter().map(|(id, [low, high])| (*id, Range::new(*low, *high))).collect();
        fits.then(|| Quantization::new(graph, &layers_of(graph, outputs), &ranges))
    }
}

/// The convolutions that can compute in 8 bits of a network with several outputs ([`layers`]): not the last ones, whose
/// answers are what is read, be they an output or joined to one.
pub fn layers_of(graph: &Graph, outputs: &[&str]) -> BTreeSet<NodeId> {
    let mut found: BTreeSet<NodeId> = outputs.iter().flat_map(|output| layers(graph, output)).collect();
    let mut last: Vec<NodeId> = outputs.iter().filter_map(|output| graph.tap(output)).collect();
    while let Some(id) = last.pop() {
        found.remove(&id);
        if graph.nodes[id].op == Op::Concat {
            last.extend(&graph.nodes[id].inputs);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::super::{Range, layers, maps};
    use super::{RANGES_KEY, StoredRanges, layers_of};
    use crate::graph::{Graph, Window};
    use crate::layers::{Builder, NormKind};

    /// A convolution of the image, one of its answer, and two outputs of that: one alone, one joined of two.
    fn graph() -> Graph {
        let mut b = Builder::new(NormKind::Batch);
        let image = b.input(3);
        let x = b.conv(image, "first", 8, Window::same(3, 1));
        let x = b.relu(x);
        let x = b.conv(x, "second", 8, Window::same(3, 1));
        let x = b.relu(x);
        let [alone, one, other] = ["alone", "one", "other"].map(|name| b.conv_with_bias(x, name, 4, 1, None));
        b.tap("a", alone);
        let joined = b.concat(&[one, other]);
        b.tap("b", joined);
        b.finish()
    }

    #[test]
    fn what_is_read_stays_in_float() {
        let graph = graph();
        let found = layers_of(&graph, &["a", "b"]);
        // The first reads the image, the three last are answers.
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(layers(&graph, "a").is_superset(&found));
    }

    #[test]
    fn ranges_go_through_a_header_and_fit_one_network() {
        let graph = graph();
        let layers = layers_of(&graph, &["a", "b"]);
        let ranges: BTreeMap<_, _> = maps(&graph, &layers).into_iter().map(|id| (id, Range::new(0.0, 3.0))).collect();
        let stored = StoredRanges::new(&graph, &ranges);
        let header = BTreeMap::from([(RANGES_KEY.to_owned(), stored.to_text())]);
        let read = StoredRanges::of_header(&header).unwrap();
        assert_eq!(read, stored);
        assert_eq!(read.quantization(&graph, &["a", "b"]).unwrap().layer_count(), 1);
        let other = Builder::new(NormKind::Batch).finish();
        assert_eq!(read.quantization(&other, &["a"]), None);
        let broken = BTreeMap::from([(RANGES_KEY.to_owned(), "{}".to_owned())]);
        assert_eq!(StoredRanges::of_header(&broken), None);
        assert_eq!(StoredRanges::of_header(&BTreeMap::new()), None);
    }
}
