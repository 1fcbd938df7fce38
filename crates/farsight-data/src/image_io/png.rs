//! PNG files that have more picture than their header says. Decoders stop where the header does and say nothing.

use std::io::{self, Cursor, Read, Seek, SeekFrom};

use fdeflate::Decompressor;
use image::RgbImage;
use png::{BitDepth, Decoder, Limits, Transformations};

use super::RGB_BYTES;

/// Channels of a pixel as it is used.
const RGB: usize = RGB_BYTES as usize;

/// Where a file has its header: the name of that chunk, its 13 bytes, and their checksum; the height is in it.
const HEADER: std::ops::Range<usize> = 12..29;
const HEIGHT: std::ops::Range<usize> = 20..24;
const CHECKSUM: std::ops::Range<usize> = 29..33;

/// The pixels of a usual file: 8 bits, rows in their order, no more and no less of them than its header says. Its data
/// are unpacked once: the decoder is told of one row more, which it must not find. None of what is odd or damaged.
pub(super) fn usual(mut bytes: Vec<u8>, max_bytes: u64) -> Option<RgbImage> {
    let Header { size: [width, height], .. } = Header::of(bytes.get(HEADER)?.strip_prefix(b"IHDR")?)?;
    if bytes.get(CHECKSUM)? != crc32fast::hash(&bytes[HEADER]).to_be_bytes() {
        return None;
    }
    bytes[HEIGHT].copy_from_slice(&height.checked_add(1)?.to_be_bytes());
    let checksum = crc32fast::hash(&bytes[HEADER]);
    bytes[CHECKSUM].copy_from_slice(&checksum.to_be_bytes());

    let limits = Limits { bytes: usize::try_from(max_bytes).ok()? };
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_ignore_text_chunk(true);
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().ok()?;
    let (color, depth) = reader.output_color_type();
    let channels = color.samples();
    let raw_bytes = u64::from(width) * u64::from(height) * channels.max(RGB) as u64;
    if depth != BitDepth::Eight || reader.info().interlaced || height == 0 || raw_bytes > max_bytes {
        return None;
    }
    let mut pixels = RgbImage::new(width, height);
    let mut row = vec![0; reader.output_line_size(width)?];
    for target in pixels.chunks_exact_mut(RGB * width as usize) {
        if channels == RGB {
            reader.read_row(target).ok()??;
            continue;
        }
        reader.read_row(&mut row).ok()??;
        for (target, source) in target.chunks_exact_mut(RGB).zip(row.chunks_exact(channels)) {
            if let [r, g, b, _] = *source {
                target.copy_from_slice(&[r, g, b]);
            } else {
                target.fill(source[0]);
            }
        }
    }
    // The row more is missing, and nothing else is wrong.
    (reader.read_row(&mut row).is_err() && reader.finish().is_ok()).then_some(pixels)
}

/// Bytes that a compressed stream may refer back to.
const WINDOW: usize = 1 << 15;

/// Bytes that are unpacked at a time.
const BLOCK: usize = 1 << 17;

/// Bytes of a chunk that are read at a time.
const PIECE: u64 = 1 << 16;

/// The size, pixels, that the header announces, where the data of the picture unpack to more. What cannot be unpacked,
/// or announces more than `max_pixels`, is left to the decoder, which tells what is wrong.
///
/// # Errors
/// When the file cannot be read.
pub(super) fn longer_than(source: &mut (impl Read + Seek), max_pixels: u64) -> io::Result<Option<[u32; 2]>> {
    source.seek(SeekFrom::Start(8))?;
    let mut unpacked = Unpacked::new();
    let mut header = None;
    let mut piece = Vec::new();
    loop {
        let mut head = [0; 8];
        if source.read_exact(&mut head).is_err() {
            return Ok(None);
        }
        let [a, b, c, d, name @ ..] = head;
        let mut left = u64::from(u32::from_be_bytes([a, b, c, d]));
        if &name == b"IEND" {
            return Ok(None);
        }
        while matches!(&name, b"IHDR" | b"IDAT") && left > 0 {
            piece.clear();
            let read = source.by_ref().take(left.min(PIECE)).read_to_end(&mut piece)? as u64;
            if read == 0 {
                return Ok(None);
            }
            left -= read;
            if &name == b"IHDR" {
                header = Header::of(&piece).filter(|header| header.pixels() <= max_pixels);
                break;
            }
            let Some(Header { size, raw_bytes }) = header else { return Ok(None) };
            match unpacked.add(&piece, raw_bytes) {
                Some(count) if count > raw_bytes => return Ok(Some(size)),
                Some(_) if !unpacked.decompressor.is_done() => {}
                _ => return Ok(None),
            }
        }
        source.seek_relative(left as i64 + 4)?;
    }
}

/// A stream that is unpacked and not kept.
struct Unpacked {
    decompressor: Decompressor,
    output: Vec<u8>,
    position: usize,
    count: u64,
}

impl Unpacked {
    fn new() -> Self {
        Self { decompressor: Decompressor::new(), output: vec![0; WINDOW + BLOCK], position: 0, count: 0 }
    }

