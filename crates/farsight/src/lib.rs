//! Distances from one photograph: vehicles and people in an image of a single camera, each with a 3D box, its distance
//! in metres and an error bar.
//!
//! ```
//! # let folder = tempfile::tempdir()?;
//! # std::fs::copy("../../assets/scenes/image_2/000000.jpg", folder.path().join("photo.jpg"))?;
//! # std::env::set_current_dir(&folder)?;
//! let pipeline = farsight::Pipeline::shipped()?;
//! let image = farsight::read_image("photo.jpg")?;
//! let camera = farsight::Camera::from_hfov(65.0, image.width(), image.height())?;
//! for object in pipeline.detect(&image, &camera)? {
//!     println!("{} {:.1} m ±{:.1}", object.class, object.range_m, object.range_sigma_m);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A [`Pipeline`] is everything that `farsight range` does with an image: the detector, the refiner and the plate
//! reader that look again at what it found, suppression of what stands in one place, and the road plane under all of
//! it. [`Pipeline::builder`] chooses model, engine and stages. Clones are cheap, share their weights and can be used by
//! several threads at once. [`CameraSource`] knows the cameras of files, [`ViewSource`] lens and road, too; [`json`]
//! has what `--json` writes; [`draw()`] draws it. [`video`] follows what the pipeline finds through the frames of a
//! video, by a [`Tracker`].
//!
//! Frames of reference are KITTI's: camera coordinates are metres with x right, y down, z forward; an object stands at
//! the centre of its bottom face.

pub mod builder;
pub mod calibrate;
mod camera_estimates;
pub mod camera_source;
pub mod detector;
pub mod draw;
pub mod engine;
mod engine_options;
mod error;
pub mod file_kind;
pub mod json;
pub mod libraries;
mod libtorch;
pub mod model_file;
pub mod object;
pub mod pipeline;
pub mod ranged;
pub mod second_stage;
#[cfg(feature = "serve")]
pub mod service;
pub mod shipped;
pub mod source;
mod stages;
mod together;
pub mod video;
pub mod view;

use std::path::Path;

pub use builder::PipelineBuilder;
pub use calibrate::{CalibrateError, CameraStand, RoadCalibrator};
pub use camera_estimates::CameraEstimates;
pub use camera_source::{CameraSource, CameraSourceError};
pub use draw::{draw, draw_through_lens};
pub use engine_options::{Device, EngineKind, EngineOptions, Precision};
pub use error::Error;
pub use farsight_core::camera::CameraError;
pub use farsight_core::lens::LensError;
pub use farsight_core::road::{HeightConflict, Road, RoadPlane};
pub use farsight_core::{Box2d, Box3d, Camera, Detection, Lens, ObjectClass};
pub use farsight_data::{Exif, ImageError, ImageLimits, LoadedImage, Undistorter};
pub use farsight_methods::camera_estimator::{CameraEstimate, CameraEstimatorModel};
pub use farsight_methods::refiner::Effort;
pub use farsight_methods::{DetectError, UnfamiliarCamera};
pub use farsight_runtime::{EngineError, StageTimes};
pub use farsight_track::{EgoMotion, Frame, Track, TrackError, Tracker, TrackerOptions};
pub use image::RgbImage;
pub use libraries::{Library, LibraryError};
pub use object::{DetectedObject, RangeKind};
pub use pipeline::{ModelInfo, Pipeline, SeenPitches};
pub use ranged::{RangeError, RangedImage};
pub use source::{ModelSource, StageSource};
pub use view::{View, ViewSource};

/// Version of this library and of the program on it.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Reads an image file as 8-bit RGB, upright as viewers show it, whatever its name says.
///
/// [`load_image`] also tells what is odd about the file and what it says of its camera.
///
/// # Errors
/// When the file cannot be read, is no image of a known format, is damaged, or is larger than [`ImageLimits::default`].
pub fn read_image(path: impl AsRef<Path>) -> Result<RgbImage, ImageError> {
    farsight_data::read_image(path.as_ref())
}

/// Reads an image file with its EXIF data, from which [`CameraSource`] may know its camera.
///
/// # Errors
/// As [`read_image`], with these limits.
pub fn load_image(path: impl AsRef<Path>, limits: ImageLimits) -> Result<LoadedImage, ImageError> {
    farsight_data::load_image(path.as_ref(), limits)
}
