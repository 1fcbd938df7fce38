//! What is recorded.

use farsight_core::{Camera, Detection};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

use crate::error::RecordingError;

/// Quality of the images, of 100.
const JPEG_QUALITY: u8 = 90;

/// One image and what was found in it.
#[derive(Debug, Clone)]
pub struct RecordedFrame<'a> {
    /// Since the start of the recording, seconds, not negative.
    pub time_s: f64,
    /// The image, upright.
    pub image: &'a RgbImage,
    /// Projects camera coordinates to its pixels.
    pub camera: &'a Camera,
    /// What was found.
    pub found: &'a [RecordedObject],
}

impl RecordedFrame<'_> {
    /// The image as a JPEG file.
    pub(crate) fn jpeg(&self) -> Result<Vec<u8>, RecordingError> {
        let mut data = Vec::new();
        self.image.write_with_encoder(JpegEncoder::new_with_quality(&mut data, JPEG_QUALITY))?;
        Ok(data)
    }
}

/// One object.
#[derive(Debug, Clone)]
pub struct RecordedObject {
    /// Its identity: that of a track, or any that differs within the image.
    pub id: String,
    /// What it is and where; its error bar is that of the depth.
    pub detection: Detection,
    /// What a viewer shows beside its box.
    pub label: String,
}

impl RecordedObject {
    /// These detections, numbered from 0, labelled by class and distance.
    pub fn from_detections(detections: &[Detection]) -> Vec<Self> {
        let labelled = |(number, detection): (usize, &Detection)| {
            let depth_m = detection.box3d.depth_m();
            let sigma = detection.range_sigma_m.map_or_else(String::new, |sigma_m| format!(" ±{sigma_m:.1}"));
            let label = format!("{} {depth_m:.1}{sigma} m", detection.class);
            Self { id: number.to_string(), detection: detection.clone(), label }
        };
        detections.iter().enumerate().map(|(number, detection)| labelled((number, detection))).collect()
    }
}
