//! Which kind of camera takes the picture.

use serde::{Deserialize, Serialize};

/// What takes a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Device {
    /// A plain camera: the curve, noise and compression of [`SensorModel::sample`](crate::sensor::SensorModel::sample).
    #[default]
    Any,
    /// A telephone: little noise, sharpened, strong colours, a good JPEG file.
    Phone,
    /// A dash camera: soft optics sharpened until edges have halos, and a small file.
    DashCamera,
}
