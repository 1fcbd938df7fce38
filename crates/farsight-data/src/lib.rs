//! Data sets, image loading, warping, augmentation and a prefetching loader.
//!
//! A [`Dataset`] gives [`Frame`]s: images with camera, labels and [`annotations`]. A random policy
//! ([`AugmentationConfig`]) draws a fixed [`Transform`], which moves image, camera and labels together and makes a
//! [`Sample`] of them: the network's input with its own camera and labels. A [`Loader`] prepares samples on several
//! threads, in the same order and with the same content for any number of threads. KITTI's files are read and written
//! in [`kitti`].

pub mod annotations;
pub mod augment;
pub mod class_map;
pub mod color_jitter;
pub mod corruption;
pub mod dataset;
pub mod degradation;
pub mod denoise;
pub mod exif;
pub mod formats;
pub mod frame;
pub mod image_io;
pub mod kitti;
pub mod loader;
pub mod noise_mask;
pub mod reflections;
pub mod shadow;
pub mod sharpness;
pub mod transform;
pub mod undistort;
pub mod warp;

pub use augment::AugmentationConfig;
pub use class_map::{ClassMap, ClassMapError};
pub use color_jitter::ColorJitter;
pub use corruption::{CorruptedDataset, Corruption};
pub use dataset::{CachedDataset, Dataset, DatasetError, ImageFolder, MemoryDataset};
pub use degradation::Degradation;
pub use denoise::{denoised, noise_level};
pub use exif::{Exif, FocalFromExif, FocalProblem, focal};
pub use formats::{open_dataset, open_labelled};
pub use frame::Frame;
pub use image_io::{
    IMAGE_FORMATS, ImageError, ImageHeader, ImageLimits, ImageWarning, LoadedImage, UnsupportedFormat, decode_image,
    has_image_extension, image_named, load_image, read_header, read_image,
};
pub use kitti::KittiDataset;
pub use loader::{Batch, ItemError, ItemKey, Loader, LoaderConfig, LoaderError, Position};
pub use noise_mask::NoiseMask;
pub use reflections::Reflections;
pub use shadow::Shadow;
pub use sharpness::Sharpness;
pub use transform::{Sample, Transform};
pub use undistort::Undistorter;
pub use warp::{network_input, network_input_in, network_input_into, warp};
