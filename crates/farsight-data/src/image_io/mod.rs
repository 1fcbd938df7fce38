//! Reading images: what is in a file is checked before memory is taken for it, and what is missing from it is told.

mod chunks;
mod error;
mod jpeg;
mod kind;
mod png;

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, RgbImage};

use crate::exif::{Exif, TiffPages};
use chunks::Found;
pub use error::{ImageError, ImageWarning};
use jpeg::Flaw;
pub(crate) use kind::EXPECTED;
pub use kind::UnsupportedFormat;

/// The formats that are read, for messages.
pub const IMAGE_FORMATS: &str = EXPECTED;

/// Whether `path` is called like an image that can be read, such as .png or .JPG.
pub fn has_image_extension(path: &Path) -> bool {
    path.extension().is_some_and(|found| kind::EXTENSIONS.iter().any(|known| found.eq_ignore_ascii_case(known)))
}

/// The image called `name` in `folder`, with any of the extensions.
pub fn image_named(folder: &Path, name: &str) -> Option<PathBuf> {
    let cases = [str::to_owned, str::to_ascii_uppercase as fn(&str) -> String];
    let extensions = cases.into_iter().flat_map(|case| kind::EXTENSIONS.map(case));
    extensions.map(|extension| folder.join(format!("{name}.{extension}"))).find(|path| path.is_file())
}

/// How large an image may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageLimits {
    /// Most pixels, counted by what they unpack to: three bytes are one pixel, so one with four channels of 16 bits
    /// counts as 8/3.
    pub max_pixels: u64,
}

/// The usual limit of this process.
static USUAL_MAX_PIXELS: AtomicU64 = AtomicU64::new(100_000_000);

impl ImageLimits {
    /// Sets the usual limits of this process, for every image that is read without limits of its own: those of data
    /// sets, for instance.
    pub fn set_default(self) {
        USUAL_MAX_PIXELS.store(self.max_pixels, Ordering::Relaxed);
    }
}

impl Default for ImageLimits {
    /// The usual limits: 100 megapixels, larger than the pictures of almost all cameras, and 300 MB, unless
    /// [`ImageLimits::set_default`] set others.
    fn default() -> Self {
        Self { max_pixels: USUAL_MAX_PIXELS.load(Ordering::Relaxed) }
    }
}

/// Bytes of a pixel as it is used.
const RGB_BYTES: u64 = 3;

/// JPEG files of so many bytes are checked by a thread of their own while they are decoded.
const LARGE_JPEG_BYTES: usize = 256 << 10;

/// Memory that a decoder may take beside the pixels, bytes.
const SPARE_BYTES: u64 = 32 << 20;

/// An image with what its file says about it.
#[derive(Debug, Clone)]
pub struct LoadedImage {
    /// The upright pixels.
    pub pixels: RgbImage,
    /// What the camera wrote about the picture; empty when nothing.
    pub exif: Exif,
    /// What is odd.
    pub warnings: Vec<ImageWarning>,
}

/// What the header of an image says.
#[derive(Debug, Clone)]
pub struct ImageHeader {
    /// Width and height of the upright picture, pixels.
    pub size: [u32; 2],
    /// What the camera wrote about the picture; empty when nothing.
    pub exif: Exif,
}

/// Reads the pixels of an image; [`load_image`] with the usual limits.
///
/// # Errors
/// As [`load_image`].
pub fn read_image(path: &Path) -> Result<RgbImage, ImageError> {
    load_image(path, ImageLimits::default()).map(|image| image.pixels)
}

/// Reads an image file as 8-bit RGB, whatever its name says: PNG, JPEG, WebP, BMP, TIFF, GIF, PPM, PGM or PBM.
///
/// Grey and palettes become RGB, 16 bits become 8, an alpha channel is dropped; of an animation the first frame is
/// read. The orientation that cameras and phones write (EXIF) is applied, so the image is upright as viewers show it; a
/// calibration must be that of the upright image.
///
/// The `image` crate decodes KITTI's PNG files in less than half the time that zune-png needs (8.4 against 19 ms, side
/// by side).
///
/// # Errors
/// When the file is no regular file, cannot be read, is no such image, is damaged or truncated, or has more pixels than
/// `limits` allow: this is checked from its header, before memory is taken for the pixels.
pub fn load_image(path: &Path, limits: ImageLimits) -> Result<LoadedImage, ImageError> {
    let mut input = Input::open(path)?;
    // A PNG file is in many small chunks, which are gone through three times: hundreds of reads of the file.
    if input.format == ImageFormat::Png && input.length <= SPARE_BYTES {
        let bytes = input.bytes(SPARE_BYTES).map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
        return decode_image(&bytes, path, limits);
    }
    decode(input, limits)
}

