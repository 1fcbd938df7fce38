//! What a file is, by its first bytes or by its name.

use std::fmt;
use std::path::Path;

use image::ImageFormat;

/// Extensions of images that are read, in the order in which they are looked for; upper case will do.
pub(super) const EXTENSIONS: [&str; 13] =
    ["png", "jpg", "jpeg", "webp", "bmp", "tif", "tiff", "gif", "ppm", "pgm", "pbm", "pnm", "jfif"];

/// The formats that are read, as messages call them.
pub(crate) const EXPECTED: &str = "PNG, JPEG, WebP, BMP, TIFF, GIF, PPM or PGM";

/// Bytes at the start of a file that tell what it is.
pub(super) const START_BYTES: usize = 64;

/// Pictures and films that are recognised and not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum UnsupportedFormat {
    /// What iPhones store.
    Heic,
    /// Pictures in AV1.
    Avif,
    /// JPEG XL.
    JpegXl,
    /// JPEG 2000.
    Jpeg2000,
    /// A camera's raw data.
    Raw,
    /// A film.
    Video,
}

impl UnsupportedFormat {
    /// What to do to have it read.
    pub fn advice(self) -> &'static str {
        match self {
            Self::Heic => {
                "convert it to JPEG: heif-convert IN.heic OUT.jpg (an iPhone stores JPEG with \"Most Compatible\")"
            }
            Self::Avif => "convert it to PNG: avifdec IN.avif OUT.png",
            Self::JpegXl => "convert it to PNG: djxl IN.jxl OUT.png",
            Self::Jpeg2000 => "convert it to PNG: opj_decompress -i IN.jp2 -o OUT.png",
            Self::Raw => "develop it to JPEG: darktable-cli IN.dng OUT.jpg",
            Self::Video => "take its frames out: ffmpeg -i IN.mp4 frames/%06d.png",
        }
    }

    /// What a file with this name is, when it is one of these.
    pub fn from_name(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        NAMES.iter().find(|(_, names)| names.contains(&extension.as_str())).map(|(kind, _)| *kind)
    }
}

impl fmt::Display for UnsupportedFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Heic => "a HEIC picture",
            Self::Avif => "an AVIF picture",
            Self::JpegXl => "a JPEG XL picture",
            Self::Jpeg2000 => "a JPEG 2000 picture",
            Self::Raw => "raw data of a camera",
            Self::Video => "a video",
        })
    }
}

/// What files are called that hold these.
const NAMES: [(UnsupportedFormat, &[&str]); 6] = [
    (UnsupportedFormat::Heic, &["heic", "heif", "hif"]),
    (UnsupportedFormat::Avif, &["avif"]),
    (UnsupportedFormat::JpegXl, &["jxl"]),
    (UnsupportedFormat::Jpeg2000, &["jp2", "j2k", "jpx"]),
    (UnsupportedFormat::Raw, &["dng", "cr2", "cr3", "nef", "arw", "orf", "rw2", "raf"]),
    (
        UnsupportedFormat::Video,
        &["mp4", "mov", "avi", "mkv", "webm", "m4v", "mpg", "mpeg", "wmv", "3gp", "mts", "m2ts", "flv", "insv", "lrv"],
    ),
];

/// The format of a file that begins like this, or what else it is.
pub(super) fn of_start(start: &[u8]) -> Result<ImageFormat, Option<UnsupportedFormat>> {
    let Ok(format) = image::guess_format(start) else { return Err(unsupported(start)) };
    match format {
        // "P2: 721.5" begins a calibration of KITTI.
        ImageFormat::Pnm if start.get(2).is_none_or(|byte| !byte.is_ascii_whitespace() && *byte != b'#') => Err(None),
        ImageFormat::Png
        | ImageFormat::Jpeg
        | ImageFormat::WebP
        | ImageFormat::Bmp
        | ImageFormat::Tiff
        | ImageFormat::Gif
        | ImageFormat::Pnm => Ok(format),
        _ => Err(unsupported(start)),
    }
}

fn unsupported(start: &[u8]) -> Option<UnsupportedFormat> {
    const STARTS: [(&[u8], UnsupportedFormat); 9] = [
        (b"\xff\x0a", UnsupportedFormat::JpegXl),
        (b"\0\0\0\x0cJXL ", UnsupportedFormat::JpegXl),
        (b"\0\0\0\x0cjP  ", UnsupportedFormat::Jpeg2000),
        (b"\xff\x4f\xff\x51", UnsupportedFormat::Jpeg2000),
        (b"FUJIFILMCCD-RAW", UnsupportedFormat::Raw),
        (b"IIRO", UnsupportedFormat::Raw),
        (b"IIU\0", UnsupportedFormat::Raw),
        (b"\x1a\x45\xdf\xa3", UnsupportedFormat::Video),
        (b"\0\0\x01\xba", UnsupportedFormat::Video),
    ];
    if let Some((_, kind)) = STARTS.iter().find(|(known, _)| start.starts_with(known)) {
        return Some(*kind);
    }
    let at = |range: std::ops::Range<usize>| start.get(range).unwrap_or_default();
    if at(0..4) == b"RIFF" && at(8..12) == b"AVI " {
        return Some(UnsupportedFormat::Video);
    }
    // Files of ISO's media format: the brand tells what is in them.
    match (at(4..8), at(8..12)) {
        (b"ftyp", b"avif" | b"avis") => Some(UnsupportedFormat::Avif),
        (b"ftyp", b"heic" | b"heix" | b"hevc" | b"hevx" | b"heim" | b"heis" | b"mif1" | b"msf1") => {
            // A general brand; those behind say what is in it.
            Some(if start.chunks(4).skip(4).any(|brand| brand == b"avif") {
                UnsupportedFormat::Avif
            } else {
                UnsupportedFormat::Heic
            })
        }
        (b"ftyp", b"crx ") => Some(UnsupportedFormat::Raw),
        (b"ftyp" | b"moov" | b"mdat" | b"wide", _) => Some(UnsupportedFormat::Video),
        _ => None,
    }
}
