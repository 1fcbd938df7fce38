//! Builders: small functions that append a part of a network to a graph.

mod builder;
pub mod dla34;
pub mod dla_up;
pub mod msfe;

pub use builder::{Builder, NormKind};
pub use dla_up::{NeckKind, dla_up};
pub use dla34::{Stem, dla34};
pub use msfe::Msfe;