/// Reads an image from memory; errors call it `name`.
///
/// # Errors
/// As [`load_image`].
pub fn decode_image(bytes: &[u8], name: &Path, limits: ImageLimits) -> Result<LoadedImage, ImageError> {
    decode(Input::new(Cursor::new(bytes), bytes.len() as u64, name)?, limits)
}

/// Reads the size of an image and its EXIF data, not its pixels.
///
/// # Errors
/// As [`load_image`], where that shows without the pixels.
pub fn read_header(path: &Path, limits: ImageLimits) -> Result<ImageHeader, ImageError> {
    let mut input = Input::open(path)?;
    let found = input.found()?;
    let exif = found.exif();
    // The decoder of JPEG would read the whole file.
    let (size, turn) = if let Some(size) = found.size {
        (size, exif.turn().unwrap_or(Orientation::NoTransforms))
    } else {
        let mut decoder = decoder(input, limits)?;
        let turn = orientation(&exif, &mut decoder);
        let (width, height) = decoder.dimensions();
        check_size(path, [width, height], decoder.color_type().bytes_per_pixel(), limits)?;
        ([width, height], turn)
    };
    let [width, height] = size;
    Ok(ImageHeader { size: if swaps_sides(turn) { [height, width] } else { size }, exif })
}

/// Refuses what is no regular file: opening a pipe or device may wait for ever.
fn regular_file(path: &Path) -> Result<(File, u64), ImageError> {
    let failed = |source| ImageError::Read { path: path.to_owned(), source };
    let check = |metadata: &fs::Metadata| {
        let kind = metadata.file_type();
        let found = if kind.is_dir() { "a folder" } else { "a pipe, socket or device" };
        if kind.is_file() { Ok(()) } else { Err(ImageError::NoFile { path: path.to_owned(), found }) }
    };
    check(&fs::metadata(path).map_err(failed)?)?;
    let file = File::open(path).map_err(failed)?;
    let metadata = file.metadata().map_err(failed)?;
    check(&metadata)?;
    Ok((file, metadata.len()))
}

/// A file or bytes whose format is known.
struct Input<'a, S> {
    source: S,
    length: u64,
    path: &'a Path,
    format: ImageFormat,
}

impl<'a> Input<'a, BufReader<File>> {
    fn open(path: &'a Path) -> Result<Self, ImageError> {
        let (file, length) = regular_file(path)?;
        Self::new(BufReader::new(file), length, path)
    }
}

impl<'a, S: BufRead + Seek> Input<'a, S> {
    fn new(mut source: S, length: u64, path: &'a Path) -> Result<Self, ImageError> {
        if length == 0 {
            return Err(ImageError::Empty { path: path.to_owned() });
        }
        let mut start = Vec::new();
        let read = source.by_ref().take(kind::START_BYTES as u64).read_to_end(&mut start);
        read.map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
        match kind::of_start(&start) {
            Ok(format) => Ok(Self { source, length, path, format }),
            Err(Some(kind)) => Err(ImageError::UnsupportedFormat { path: path.to_owned(), kind }),
            Err(None) => Err(ImageError::Format { path: path.to_owned() }),
        }
    }

