//! Builders: small functions that append a part of a network to a graph.

mod backbone;
mod builder;
pub mod dla34;
pub mod dla_up;
mod efficientnet_lite;
pub mod fpn;
pub mod inverted_residuals;
pub mod mobilenet_v2;
pub mod msfe;
pub mod resnet;
pub mod vgg;

pub use backbone::Backbone;
pub use builder::{Builder, NormKind};
pub use dla_up::{NeckKind, dla_up};
pub use dla34::{Stem, dla34};
pub use efficientnet_lite::EfficientnetLite;
pub use fpn::fpn;
pub use mobilenet_v2::mobilenet_v2;
pub use msfe::Msfe;
pub use resnet::Resnet;
pub use vgg::vgg16;
