//! Which layers do harm in 8 bits: each tried on its own, then the worst left out until the whole is good enough.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::Result;
use farsight_graph::graph::{NodeId, Op};
use farsight_graph::quantize::{Quantization, Range, WeightRange, layers};
use farsight_graph::transform::Network;
use farsight_methods::smoke::sensitivity::{Answers, Reference, Sensitivity};
use farsight_methods::smoke::{DetectorFile, LOGITS};
use farsight_onnx::{Facts, Target, write_quantized};

use crate::printer::progress_bar;

/// Range of each map.
pub(super) type Ranges = BTreeMap<NodeId, Range>;

/// The answers are good enough when distances and scores change by no more than this together, as a share.
const GOOD: f64 = 0.01;

/// At most so many layers are left in float without being told to: beyond it the time is lost that 8 bits are for.
const MAX_FLOAT: usize = 8;

/// How many layers are listed.
const LISTED: usize = 10;

/// A network that is quantised in several ways.
pub(super) struct Sweep<'a> {
    pub(super) network: &'a Network,
    pub(super) facts: &'a Facts,
    pub(super) ranges: Ranges,
    pub(super) weights: WeightRange,
    pub(super) references: &'a [Reference],
    pub(super) threads: Option<usize>,
}

/// One way to quantise it, and what that does.
pub(super) struct Trial {
    pub(super) quantization: Quantization,
    pub(super) sensitivity: Sensitivity,
}

/// The layers, the one that does the most harm first, with their names.
pub(super) struct Harm(Vec<(NodeId, String, Sensitivity)>);

impl Sweep<'_> {
    /// All layers in 8 bits.
    pub(super) fn everything(&self) -> Result<Trial> {
        self.trial(&layers(&self.network.graph, LOGITS))
    }

    /// Tries each layer on its own.
    pub(super) fn harm_of_layers(&self) -> Result<Harm> {
        let layers = layers(&self.network.graph, LOGITS);
        let bar = progress_bar(layers.len());
        let mut harm = Vec::new();
        for id in layers {
            let Trial { sensitivity, .. } = self.trial(&BTreeSet::from([id]))?;
            harm.push((id, self.name(id), sensitivity));
            bar.inc(1);
        }
        bar.finish_and_clear();
        // What is no number is the worst.
        harm.sort_by(|(_, _, a), (_, _, b)| b.total().total_cmp(&a.total()));
        Ok(Harm(harm))
    }

    /// With the `float` worst layers in float, or with as few as it takes.
    pub(super) fn chosen(&self, harm: &Harm, float: Option<usize>) -> Result<Trial> {
        if let Some(count) = float {
            return self.without_worst(harm, count);
        }
        let mut best = self.without_worst(harm, 0)?;
        for count in 1..=MAX_FLOAT {
            if best.sensitivity.total() <= GOOD {
                break;
            }
            let trial = self.without_worst(harm, count)?;
            // Of what is no number anything is better.
            if trial.sensitivity.total() < best.sensitivity.total() || best.sensitivity.total().is_nan() {
                best = trial;
            }
        }
        Ok(best)
    }

    fn without_worst(&self, harm: &Harm, count: usize) -> Result<Trial> {
        self.trial(&harm.0.iter().skip(count).map(|(id, _, _)| *id).collect())
    }

    /// These layers in 8 bits.
    fn trial(&self, layers: &BTreeSet<NodeId>) -> Result<Trial> {
        let quantization = Quantization::new(&self.network.graph, layers, &self.ranges).with_weights(self.weights);
        let source = Path::new("the quantised network");
        let file = self.file(&quantization, self.facts, Target::Portable, source)?;
        let sensitivity = Answers::new(&file, source, self.threads)?.change(self.references)?;
        Ok(Trial { quantization, sensitivity })
    }

    /// The file; `source` is only what errors call it.
    pub(super) fn file(
        &self,
        quantization: &Quantization,
        facts: &Facts,
        target: Target,
        source: &Path,
    ) -> Result<DetectorFile> {
        let bytes = write_quantized(self.network, quantization, facts, target)?;
        Ok(DetectorFile::from_bytes(bytes, source)?)
    }

    /// Names of the layers that could be in 8 bits and are not.
    pub(super) fn float_layers(&self, quantization: &Quantization) -> Vec<String> {
        let all = layers(&self.network.graph, LOGITS);
        all.into_iter().filter(|&id| !quantization.has_layer(id)).map(|id| self.name(id)).collect()
    }

    /// A layer's name is that of its weight.
    fn name(&self, id: NodeId) -> String {
        let graph = &self.network.graph;
        let (Op::Conv { weight, .. } | Op::UpConv { weight, .. }) = graph.nodes[id].op else {
            return format!("node {id}");
        };
        graph.parameters[weight].name.trim_end_matches(".weight").to_owned()
    }
}

impl Harm {
    /// The worst layers.
    pub(super) fn table(&self) -> Vec<String> {
        let heading = format!("{:<52} {:>10} {:>10}", "in 8 bits alone", "distance", "score");
        let row = |(_, name, sensitivity): &(NodeId, String, Sensitivity)| {
            format!("{name:<52} {:>9.3}% {:>10.5}", 100.0 * sensitivity.distance, sensitivity.score)
        };
        [heading].into_iter().chain(self.0.iter().take(LISTED).map(row)).collect()
    }
}
