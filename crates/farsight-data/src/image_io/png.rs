//! Whether a PNG file has more picture than its header says. Decoders stop where the header does and say nothing.

use std::io::{self, Read, Seek, SeekFrom};

use fdeflate::Decompressor;

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
    use image::{GrayImage, ImageEncoder, RgbaImage};

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
