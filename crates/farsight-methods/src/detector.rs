//! What every detector can do, whatever its method.

use farsight_core::detection::DecodeOptions;
use farsight_core::{Camera, ClassReference, Detection, ObjectClass};
use farsight_runtime::{EngineError, StageTimes};
use image::RgbImage;
use thiserror::Error;

/// A model ready to run on images, without second stages.
pub trait Detector: Send {
    /// Tag of its method.
    fn method(&self) -> &'static str;

    /// Name of the engine that runs it.
    fn engine(&self) -> &str;

    /// The classes that it knows.
    fn classes(&self) -> &[ClassReference];

    /// Whether what it finds has error bars.
    fn has_error_bars(&self) -> bool;

    /// Whether it measures distances; one that finds boxes in the image alone guesses them by the usual size of a
    /// class.
    fn measures_distances(&self) -> bool {
        true
    }

    /// Width and height, pixels, of the network's input for an image of `image_size` taken by `camera`.
    fn input_size(&self, image_size: [usize; 2], camera: &Camera) -> [usize; 2];

    /// Looks at all images with an input of this width and height, whatever their cameras: to time it. Whether it can.
    fn set_input_size(&mut self, size: [usize; 2]) -> bool {
        let _ = size;
        false
    }

    /// What to tell the user of `camera` (of an image of `image_size`), if the model never saw one like it.
    fn unfamiliar(&self, image_size: [usize; 2], camera: &Camera) -> Option<UnfamiliarCamera>;

    /// What is in each image, highest score first, and the time of each stage for all of them. The engine sees the
    /// images together, so they must need inputs of one size ([`Detector::input_size`]).
    ///
    /// Locations are in the camera's coordinates, metres, 2D boxes in pixels of the image.
    ///
    /// # Errors
    /// When an image has no pixels, the sizes differ, the engine fails, or its answer does not fit the model.
    fn detect_batch(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        options: &DecodeOptions,
    ) -> Result<(Vec<Vec<Detection>>, StageTimes), DetectError>;

    /// The same detector for another thread; weights are shared where the engine can.
    ///
    /// # Errors
    /// When the engine fails.
    fn share(&self) -> Result<Box<dyn Detector>, EngineError>;
}

/// An image for which there is no answer.
#[derive(Debug, Error)]
pub enum DetectError {
    /// The image has no pixels.
    #[error("the image is {width} x {height} pixels; expected at least one pixel")]
    Empty {
        /// Its width, pixels.
        width: u32,
        /// Its height, pixels.
        height: u32,
    },
    /// The image is not of the size that its lens was prepared for.
    #[error("the image is {found:?} pixels; its lens was prepared for {expected:?}")]
    ImageSize {
        /// Width and height.
        found: [u32; 2],
        /// Width and height of the images that were expected.
        expected: [u32; 2],
    },
    /// The images of a batch need inputs of different sizes.
    #[error("image {index} of the batch needs an input of {found:?} pixels; the first one needs {expected:?}")]
    InputSize {
        /// Its place in the batch, from 0.
        index: usize,
        /// Width and height of its input.
        found: [usize; 2],
        /// Width and height of the first one's.
        expected: [usize; 2],
    },
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// An object is where no camera sees one, or larger than anything there is.
    #[error(
        "{model}: its answer has a {class} at {location:?} m with sides of {dimensions:?} m; expected at most {limit} m: are the weights broken?"
    )]
    Absurd {
        /// The model.
        model: String,
        /// Class of the object.
        class: ObjectClass,
        /// Where it is, camera coordinates, metres.
        location: [f64; 3],
        /// Length, height and width, metres.
        dimensions: [f64; 3],
        /// The largest number that is believed, metres.
        limit: f64,
    },
    /// A number where something is found is larger than any that a sound network says.
    #[error("{model}: output \"{output}\" has {value}; expected at most {limit}: are the weights broken?")]
    Value {
        /// The model.
        model: String,
        /// The output.
        output: &'static str,
        /// The number.
        value: f64,
        /// The largest that is believed.
        limit: f64,
    },
    /// The engine's answer does not fit the model's description.
    #[error("the engine {engine} gave \"{map}\" of the shape {found:?}; expected {expected:?}")]
    Maps {
        /// Name of the engine.
        engine: String,
        /// The output.
        map: String,
        /// Its shape.
        found: Vec<usize>,
        /// The shape that the model has: images, channels, rows, columns.
        expected: [usize; 4],
    },
}

impl DetectError {
    /// The same error, which calls the model so.
    #[must_use]
    pub fn of_model(mut self, name: &str) -> Self {
        if let Self::Absurd { model, .. } | Self::Value { model, .. } = &mut self {
            name.clone_into(model);
        }
        self
    }
}

/// A camera unlike those that a model was trained with: its distances are not to be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum UnfamiliarCamera {
    /// It looks past its own image.
    #[error(
        "the camera's principal point ({:.0}, {:.0}) lies outside the image of {} x {} pixels, so distances are a guess; is it the camera of another image?",
        center_px[0],
        center_px[1],
        image_size[0],
        image_size[1]
    )]
    Center {
        /// Its principal point (column and row), pixels.
        center_px: [f64; 2],
        /// Width and height of the image, pixels.
        image_size: [usize; 2],
    },
    /// It stands far from where its coordinates begin.
    #[error(
        "the camera stands {offset_m:.3} m from the origin of its coordinates (fourth column of the projection; KITTI's 0.06 m), so all places are off by that; is the column in metres times pixels?"
    )]
    Offset {
        /// How far, metres.
        offset_m: f64,
    },
    /// Its pixels are no squares.
    #[error("the camera's focal lengths are {} and {} pixels; in photographs they are nearly the same, so distances are a guess", focals_px[0].round(), focals_px[1].round())]
    Stretched {
        /// Across and down, pixels.
        focals_px: [f64; 2],
    },
    /// It sees more or less across.
    #[error(
        "the camera sees {hfov_deg:.0} degrees across; the model was trained with {} to {}, so its distances are a guess",
        range_deg[0],
        range_deg[1]
    )]
    Wide {
        /// What it sees across, degrees.
        hfov_deg: f64,
        /// The least and the most that the model was trained with.
        range_deg: [f64; 2],
    },
    /// Its focal length is that of no camera of such an image.
    #[error(
        "the camera's focal length is {focal_px:.1} pixels for an image {width_px} pixels wide, {hfov_deg:.2} degrees across, so distances are a guess; is it the camera of another image?"
    )]
    Field {
        /// Across, pixels.
        focal_px: f64,
        /// Of the image, pixels.
        width_px: usize,
        /// What it sees across, degrees.
        hfov_deg: f64,
    },
    /// It sees much more or much less of the world.
    #[error(
        "the camera's focal length is {focal_px:.0} pixels of the network's input; the model was trained with {} to {}, so its distances are a guess",
        range_px[0],
        range_px[1]
    )]
    Focal {
        /// Its focal length, pixels of the network's input.
        focal_px: f64,
        /// Smallest and largest that the model was trained with.
        range_px: [f64; 2],
    },
}
