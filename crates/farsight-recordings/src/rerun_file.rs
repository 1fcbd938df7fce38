//! Recordings of rerun. No other file knows whether it is there: without the feature `rerun` its functions answer with
//! an error.

use std::path::Path;

use crate::error::RecordingError;
use crate::recorded_frame::RecordedFrame;

#[cfg(feature = "rerun")]
pub use with_rerun::RerunRecording;
#[cfg(not(feature = "rerun"))]
pub use without_rerun::RerunRecording;

#[cfg(feature = "rerun")]
mod with_rerun {
    use re_sdk::{RecordingStream, RecordingStreamBuilder};
    use re_sdk_types::archetypes::{Boxes3D, EncodedImage, Pinhole, Transform3D, ViewCoordinates};
    use re_sdk_types::components::PinholeProjection;
    use re_sdk_types::datatypes::Quaternion;

    use super::{Path, RecordedFrame, RecordingError};
    use crate::boxes::Placed;
    use crate::geometry::Parts;

    /// The timeline of the recording, seconds since its start.
    const TIMELINE: &str = "time";

    /// A recording for rerun's viewer.
    ///
    /// `world` has camera coordinates (x right, y down, z forward), `world/camera` the pinhole, `world/camera/image`
    /// the image, and `world/objects` the boxes.
    pub struct RerunRecording {
        stream: RecordingStream,
    }

    fn failed(error: impl std::fmt::Display) -> RecordingError {
        RecordingError::Rerun(error.to_string())
    }

    fn single<const N: usize>(values: [f64; N]) -> [f32; N] {
        values.map(|value| value as f32)
    }

    impl RerunRecording {
        /// Begins a recording in a file.
        ///
        /// # Errors
        /// When the file cannot be written, or this build is without rerun.
        pub fn create(path: &Path) -> Result<Self, RecordingError> {
            let stream = RecordingStreamBuilder::new("farsight").save(path).map_err(failed)?;
            stream.log_static("world", &ViewCoordinates::RDF()).map_err(failed)?;
            Ok(Self { stream })
        }

        /// Adds an image and what was found in it.
        ///
        /// # Errors
        /// When it cannot be written, or its time is negative.
        pub fn add(&mut self, frame: &RecordedFrame<'_>) -> Result<(), RecordingError> {
            if !(frame.time_s >= 0.0 && frame.time_s.is_finite()) {
                return Err(RecordingError::Time(frame.time_s));
            }
            self.stream.set_duration_secs(TIMELINE, frame.time_s);
            let parts = Parts::of(frame.camera);
            let pose = Transform3D::from_translation_rotation(
                single(parts.origin_m),
                Quaternion::from_xyzw(single(parts.rotation)),
            );
            self.stream.log("world/camera", &pose).map_err(failed)?;
            let [a, b, c, d, e, f, g, h, i] = single(parts.k);
            // Column by column.
            let projection = PinholeProjection::from([[a, d, g], [b, e, h], [c, f, i]]);
            let resolution = [frame.image.width() as f32, frame.image.height() as f32];
            let pinhole = Pinhole::new(projection).with_resolution(resolution);
            self.stream.log("world/camera", &pinhole).map_err(failed)?;
            let image = EncodedImage::from_file_contents(frame.jpeg()?).with_media_type("image/jpeg");
            self.stream.log("world/camera/image", &image).map_err(failed)?;
            self.stream.log("world/objects", &boxes(frame)).map_err(failed)
        }

        /// Ends the recording.
        ///
        /// # Errors
        /// When what is left of it cannot be written.
        pub fn finish(self) -> Result<(), RecordingError> {
            self.stream.flush_blocking().map_err(failed)?;
            self.stream.disconnect();
            Ok(())
        }
    }

    fn boxes(frame: &RecordedFrame<'_>) -> Boxes3D {
        let placed: Vec<Placed> = frame.found.iter().map(|found| Placed::of(&found.detection.box3d)).collect();
        Boxes3D::from_centers_and_sizes(
            placed.iter().map(|placed| single(placed.center_m)),
            placed.iter().map(|placed| single(placed.size_m)),
        )
        .with_quaternions(placed.iter().map(|placed| Quaternion::from_xyzw(single(placed.rotation))))
        .with_labels(frame.found.iter().map(|found| found.label.as_str()))
    }
}

#[cfg(not(feature = "rerun"))]
mod without_rerun {
    use super::{Path, RecordedFrame, RecordingError};

    /// A recording for rerun's viewer; there are none in this build.
    pub enum RerunRecording {}

    impl RerunRecording {
        /// Begins a recording in a file.
        ///
        /// # Errors
        /// Always, as this build is without rerun.
        pub fn create(_path: &Path) -> Result<Self, RecordingError> {
            Err(RecordingError::NoRerun)
        }

        /// Adds an image and what was found in it.
        ///
        /// # Errors
        /// Never, as there is no such recording.
        pub fn add(&mut self, _frame: &RecordedFrame<'_>) -> Result<(), RecordingError> {
            match *self {}
        }

        /// Ends the recording.
        ///
        /// # Errors
        /// Never, as there is no such recording.
        pub fn finish(self) -> Result<(), RecordingError> {
            match self {}
        }
    }
}
