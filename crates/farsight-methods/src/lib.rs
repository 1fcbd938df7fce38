//! Methods: one folder each, with all that the method is side by side.
//!
//! A detector's folder ([`smoke`]) has its config, its graph, its targets, its decoder and, under the feature `train`,
//! its loss and its training task. What every detector can do stands in [`detector`]. Those that see whole images are
//! [`network_detector`]s, each with a post-processor of its own; [`ssd`] looks at parts. Detectors with a heatmap of
//! stride 4 share [`center_map`], those whose network is cut at samplers share `cut`. Second stages that look at single
//! objects again ([`refiner`], [`plate_reader`]) are built the same way and share [`roi`]. [`camera_estimator`] says
//! what camera took an image. [`box_mlp`] ranges 2D boxes without a look at the image.

pub mod box_mlp;
pub mod center_map;
mod checks;
mod cut;
pub mod description;
pub mod detector;
#[cfg(feature = "train")]
pub mod detector_task;
pub mod detectors;
mod file;
pub mod input_spec;
pub mod method;
pub mod network_detector;
pub mod patch;
pub mod roi;
#[macro_use]
mod table;
#[cfg(feature = "train")]
mod tensors;
#[cfg(feature = "train")]
pub mod training;

pub use detector::{DetectError, Detector, UnfamiliarCamera};
pub use input_spec::InputSpec;

// A line is all that a method has outside its folder.
methods! {
    detectors {
        smoke: SmokeConfig, SmokeTask;
        centernet3d: CenterNet3dConfig, CenterNet3dTask;
        monodle: MonoDleConfig, MonoDleTask;
        oftnet: OftNetConfig, OftNetTask;
        gs3d: Gs3dConfig, Gs3dTask;
        monogrnet: MonoGrNetConfig, MonoGrNetTask;
        ssd: SsdConfig;
    }
    second_stages {
        refiner: RefinerConfig, RefinerTask;
        plate_reader: PlateReaderConfig, PlateReaderTask;
        camera_estimator: CameraEstimatorConfig, CameraEstimatorTask;
    }
}
