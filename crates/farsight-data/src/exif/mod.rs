//! What cameras and phones write about a picture (EXIF), as far as it says how the picture is turned and how wide it
//! sees.
//!
//! [`focal`] makes a focal length of it.

mod focal;
mod phones;

use std::fmt;

use exif::{Context, Field, In, Reader, Tag, Value};
use image::metadata::Orientation;

pub use focal::{FocalFromExif, FocalProblem, focal};

/// The facts of a picture's EXIF data. What is missing, or zero where the standard calls zero "unknown", is `None`; a
/// number that makes no sense (infinite, not a number) stays, so that it can be told.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Exif {
    /// Who made the camera.
    pub make: Option<String>,
    /// What the camera is called.
    pub model: Option<String>,
    /// How to turn the stored pixels upright, from 1 to 8.
    pub orientation: Option<u8>,
    /// Focal length of the lens, millimetres.
    pub focal_mm: Option<f64>,
    /// Focal length that sees as much on 35 mm film, millimetres.
    pub focal_35mm: Option<f64>,
    /// Columns and rows of the sensor's image per millimetre.
    pub focal_plane_px_per_mm: Option<[f64; 2]>,
    /// By how much the picture was enlarged after the sensor.
    pub digital_zoom: Option<f64>,
    /// Width and height of the picture as the camera stored it, pixels.
    pub stored_size: Option<[u32; 2]>,
}

/// What the directories of a TIFF file say about its pages.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct TiffPages {
    /// There are more than one.
    pub(crate) several: bool,
    /// The first is a camera's raw data or its thumbnail.
    pub(crate) raw: bool,
}

/// `NewSubfileType` of TIFF: bit 0 marks a smaller version of another page.
const SUBFILE_TYPE: Tag = Tag(Context::Tiff, 254);

/// `DNGVersion`: the file is a digital negative.
const DNG_VERSION: Tag = Tag(Context::Tiff, 50_706);

/// `CFAPattern` and colour filters in a TIFF directory: raw data of a sensor.
const CFA_PATTERN: Tag = Tag(Context::Tiff, 33_422);

/// Longest name of a camera that is kept, characters.
const MAX_NAME: usize = 40;

impl Exif {
    /// Nothing is known.
    pub const NONE: Self = Self {
        make: None,
        model: None,
        orientation: None,
        focal_mm: None,
        focal_35mm: None,
        focal_plane_px_per_mm: None,
        digital_zoom: None,
        stored_size: None,
    };

    /// Reads EXIF data, with or without the six bytes `Exif\0\0` before them; as much of them as can be read.
    pub fn from_bytes(bytes: &[u8]) -> Self {
        parsed(bytes).map_or(Self::NONE, |data| Self::new(&data))
    }

    fn new(data: &exif::Exif) -> Self {
        let field = |tag| data.get_field(tag, In::PRIMARY);
        let number = |tag| field(tag).and_then(|field| number(field, 0)).filter(|&value| value != 0.0);
        let uint = |tag| field(tag).and_then(|field| field.value.get_uint(0));
        let side = |tag| uint(tag).filter(|&side| side > 0);
        Self {
            make: field(Tag::Make).and_then(text),
            model: field(Tag::Model).and_then(text),
            orientation: uint(Tag::Orientation).and_then(|value| u8::try_from(value).ok()),
            focal_mm: number(Tag::FocalLength),
            focal_35mm: number(Tag::FocalLengthIn35mmFilm),
            focal_plane_px_per_mm: focal_plane(
                number(Tag::FocalPlaneXResolution),
                number(Tag::FocalPlaneYResolution),
                uint(Tag::FocalPlaneResolutionUnit),
            ),
            digital_zoom: number(Tag::DigitalZoomRatio),
            stored_size: side(Tag::PixelXDimension)
                .and_then(|width| side(Tag::PixelYDimension).map(|height| [width, height])),
        }
    }

    /// How to turn the stored pixels upright.
    pub(crate) fn turn(&self) -> Option<Orientation> {
        self.orientation.and_then(Orientation::from_exif)
    }
}

impl TiffPages {
    /// Reads the directories of a TIFF file.
    pub(crate) fn from_bytes(file: &[u8]) -> Self {
        let Some(data) = parsed(file) else { return Self::default() };
        let field = |tag| data.get_field(tag, In::PRIMARY);
        let smaller = field(SUBFILE_TYPE).and_then(|field| field.value.get_uint(0)).is_some_and(|kind| kind & 1 == 1);
        Self {
            several: data.fields().any(|field| field.ifd_num != In::PRIMARY),
            raw: smaller || field(DNG_VERSION).is_some() || field(CFA_PATTERN).is_some(),
        }
    }
}

/// As much of EXIF data as can be read.
fn parsed(bytes: &[u8]) -> Option<exif::Exif> {
    let bytes = bytes.strip_prefix(b"Exif\0\0").unwrap_or(bytes);
    let read = Reader::new().continue_on_error(true).read_raw(bytes.to_vec());
    read.or_else(|error| error.distill_partial_result(|_| ())).ok()
}

/// Value `index` of a field as a number; what is divided by zero is infinite, or no number.
fn number(field: &Field, index: usize) -> Option<f64> {
    match &field.value {
        Value::Rational(values) => values.get(index).map(|value| f64::from(value.num) / f64::from(value.denom)),
        Value::SRational(values) => values.get(index).map(|value| f64::from(value.num) / f64::from(value.denom)),
        Value::Float(values) => values.get(index).map(|&value| f64::from(value)),
        Value::Double(values) => values.get(index).copied(),
        other => other.get_uint(index).map(f64::from),
    }
}

/// Pixels per millimetre; the unit is an inch where none is given (EXIF 2.32, tag A210).
fn focal_plane(x: Option<f64>, y: Option<f64>, unit: Option<u32>) -> Option<[f64; 2]> {
    let unit_mm = match unit.unwrap_or(2) {
        2 => 25.4,
        3 => 10.0,
        // Not of the standard, but written by some.
        4 => 1.0,
        5 => 0.001,
        _ => return None,
    };
    Some([x?, y.or(x)?].map(|resolution| resolution / unit_mm))
}

/// The text of a field; it comes from strangers and may go to a terminal, so that only what can be printed stays.
fn text(field: &Field) -> Option<String> {
    let Value::Ascii(parts) = &field.value else { return None };
    let text = String::from_utf8_lossy(parts.first()?).into_owned();
    let printable: String = text.chars().filter(|c| !c.is_control()).take(MAX_NAME).collect();
    Some(printable.trim().to_owned()).filter(|text| !text.is_empty())
}

/// The camera's name as people say it.
pub(crate) struct CameraName<'a>(pub(crate) &'a Exif);

impl fmt::Display for CameraName<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.0.make, &self.0.model) {
            (Some(make), Some(model)) if !model.starts_with(make.as_str()) => write!(f, "{make} {model}"),
            (_, Some(name)) | (Some(name), None) => f.write_str(name),
            (None, None) => f.write_str("an unnamed camera"),
        }
    }
}
