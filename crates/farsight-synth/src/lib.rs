//! Procedural traffic scenes rendered to frames with exact labels.
//!
//! A [`scene::Scene`] is triangles, materials, light and air, seen by one camera. The renderer turns it into pixels, depth and instances; the world
//! builder draws scenes at random.

mod actors;
mod dataset;
mod dice;
pub mod labels;
pub mod layout;
mod palette;
pub mod photo;
mod plates;
pub mod render;
pub mod scene;
mod shape;
pub mod sizes;
mod stream;
pub(crate) mod vector;
pub mod world;

pub use dataset::SceneDataset;
pub use layout::scene_from_labels;
pub use stream::{SceneStream, twin};
pub use world::{CameraRanges, PlaceWeights, WeatherWeights, WorldConfig, draw_scene};

/// A scene and who is in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawn {
    /// What the renderer is given.
    pub scene: scene::Scene,
    /// Those in traffic, numbered from 1.
    pub actors: Vec<scene::Actor>,
}