    /// What stands beside the pixels.
    fn found(&mut self) -> Result<Found, ImageError> {
        let source = &mut self.source;
        let found = match self.format {
            ImageFormat::Jpeg => chunks::of_jpeg(source),
            ImageFormat::Png => chunks::of_png(source),
            ImageFormat::WebP => chunks::of_webp(source),
            ImageFormat::Gif => Ok(chunks::of_gif(source)),
            // TIFF is what EXIF data are written in.
            ImageFormat::Tiff if self.length <= SPARE_BYTES => {
                self.bytes(SPARE_BYTES).map(|bytes| Found { exif: Some(bytes), ..Found::default() })
            }
            _ => Ok(Found::default()),
        };
        match found {
            Ok(found) => Ok(found),
            // A file that ends too early: the decoder tells it better.
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(Found::default()),
            Err(source) => Err(ImageError::Read { path: self.path.to_owned(), source }),
        }
    }

    /// The file from its start, at most `most` bytes.
    fn bytes(&mut self, most: u64) -> io::Result<Vec<u8>> {
        self.source.seek(SeekFrom::Start(0))?;
        let mut bytes = Vec::new();
        self.source.by_ref().take(most).read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}

/// Whether a turn exchanges width and height.
fn swaps_sides(turn: Orientation) -> bool {
    matches!(
        turn,
        Orientation::Rotate90 | Orientation::Rotate270 | Orientation::Rotate90FlipH | Orientation::Rotate270FlipH
    )
}

/// The turn in the EXIF data, or what the decoder finds by itself in data that are damaged elsewhere.
fn orientation(exif: &Exif, decoder: &mut impl ImageDecoder) -> Orientation {
    exif.turn().or_else(|| decoder.orientation().ok()).unwrap_or(Orientation::NoTransforms)
}

/// The decoder of a file, at its start.
fn decoder<'s, S: BufRead + Seek + 's>(
    input: Input<'_, S>,
    limits: ImageLimits,
) -> Result<impl ImageDecoder + use<'s, S>, ImageError> {
    let Input { mut source, path, format, .. } = input;
    source.seek(SeekFrom::Start(0)).map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    let mut reader = ImageReader::with_format(source, format);
    let mut decoder_limits = Limits::default();
    decoder_limits.max_alloc = Some(limits.max_pixels.saturating_mul(RGB_BYTES).saturating_add(SPARE_BYTES));
    reader.limits(decoder_limits);
    reader.into_decoder().map_err(|source| ImageError::from_decoder(path, source))
}

/// Refuses an image whose pixels are too many when unpacked to so many bytes each.
fn check_size(path: &Path, [width, height]: [u32; 2], pixel_bytes: u8, limits: ImageLimits) -> Result<(), ImageError> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 {
        return Err(ImageError::Broken { path: path.to_owned(), reason: "it has no pixels" });
    }
    let counted = if u64::from(pixel_bytes) <= RGB_BYTES {
        pixels
    } else {
        pixels.saturating_mul(u64::from(pixel_bytes)).div_ceil(RGB_BYTES)
    };
    let limit = limits.max_pixels;
    if counted > limit {
        return Err(ImageError::TooLarge { path: path.to_owned(), width, height, counted, limit });
    }
    Ok(())
}

fn decode<S: BufRead + Seek>(mut input: Input<S>, limits: ImageLimits) -> Result<LoadedImage, ImageError> {
    let found = input.found()?;
    let exif = found.exif();
    let mut warnings = Vec::new();
    if found.animated {
        warnings.push(ImageWarning::Animation);
    }
    if input.format == ImageFormat::Tiff {
        let pages = found.exif.as_deref().map(TiffPages::from_bytes).unwrap_or_default();
        if pages.raw {
            return Err(ImageError::UnsupportedFormat { path: input.path.to_owned(), kind: UnsupportedFormat::Raw });
        }
        if pages.several {
            warnings.push(ImageWarning::Pages);
        }
    }
    if input.format == ImageFormat::Png {
        let is_small = input.length <= SPARE_BYTES && !found.animated && found.exif.is_none();
        if let Some(pixels) = is_small.then(|| usual_png(&mut input, limits)).flatten() {
            return Ok(LoadedImage { pixels, exif, warnings });
        }
        check_png(&mut input, limits)?;
    }
    let pixels = if input.format == ImageFormat::Jpeg {
        let bytes = jpeg_bytes(&mut input, &found, limits)?;
        let (path, format, length) = (input.path, input.format, input.length);
        let decoded = || pixels(Input { source: Cursor::new(&bytes), length, path, format }, &exif, limits);
        if bytes.len() < LARGE_JPEG_BYTES {
            check_jpeg(&bytes, &found, path)?;
            decoded()
        } else {
            // To check the data takes two thirds of the time that it takes to decode them.
            thread::scope(|scope| {
                let checked = scope.spawn(|| check_jpeg(&bytes, &found, path));
                let decoded = decoded();
                checked.join().unwrap_or_else(|panic| resume_unwind(panic)).and(decoded)
            })
        }
    } else {
        pixels(input, &exif, limits)
    }?;
    Ok(LoadedImage { pixels, exif, warnings })
}