    /// How many bytes there are so far, counted no further than just above `most`; none where the stream is damaged.
    fn add(&mut self, mut input: &[u8], most: u64) -> Option<u64> {
        while self.count <= most && !self.decompressor.is_done() {
            if self.position == self.output.len() {
                self.output.copy_within(BLOCK.., 0);
                self.position = WINDOW;
            }
            let (read, written) = self.decompressor.read(input, &mut self.output, self.position, false).ok()?;
            input = &input[read..];
            self.position += written;
            self.count += written as u64;
            if read == 0 && written == 0 {
                break;
            }
        }
        Some(self.count)
    }
}

/// Passes of an interlaced picture: the first column and row of each, and the steps to the next.
const PASSES: [[u64; 4]; 7] =
    [[0, 0, 8, 8], [4, 0, 8, 8], [0, 4, 4, 8], [2, 0, 4, 4], [0, 2, 2, 4], [1, 0, 2, 2], [0, 1, 1, 2]];

/// What a header announces.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Header {
    /// Width and height, pixels.
    size: [u32; 2],
    /// Bytes of all rows, one more in each for its filter.
    raw_bytes: u64,
}

impl Header {
    /// None of a header that is no header.
    fn of(bytes: &[u8]) -> Option<Self> {
        let &[w0, w1, w2, w3, h0, h1, h2, h3, depth, color, _, _, interlaced] = bytes else { return None };
        let size = [[w0, w1, w2, w3], [h0, h1, h2, h3]].map(u32::from_be_bytes);
        let [width, height] = size.map(u64::from);
        let channels = match color {
            0 | 3 => 1,
            2 => 3,
            4 => 2,
            6 => 4,
            _ => return None,
        };
        let bits = channels * u64::from(depth);
        let rows = |[width, height]: [u64; 2]| {
            if width == 0 { Some(0) } else { height.checked_mul(1 + width.checked_mul(bits)?.div_ceil(8)) }
        };
        let pass =
            |[x, y, dx, dy]: [u64; 4]| [width.saturating_sub(x).div_ceil(dx), height.saturating_sub(y).div_ceil(dy)];
        let raw_bytes = match interlaced {
            0 => rows([width, height]),
            1 => PASSES.into_iter().try_fold(0_u64, |sum, one| sum.checked_add(rows(pass(one))?)),
            _ => None,
        };
        Some(Self { size, raw_bytes: raw_bytes? })
    }

