//! What a network expects of its input image.

use serde::{Deserialize, Serialize};

use crate::Affine2;

/// Order of the colour channels that a network was trained with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChannelOrder {
    /// Red, green, blue.
    #[default]
    Rgb,
    /// Blue, green, red: official SMOKE. The constants stay in their RGB order, a quirk of its own (spec section 8).
    Bgr,
}

/// Where an output pixel of a warp looks in the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sampling {
    /// Output pixel `p` samples `T^-1 p`: exactly what the camera does under the same `T` (and what OpenCV does).
    #[default]
    PixelExact,
    /// Output pixel `p` samples `T^-1 (p + 1/2) - 1/2`: Pillow, and so official SMOKE.
    HalfPixel,
    /// As [`PixelExact`](Self::PixelExact), but where the image shrinks, each output pixel is a mean over all source
    /// pixels within one step of it, weighted by a triangle (`antialias=True` of torchvision). So what is too fine for
    /// the output becomes grey instead of a pattern that is not there. Maps that turn the image are not filtered.
    Antialias,
}

/// Mean that is subtracted from each channel, on the scale 0 to 1 (ImageNet).
pub const CHANNEL_MEAN: [f32; 3] = [0.485, 0.456, 0.406];

/// What each channel is divided by afterwards (ImageNet).
pub const CHANNEL_STD: [f32; 3] = [0.229, 0.224, 0.225];

/// Size and conventions of a network's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InputRules {
    /// Width and height, pixels; multiples of 32.
    pub size: [usize; 2],
    /// Order of the channels.
    pub channels: ChannelOrder,
    /// Convention of the warp.
    pub sampling: Sampling,
}

impl InputRules {
    /// The map from an image of `image_size` to the input: the whole width, the height centred (spec 5.2).
    pub fn whole_image(&self, image_size: [usize; 2]) -> Affine2 {
        let [width, height] = image_size.map(|s| s as f64);
        Affine2::window([width / 2.0, height / 2.0], width, self.size)
    }
}
