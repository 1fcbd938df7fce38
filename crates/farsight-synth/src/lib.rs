//! Procedural traffic scenes rendered to frames with exact labels.
//!
//! A [`scene::Scene`] is triangles, materials, light and atmosphere, seen by one camera. The renderer turns it into pixels, depth and instances; the world
//! builder draws scenes at random.

pub mod generator;
pub mod labels;
pub mod layout;
mod mesh_builder;
mod objects;
mod palette;
mod plates;
pub mod render;
mod rng;
pub mod scene;
pub mod sensor;
pub mod sizes;
mod stream;
pub(crate) mod vector;

pub use generator::{CameraRanges, PlaceWeights, SceneConfig, WeatherWeights, generate_scene};
pub use layout::scene_from_labels;
pub use scene::LabelledScene;
pub use stream::{SceneStream, frame_from_labels};
