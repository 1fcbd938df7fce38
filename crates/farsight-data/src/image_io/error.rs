//! Images that could not be read, and what is odd about those that could.

use std::fmt;
use std::io;
use std::path::PathBuf;

use thiserror::Error;

use super::kind::{EXPECTED, UnsupportedFormat};

/// An image that could not be read.
#[derive(Debug, Error)]
pub enum ImageError {
    /// The file cannot be opened or read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A folder, pipe, socket or device; a pipe could be waited for without end.
    #[error("{}: {found}; expected a file with an image", path.display())]
    NoFile {
        /// What has this name.
        path: PathBuf,
        /// What it is.
        found: &'static str,
    },
    /// The file holds nothing.
    #[error("{}: an empty file; expected an image ({EXPECTED})", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file holds something else.
    #[error("{}: no image that is known here; expected {EXPECTED}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// The file holds a picture or film that is not read here.
    #[error("{}: {kind}, which is not read here; {}", path.display(), kind.advice())]
    UnsupportedFormat {
        /// The file.
        path: PathBuf,
        /// What it is.
        kind: UnsupportedFormat,
    },
    /// A kind of image that is known and not read, such as a JPEG with arithmetic coding.
    #[error("{}: not read here: {source}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        source: image::ImageError,
    },
    /// The image has too many pixels.
    #[error("{}: {width} x {height} pixels{}; expected at most {limit} pixels (--max-pixels)", path.display(), Counted(*counted, [*width, *height]))]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its width, pixels.
        width: u32,
        /// Its height, pixels.
        height: u32,
        /// What these count as: pixels of 3 bytes.
        counted: u64,
        /// Most that may be.
        limit: u64,
    },
    /// The file ends before its image does. Decoders of JPEG fill the rest with grey and say nothing.
    #[error("{}: truncated: {reason}", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// How that shows.
        reason: String,
    },
    /// The file has more picture than its header says.
    #[error("{}: its header says {width} x {height} pixels, but more picture follows", path.display())]
    Longer {
        /// The file.
        path: PathBuf,
        /// Width in the header, pixels.
        width: u32,
        /// Height in the header, pixels.
        height: u32,
    },
    /// The image is damaged, or a file other than JPEG cut off.
    #[error("{}: damaged image: {source}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        source: image::ImageError,
    },
    /// The image is damaged in a way that decoders do not tell.
    #[error("{}: damaged image: {reason}", path.display())]
    Broken {
        /// The file.
        path: PathBuf,
        /// How that shows.
        reason: &'static str,
    },
}

/// What pixels count as, where they take more than three bytes.
struct Counted(u64, [u32; 2]);

impl fmt::Display for Counted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(counted, [width, height]) = *self;
        if counted == u64::from(width) * u64::from(height) {
            return Ok(());
        }
        write!(f, ", which count as {counted} when unpacked")
    }
}

/// What is odd about an image that was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ImageWarning {
    /// Only the first frame of an animation was read.
    Animation,
    /// Only the first page of a file was read.
    Pages,
}

impl fmt::Display for ImageWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Animation => "an animation, of which only the first frame is looked at",
            Self::Pages => "a file of several pages, of which only the first is looked at",
        })
    }
}
