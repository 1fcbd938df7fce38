//! Procedural traffic scenes rendered to frames with exact labels.
//!
//! A [`Scene`](scene::Scene) is triangles, materials, light and atmosphere, seen by one camera. [`generate_scene`]
//! makes random ones, [`scene_from_labels`] rebuilds labelled frames, [`render()`](render::render) turns a scene into
//! light, depth and instances, [`SensorModel`](sensor::SensorModel) turns light into an image, and
//! [`LabelRules`](labels::LabelRules) says what a label file would hold. [`SceneStream`] does all of it. The bytes are
//! the same on every machine.
//!
//! | module | what it is for |
//! |---|---|
//! | [`scene`] | the data: what the renderer is given. It knows nothing of how scenes are made |
//! | [`generator`] | random scenes from a [`SceneConfig`]: camera, light, streets, traffic, surroundings |
//! | [`layout`] | scenes around the objects of a label file |
//! | `objects` | meshes of vehicles and people, of a given size |
//! | `mesh_builder`, `palette`, `vector`, `rng` | what meshes, materials and random scenes are built with |
//! | `region` | which vehicles and roads there are in a part of the world: tables |
//! | [`sizes`] | how large objects are: statistics of KITTI's labels |
//! | [`render`] | the rasteriser |
//! | [`sensor`] | what a camera does to light: exposure, blur, noise, tone curve, JPEG |
//! | [`labels`], `plates` | labels and number plates from what the image shows |
//! | `stream` | finished frames, by number |
//! | [`sequence`] | scenes that move, seen by a camera that drives |
//! | `dataset` | these frames as a data set |

mod dataset;
mod device;
pub mod generator;
pub mod labels;
pub mod layout;
mod mesh_builder;
mod objects;
mod palette;
mod plates;
mod region;
pub mod render;
mod rng;
pub mod scene;
pub mod sensor;
pub mod sequence;
pub mod sizes;
mod stream;
pub(crate) mod vector;

pub use dataset::SceneDataset;
pub use generator::{CameraRanges, MAX_IMAGE_PX, PlaceWeights, SceneConfig, WeatherWeights, generate_scene};
pub use layout::scene_from_labels;
pub use region::RegionWeights;
pub use scene::LabelledScene;
pub use sequence::{EgoTruth, Sequence, SequenceFrame, SequenceLayout, SequenceStream, TrackTruth, UnrenderedFrame};
pub use stream::{SceneStream, frame_from_labels};