    fn pixels(&self) -> u64 {
        self.size.into_iter().map(u64::from).product()
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;
    use std::path::Path;

    use image::codecs::png::{CompressionType, FilterType, PngEncoder};
    use image::{DynamicImage, GrayImage, ImageEncoder, RgbaImage};

    use super::*;
    use crate::image_io::{ImageLimits, decode_image};

    /// The same file with another height in its header, whose checksum is right.
    fn with_height(mut png: Vec<u8>, height: u32) -> Vec<u8> {
        png[20..24].copy_from_slice(&height.to_be_bytes());
        let checksum = png[12..29].iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 & 0u32.wrapping_sub(crc & 1)))
        });
        png[29..33].copy_from_slice(&(!checksum).to_be_bytes());
        png
    }

    fn is_longer(png: &[u8]) -> bool {
        longer_than(&mut Cursor::new(png), 1_000_000).unwrap().is_some()
    }

    fn raw_bytes(header: &[u8]) -> Option<u64> {
        Header::of(header).map(|header| header.raw_bytes)
    }

    #[test]
    fn rows_below_the_last_one_of_the_header_are_noticed() {
        // Noise does not pack well, so there are several chunks; gradients do, so a few bytes unpack to many.
        for seed in [0_u32, 1] {
            let pixel = |x: u32, y: u32| {
                let noise = (x * 7919 + y * 104_729).wrapping_mul(2_654_435_761).to_be_bytes();
                if seed == 0 { noise } else { [x as u8, y as u8, 0, 255] }
            };
            let image = RgbaImage::from_fn(301, 240, |x, y| image::Rgba(pixel(x, y)));
            let mut png = Vec::new();
            let encoder = PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Adaptive);
            encoder.write_image(&image, 301, 240, image::ExtendedColorType::Rgba8).unwrap();
            assert!(!is_longer(&png));
            for height in [1, 120, 239] {
                assert!(is_longer(&with_height(png.clone(), height)), "{height}");
            }
            let shorter = with_height(png.clone(), 100);
            assert_eq!(longer_than(&mut Cursor::new(&shorter), 30_100).unwrap(), Some([301, 100]));
            assert_eq!(longer_than(&mut Cursor::new(&shorter), 30_099).unwrap(), None, "too large");
            let told = decode_image(&shorter, Path::new("a.png"), ImageLimits::default()).unwrap_err().to_string();
            assert_eq!(told, "a.png: its header says 301 x 100 pixels, but more picture follows");
            // Too few rows are told by the decoder.
            assert!(!is_longer(&with_height(png.clone(), 241)));
            assert!(!is_longer(&png[..png.len() / 2]));
        }
    }

    fn written(write: impl FnOnce(PngEncoder<&mut Vec<u8>>)) -> Vec<u8> {
        let mut png = Vec::new();
        write(PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Adaptive));
        png
    }

    fn noise<P: image::Pixel<Subpixel = u8>>(width: u32, height: u32) -> image::ImageBuffer<P, Vec<u8>> {
        let mut state = 7_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        image::ImageBuffer::from_fn(width, height, |_, _| {
            *P::from_slice(&[next(), next(), next(), next()][..usize::from(P::CHANNEL_COUNT)])
        })
    }

    /// A picture with a palette of three colours, one of them transparent.
    fn with_palette() -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 3, 2);
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_palette(vec![255, 0, 0, 0, 255, 0, 0, 0, 255]);
        encoder.set_trns(vec![255, 255, 0]);
        encoder.write_header().unwrap().write_image_data(&[0, 1, 2, 2, 1, 0]).unwrap();
        bytes
    }

    #[test]
    fn what_is_unpacked_once_is_what_the_decoder_makes_of_it() {
        let files = [
            written(|to| noise::<image::Rgb<u8>>(37, 21).write_with_encoder(to).unwrap()),
            written(|to| noise::<image::Rgba<u8>>(5, 300).write_with_encoder(to).unwrap()),
            written(|to| noise::<image::Luma<u8>>(64, 9).write_with_encoder(to).unwrap()),
            written(|to| noise::<image::LumaA<u8>>(1, 1).write_with_encoder(to).unwrap()),
            with_palette(),
        ];
        for png in files {
            let expected = image::load_from_memory(&png).unwrap().into_rgb8();
            let found = usual(png.clone(), u64::MAX).unwrap();
            assert_eq!(found, expected);
            let height = found.height();
            // What is longer, shorter, cut, damaged or too large is for the others.
            for height in [height - 1, height + 1] {
                assert_eq!(usual(with_height(png.clone(), height), u64::MAX), None);
            }
            for end in 0..png.len() {
                assert_eq!(usual(png[..end].to_vec(), u64::MAX), None, "{end} bytes");
            }
            let start = png.windows(4).position(|name| name == b"IDAT").unwrap();
            for place in start..png.len() {
                let mut damaged = png.clone();
                damaged[place] ^= 1;
                let found = usual(damaged.clone(), u64::MAX);
                let expected = image::load_from_memory(&damaged).ok().map(DynamicImage::into_rgb8);
                assert!(found.is_none() || found == expected, "byte {place}");
            }
            assert_eq!(usual(png, expected.len() as u64 - 1), None);
        }
    }

    #[test]
    fn what_is_unusual_is_left_alone() {
        let deep = written(|to| {
            to.write_image(&[1; 12], 2, 1, image::ExtendedColorType::Rgb16).unwrap();
        });
        assert_eq!(usual(deep, u64::MAX), None, "16 bits");
        let mut interlaced = written(|to| noise::<image::Luma<u8>>(1, 1).write_with_encoder(to).unwrap());
        interlaced[28] = 1;
        assert_eq!(usual(with_height(interlaced.clone(), 1), u64::MAX), None, "interlaced");
        interlaced[19] = 0;
        assert_eq!(usual(with_height(interlaced, 1), u64::MAX), None, "no columns");
    }

    #[test]
    fn rows_are_counted_as_the_format_has_them() {
        let header = |width: u32, height: u32, depth: u8, color: u8, interlaced: u8| {
            [&width.to_be_bytes()[..], &height.to_be_bytes(), &[depth, color, 0, 0, interlaced]].concat()
        };
        assert_eq!(raw_bytes(&header(9, 2, 1, 0, 0)), Some(2 * (1 + 2)));
        assert_eq!(raw_bytes(&header(5, 3, 16, 6, 0)), Some(3 * (1 + 40)));
        // 8x8, each pass: 1x1, 1x1, 2x1, 2x2, 4x2, 4x4, 8x4.
        assert_eq!(raw_bytes(&header(8, 8, 8, 0, 1)), Some(2 + 2 + 3 + 6 + 10 + 20 + 36));
        // More than a number has room for: in one pass, and in all of them together.
        assert_eq!(raw_bytes(&header(u32::MAX, u32::MAX, 255, 6, 0)), None);
        assert_eq!(raw_bytes(&header(0x330c_bfff, 0xd0a7_2fff, 196, 0, 1)), None);
        // 1x1 has the first pass only.
        assert_eq!(raw_bytes(&header(1, 1, 8, 2, 1)), Some(4));
        assert_eq!(raw_bytes(&header(u32::MAX, u32::MAX, 16, 6, 0)), None);
        assert_eq!(raw_bytes(b"short"), None);
    }

    #[test]
    fn a_gray_image_of_one_pixel_is_no_longer() {
        let mut png = Vec::new();
        GrayImage::from_pixel(1, 1, image::Luma([7])).write_with_encoder(PngEncoder::new(&mut png)).unwrap();
        assert!(!is_longer(&png));
    }
}
