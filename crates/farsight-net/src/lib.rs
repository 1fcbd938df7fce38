//! The network as data: graph, builders, weights, counts and checkpoint import.
