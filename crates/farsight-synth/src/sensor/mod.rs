//! What a camera makes of light: exposure, blur, noise, tone curve and compression.
//!
//! [`SensorModel::sample`] draws a camera and its moment at random; [`SensorModel::capture`] is fixed: same settings,
//! same light, same bytes, on every machine.

mod blur;
mod curve;
mod device;
mod glare;
mod jpeg;
mod model;
mod noise;
mod rain;
mod sharpen;

pub use crate::device::Device;
pub use model::SensorModel;

use image::RgbImage;

use crate::render::Rendered;
use curve::ToneCurve;

impl SensorModel {
    /// The picture that this camera takes.
    pub fn capture(&self, rendered: &Rendered) -> RgbImage {
        let [width, height] = rendered.size;
        let mut light = rendered.color.clone();
        let curve = ToneCurve::new(self.contrast);
        let exposure = curve::exposure(&light, &curve, self.target_mean).min(self.most_exposure);
        glare::spread(&mut light, rendered.size, exposure, self.glare);
        blur::blur(&mut light, rendered.size, self.blur_sigma_px, self.motion_px);
        rain::fall(&mut light, rendered.size, self.rain, self.seed);
        let mut bytes = vec![0; width * height * 3];
        let sensor = noise::Readout { settings: self, exposure, curve: &curve, size: rendered.size };
        sensor.expose(&light, &mut bytes);
        sharpen::sharpen(&mut bytes, rendered.size, self.sharpening);
        if let Some(quality) = self.jpeg_quality {
            jpeg::compress(&mut bytes, rendered.size, quality);
        }
        RgbImage::from_raw(width as u32, height as u32, bytes).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests;
