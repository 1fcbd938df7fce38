//! Parts of a network, named by how the names of their tensors start: which stay as they are, which start anew, which
//! learn at another rate.

use std::collections::BTreeMap;
use std::path::Path;

use farsight_graph::graph::{Graph, Parameter, Role};
use farsight_graph::weights::Weights;

use crate::error::TrainError;

/// How much of a network came from the file that it started from; the rest starts at random.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Loaded {
    /// Tensors that had a place in the network.
    pub tensors: usize,
    /// Tensors that the network has.
    pub of: usize,
}

/// What is to become of the parts of a network. By default all of it learns alike.
#[derive(Debug, Clone, Default)]
pub struct Parts {
    /// Prefixes of tensors that nothing moves.
    pub freeze: Vec<String>,
    /// Prefixes of tensors that start anew whatever the start weights have. With it, those must have all others.
    pub start_without: Option<Vec<String>>,
    /// Factors on the learning rate by prefix.
    pub rate_factors: BTreeMap<String, f64>,
}

impl Parts {
    /// `graph` with its frozen parameters marked.
    ///
    /// # Errors
    /// When a prefix is that of no parameter, or nothing is left to learn.
    pub fn marked(&self, mut graph: Graph) -> Result<Graph, TrainError> {
        let fields = [
            ("freeze", self.freeze.iter().collect::<Vec<_>>()),
            ("start_without", self.start_without.iter().flatten().collect()),
            ("rate_factors", self.rate_factors.keys().collect()),
        ];
        for (field, prefixes) in fields {
            let is_idle = |prefix: &&&String| !graph.parameters.iter().any(|p| p.name.starts_with(prefix.as_str()));
            if let Some(prefix) = prefixes.iter().find(is_idle) {
                return Err(TrainError::Prefix { field, prefix: (*prefix).clone() });
            }
        }
        for parameter in graph.parameters.iter_mut().filter(|p| p.role != Role::Unused) {
            if starts_with_any(&parameter.name, &self.freeze) {
                parameter.role = Role::Frozen;
            }
        }
        if graph.parameters.iter().any(|p| p.role == Role::Learnt) { Ok(graph) } else { Err(TrainError::AllFrozen) }
    }

    /// `fresh` weights of `graph` with the tensors that are to be taken from `loaded`, which is the file `path`, and
    /// how many those are.
    ///
    /// # Errors
    /// When none has a place in the network, or one is missing that is not to start anew.
    pub fn load_partial(
        &self,
        graph: &Graph,
        mut fresh: Weights,
        mut loaded: Weights,
        path: &Path,
    ) -> Result<(Weights, Loaded), TrainError> {
        let anew = self.start_without.as_deref().unwrap_or_default();
        let mut counts = Loaded { tensors: 0, of: fresh.tensors.len() };
        for parameter in graph.parameters.iter().filter(|p| !starts_with_any(&p.name, anew)) {
            let Parameter { name, shape, role, .. } = parameter;
            match loaded.tensors.remove(name) {
                Some(tensor) if tensor.shape == *shape => {
                    fresh.tensors.insert(name.clone(), tensor);
                    counts.tensors += 1;
                }
                found if self.start_without.is_some() && *role != Role::Unused => {
                    let found = found.map_or("is missing".to_owned(), |tensor| format!("has shape {:?}", tensor.shape));
                    let (name, expected) = (name.clone(), shape.clone());
                    return Err(TrainError::StartTensor { path: path.into(), name, found, expected });
                }
                _ => {}
            }
        }
        fresh.metadata.extend(loaded.metadata);
        if counts.tensors == 0 { Err(TrainError::NothingFits(path.into())) } else { Ok((fresh, counts)) }
    }
}

fn starts_with_any(name: &str, prefixes: &[String]) -> bool {
    prefixes.iter().any(|prefix| name.starts_with(prefix.as_str()))
}
