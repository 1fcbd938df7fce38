//! Colours. Orange against blue stays apart for every common kind of colour blindness, and all of them are light
//! enough for a dark road.

use farsight_core::{Box3d, Detection, ObjectClass};

use crate::options::{ColorBy, DrawOptions};

/// A colour with its opacity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rgba {
    pub(crate) rgb: [u8; 3],
    /// 0 transparent, 1 opaque.
    pub(crate) opacity: f32,
}

impl Rgba {
    pub(crate) const fn new(rgb: [u8; 3]) -> Self {
        Self { rgb, opacity: 1.0 }
    }

    pub(crate) const fn faded(self, opacity: f32) -> Self {
        Self { opacity, ..self }
    }
}

/// Ground truth and text.
pub(crate) const WHITE: Rgba = Rgba::new([255, 255, 255]);
/// Text that steps back.
pub(crate) const MUTED: Rgba = Rgba::new([150, 166, 184]);
/// Backgrounds of text, and outlines.
pub(crate) const SHADOW: Rgba = Rgba::new([10, 14, 20]);
/// Behind the bird's-eye view.
pub(crate) const NIGHT: Rgba = Rgba::new([15, 19, 26]);
/// Ground that the camera sees.
pub(crate) const GROUND: Rgba = Rgba::new([28, 35, 46]);
/// Range rings.
pub(crate) const RING: Rgba = Rgba::new([62, 76, 95]);

/// Distance at which the ramp ends, metres; farther is drawn in its last colour. Fixed, so that colours compare
/// between pictures.
pub(crate) const RAMP_END_M: f64 = 60.0;

/// Near to far: orange, amber, pale yellow, sky, blue.
const RAMP: [[u8; 3]; 5] = [[255, 92, 46], [255, 170, 40], [244, 230, 130], [112, 206, 245], [110, 150, 255]];

/// The colour for a distance in metres.
pub(crate) fn distance_color(distance_m: f64) -> Rgba {
    let last = RAMP.len() - 1;
    let share = (distance_m / RAMP_END_M).clamp(0.0, 1.0);
    // A distance that is not a number has the far colour.
    let place = if share.is_nan() { last as f64 } else { share * last as f64 };
    let below = (place as usize).min(last - 1);
    let weight = place - below as f64;
    let mix = |i: usize| f64::from(RAMP[below][i]) * (1.0 - weight) + f64::from(RAMP[below + 1][i]) * weight;
    Rgba::new([0, 1, 2].map(|i| mix(i).round() as u8))
}

/// The colour for a class, after Okabe and Ito's set.
pub(crate) fn class_color(class: &ObjectClass) -> Rgba {
    Rgba::new(match class {
        ObjectClass::Car => [86, 190, 245],
        ObjectClass::Van => [60, 210, 170],
        ObjectClass::Truck | ObjectClass::Tram => [240, 228, 66],
        ObjectClass::Pedestrian | ObjectClass::PersonSitting => [255, 120, 60],
        ObjectClass::Cyclist => [235, 150, 205],
        ObjectClass::Misc | ObjectClass::DontCare | ObjectClass::Other(_) => [200, 205, 212],
    })
}

impl DrawOptions {
    pub(crate) fn color(&self, detection: &Detection) -> Rgba {
        match self.color_by {
            ColorBy::Distance => distance_color(self.distance_of(&detection.box3d)),
            ColorBy::Class => class_color(&detection.class),
        }
    }

    pub(crate) fn distance_of(&self, object: &Box3d) -> f64 {
        (self.distance_m)(object)
    }

    pub(crate) fn distance_text(&self, detection: &Detection) -> String {
        distance_text(detection, self.distance_of(&detection.box3d))
    }
}

/// `23.4 m`, or `23.4 ±1.2 m` when the detection knows its error; `distance_m` is the distance to it that is asked for.
pub fn distance_text(detection: &Detection, distance_m: f64) -> String {
    match detection.sigma_of_m(distance_m) {
        Some(sigma_m) => format!("{distance_m:.1} ±{sigma_m:.1} m"),
        None => format!("{distance_m:.1} m"),
    }
}
