//! Experiments: several arms, several seeds, endpoints that are fixed beforehand, and verdicts.
//!
//! The plan is a TOML file ([`Experiment`]); a cell is one arm with one seed; what came out is a JSON file
//! ([`Results`]) that documents quote. Running cells needs libtorch, everything else does not.

#[cfg_attr(not(feature = "train"), allow(dead_code, reason = "running cells reads the rest"))]
mod metrics;
#[cfg_attr(not(feature = "train"), allow(dead_code, reason = "running cells reads the rest"))]
pub(crate) mod plan;
mod ranger_name;
#[cfg_attr(not(feature = "train"), allow(dead_code, reason = "running cells writes them"))]
pub(crate) mod results;
#[cfg(feature = "train")]
pub(crate) mod statistics;
pub(crate) mod tables;
pub(crate) mod times;

pub(crate) use metrics::Metric;
pub(crate) use plan::{Cell, Experiment};
pub(crate) use ranger_name::RangerName;
pub(crate) use results::Results;
