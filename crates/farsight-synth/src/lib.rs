//! Procedural traffic scenes rendered to frames with exact labels.
//!
//! A [`scene::Scene`] is triangles, materials, light and air, seen by one camera. The renderer turns it into pixels, depth and instances; the world
//! builder draws scenes at random.

mod actors;
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

pub use layout::scene_from_labels;
pub use scene::Drawn;
pub use stream::{SceneStream, twin};
pub use world::{CameraRanges, PlaceWeights, WeatherWeights, WorldConfig, draw_scene};