/// The bytes of a JPEG file.
fn jpeg_bytes<S: BufRead + Seek>(
    input: &mut Input<S>,
    found: &Found,
    limits: ImageLimits,
) -> Result<Vec<u8>, ImageError> {
    let path = input.path;
    let [width, height] = found.size.unwrap_or([1, 1]);
    check_size(path, [width, height.max(1)], RGB_BYTES as u8, limits)?;
    // Phones put films behind their pictures; what is longer than any picture of this size is not read into memory.
    let most = (u64::from(width) * u64::from(height)).saturating_mul(RGB_BYTES).saturating_add(SPARE_BYTES);
    input.bytes(most).map_err(|source| ImageError::Read { path: path.to_owned(), source })
}

/// Refuses a JPEG file whose data are not those of the picture that its header announces.
fn check_jpeg(bytes: &[u8], found: &Found, path: &Path) -> Result<(), ImageError> {
    let [width, height] = found.size.unwrap_or([1, 1]);
    let path = path.to_owned();
    match jpeg::flaw(bytes) {
        None => Ok(()),
        Some(Flaw::NoEnd) => Err(ImageError::Truncated { path, reason: "its end is missing".to_owned() }),
        Some(Flaw::Missing(share)) => {
            let percent = (100.0 * share).floor();
            Err(ImageError::Truncated { path, reason: format!("its data end after {percent}% of the picture") })
        }
        Some(Flaw::Longer) => Err(ImageError::Longer { path, width, height }),
        Some(Flaw::Broken) => Err(ImageError::Broken { path, reason: "its compressed data make no sense" }),
    }
}

/// The pixels of a PNG file that has nothing odd about it.
fn usual_png<S: BufRead + Seek>(input: &mut Input<S>, limits: ImageLimits) -> Option<RgbImage> {
    let bytes = input.bytes(SPARE_BYTES).ok()?;
    png::usual(bytes, limits.max_pixels.saturating_mul(RGB_BYTES))
}

/// Refuses a PNG file that has more picture than its header says; what has too many pixels is left to the decoder.
fn check_png<S: BufRead + Seek>(input: &mut Input<S>, limits: ImageLimits) -> Result<(), ImageError> {
    let path = || input.path.to_owned();
    match png::longer_than(&mut input.source, limits.max_pixels) {
        Ok(None) => Ok(()),
        Ok(Some([width, height])) => Err(ImageError::Longer { path: path(), width, height }),
        Err(source) => Err(ImageError::Read { path: path(), source }),
    }
}

fn pixels<S: BufRead + Seek>(input: Input<S>, exif: &Exif, limits: ImageLimits) -> Result<RgbImage, ImageError> {
    let path = input.path;
    let mut decoder = decoder(input, limits)?;
    let (width, height) = decoder.dimensions();
    check_size(path, [width, height], decoder.color_type().bytes_per_pixel(), limits)?;
    let turn = orientation(exif, &mut decoder);
    let decoded = DynamicImage::from_decoder(decoder).map_err(|source| ImageError::from_decoder(path, source))?;
    // First to three bytes a pixel: a turn makes a copy.
    let mut upright = DynamicImage::from(decoded.into_rgb8());
    upright.apply_orientation(turn);
    Ok(upright.into_rgb8())
}

impl ImageError {
    fn from_decoder(path: &Path, source: image::ImageError) -> Self {
        let path = path.to_owned();
        match source {
            image::ImageError::Unsupported(_) => Self::Unsupported { path, source },
            source => Self::Damaged { path, source },
        }
    }
}
