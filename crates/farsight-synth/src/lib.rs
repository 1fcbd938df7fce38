//! Procedural traffic scenes rendered to frames with exact labels.
//!
//! A [`scene::Scene`] is triangles, materials, light and air, seen by one camera. The renderer turns it into pixels, depth and instances; the world
//! builder draws scenes at random.

pub mod labels;
pub mod photo;
pub mod render;
pub mod scene;
pub(crate) mod vector;
