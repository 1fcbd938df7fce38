//! Pictures of what was found, as files.

use std::io::{self, Write};

use clap::ValueEnum;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;

/// How much JPEG keeps, of 100: lines and letters stay clean.
const JPEG_QUALITY: u8 = 90;

/// In which format pictures are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(super) enum PictureFormat {
    /// Every pixel as it was drawn
    #[default]
    Png,
    /// A quarter of the size, written in less time
    Jpg,
}

impl PictureFormat {
    /// What names of such files end with.
    pub(super) fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpg => "jpg",
        }
    }

    /// Writes `picture` to `out`.
    pub(super) fn write(self, picture: &RgbImage, mut out: &mut dyn Write) -> io::Result<()> {
        let written = match self {
            // The encoder's own setting is its fast one.
            Self::Png => picture.write_with_encoder(PngEncoder::new(out)),
            Self::Jpg => picture.write_with_encoder(JpegEncoder::new_with_quality(&mut out, JPEG_QUALITY)),
        };
        written.map_err(io::Error::other)
    }
}
