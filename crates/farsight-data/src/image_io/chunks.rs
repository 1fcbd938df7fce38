//! What stands in a file beside its pixels: EXIF data, and whether more pictures follow. Nothing here reads pixels.

use std::io::{self, Read, Seek, SeekFrom};

use crate::exif::Exif;

/// Largest EXIF data that are read; a JPEG segment has room for 64 kB.
const MAX_EXIF: u32 = 1 << 20;

/// Chunks, segments or blocks that are looked at; real files have dozens, or thousands of image data.
const MAX_CHUNKS: usize = 1 << 20;

/// What was found.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub(super) exif: Option<Vec<u8>>,
    pub(super) animated: bool,
    /// Width and height, pixels, where they were met on the way (JPEG).
    pub(super) size: Option<[u32; 2]>,
}

impl Found {
    /// What the EXIF data say; nothing when there are none.
    pub(super) fn exif(&self) -> Exif {
        self.exif.as_deref().map(Exif::from_bytes).unwrap_or_default()
    }
}

/// Of a JPEG file: the size in its header, and its EXIF segment.
pub(super) fn of_jpeg(source: &mut (impl Read + Seek)) -> io::Result<Found> {
    let mut found = Found::default();
    source.seek(SeekFrom::Start(0))?;
    for _ in 0..MAX_CHUNKS {
        let mut byte = [0];
        if source.read_exact(&mut byte).is_err() {
            break;
        }
        if byte[0] != 0xFF {
            continue;
        }
        while byte[0] == 0xFF {
            source.read_exact(&mut byte)?;
        }
        let marker = byte[0];
        if matches!(marker, 0 | 1 | 0xD0..=0xD8) {
            continue;
        }
        if matches!(marker, 0xD9 | 0xDA) {
            break;
        }
        let mut length = [0; 2];
        source.read_exact(&mut length)?;
        let length = u16::from_be_bytes(length).saturating_sub(2);
        match marker {
            0xE1 if found.exif.is_none() => {
                let segment = taken(source, u32::from(length))?;
                found.exif = Some(segment).filter(|segment| segment.starts_with(b"Exif\0\0"));
            }
            0xC0..=0xCF if !matches!(marker, 0xC4 | 0xC8 | 0xCC) => {
                let header = taken(source, u32::from(length))?;
                if let [_, height_1, height_2, width_1, width_2, ..] = header[..] {
                    let sides = [[width_1, width_2], [height_1, height_2]];
                    found.size = Some(sides.map(|side| u32::from(u16::from_be_bytes(side))));
                }
            }
            _ => source.seek_relative(i64::from(length))?,
        }
    }
    Ok(found)
}

/// Of a PNG file: `eXIf`, which may stand before or behind the pixels, and `acTL`.
pub(super) fn of_png(source: &mut (impl Read + Seek)) -> io::Result<Found> {
    let mut found = Found::default();
    source.seek(SeekFrom::Start(8))?;
    for _ in 0..MAX_CHUNKS {
        let mut head = [0; 8];
        if source.read_exact(&mut head).is_err() {
            break;
        }
        let [a, b, c, d, name @ ..] = head;
        let length = u32::from_be_bytes([a, b, c, d]);
        match &name {
            b"IEND" => break,
            b"acTL" => found.animated = true,
            b"eXIf" if length <= MAX_EXIF => {
                found.exif = Some(taken(source, length)?);
                source.seek_relative(4)?;
                continue;
            }
            _ => {}
        }
        source.seek_relative(i64::from(length) + 4)?;
    }
    Ok(found)
}

/// Of a WebP file: the chunk `EXIF`, and the mark of an animation in `VP8X`.
pub(super) fn of_webp(source: &mut (impl Read + Seek)) -> io::Result<Found> {
    const ANIMATED: u8 = 2;
    let mut found = Found::default();
    source.seek(SeekFrom::Start(12))?;
    for _ in 0..MAX_CHUNKS {
        let mut head = [0; 8];
        if source.read_exact(&mut head).is_err() {
            break;
        }
        let [name @ .., a, b, c, d] = head;
        let length = u32::from_le_bytes([a, b, c, d]);
        let content = match &name {
            b"EXIF" | b"VP8X" if length <= MAX_EXIF => taken(source, length)?,
            _ => {
                source.seek_relative(i64::from(length) + i64::from(length % 2))?;
                continue;
            }
        };
        source.seek_relative(i64::from(length % 2))?;
        if &name == b"EXIF" {
            found.exif = Some(content);
        } else {
            found.animated = content.first().is_some_and(|flags| flags & ANIMATED != 0);
        }
    }
    Ok(found)
}

/// Of a GIF file: whether it has a second frame.
pub(super) fn of_gif(source: &mut (impl Read + Seek)) -> Found {
    let animated = gif_frames(source).unwrap_or(0) > 1;
    Found { animated, ..Found::default() }
}

/// Frames of a GIF file, counted no further than two.
fn gif_frames(source: &mut (impl Read + Seek)) -> io::Result<usize> {
    let mut head = [0; 13];
    source.seek(SeekFrom::Start(0))?;
    source.read_exact(&mut head)?;
    source.seek_relative(color_table(head[10]))?;
    let mut frames = 0;
    for _ in 0..MAX_CHUNKS {
        let mut kind = [0];
        source.read_exact(&mut kind)?;
        match kind[0] {
            0x2C => {
                frames += 1;
                if frames > 1 {
                    break;
                }
                let mut descriptor = [0; 9];
                source.read_exact(&mut descriptor)?;
                // The colours and the size of the first code.
                source.seek_relative(color_table(descriptor[8]) + 1)?;
            }
            0x21 => source.seek_relative(1)?,
            _ => break,
        }
        skip_sub_blocks(source)?;
    }
    Ok(frames)
}

/// Bytes of the colours that follow these flags.
fn color_table(flags: u8) -> i64 {
    if flags & 0x80 == 0 { 0 } else { 3 << ((flags & 7) + 1) }
}

fn skip_sub_blocks(source: &mut (impl Read + Seek)) -> io::Result<()> {
    loop {
        let mut length = [0];
        source.read_exact(&mut length)?;
        if length[0] == 0 {
            return Ok(());
        }
        source.seek_relative(i64::from(length[0]))?;
    }
}

fn taken(source: &mut impl Read, length: u32) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    source.take(u64::from(length)).read_to_end(&mut bytes)?;
    Ok(bytes)
}
