//! Image files made byte by byte, for what no encoder writes.

pub(crate) fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| (sum >> 1) ^ (0xEDB8_8320 & 0_u32.wrapping_sub(sum & 1)))
    })
}

fn chunk(name: [u8; 4], content: &[u8]) -> Vec<u8> {
    let named = [&name[..], content].concat();
    [&(content.len() as u32).to_be_bytes()[..], &named, &crc32(&named).to_be_bytes()].concat()
}

/// A zlib stream that stores what it has.
fn stored(content: &[u8]) -> Vec<u8> {
    let mut stream = vec![0x78, 0x01];
    let blocks: Vec<&[u8]> = content.chunks(0xFFFF).collect();
    for (position, block) in blocks.iter().enumerate() {
        let length = block.len() as u16;
        stream.push(u8::from(position + 1 == blocks.len()));
        stream.extend([length.to_le_bytes(), (!length).to_le_bytes()].concat());
        stream.extend(*block);
    }
    let (a, b) = content.iter().fold((1_u32, 0_u32), |(a, b), byte| {
        let a = (a + u32::from(*byte)) % 65_521;
        (a, (b + a) % 65_521)
    });
    stream.extend((b << 16 | a).to_be_bytes());
    stream
}

fn png_parts([width, height]: [u32; 2], bits: u8, colour: u8, palette: Option<&[u8]>, rows: &[&[u8]]) -> [Vec<u8>; 3] {
    let sides = [width.to_be_bytes(), height.to_be_bytes()].concat();
    let header = [&sides[..], &[bits, colour, 0, 0, 0]].concat();
    let mut start = [b"\x89PNG\r\n\x1a\n".to_vec(), chunk(*b"IHDR", &header)].concat();
    start.extend(palette.map(|colours| chunk(*b"PLTE", colours)).unwrap_or_default());
    let filtered: Vec<u8> = rows.iter().flat_map(|row| [&[0], *row].concat()).collect();
    [start, chunk(*b"IDAT", &stored(&filtered)), chunk(*b"IEND", &[])]
}

/// A PNG file of these rows, whose depth and kind of colours are those of its header.
pub(crate) fn png(size: [u32; 2], bits: u8, colour: u8, palette: Option<&[u8]>, rows: &[&[u8]]) -> Vec<u8> {
    png_parts(size, bits, colour, palette, rows).concat()
}

/// A PNG file in RGB with EXIF data before or behind its pixels.
pub(crate) fn png_with_exif(size: [u32; 2], rows: &[&[u8]], exif: &[u8], behind: bool) -> Vec<u8> {
    let [start, data, end] = png_parts(size, 8, 2, None, rows);
    let exif = chunk(*b"eXIf", exif);
    let parts = if behind { [start, data, exif, end] } else { [start, exif, data, end] };
    parts.concat()
}

/// Tag, type and little-endian value; shorter numbers are filled up with zeros.
pub(crate) type Entry<'a> = (u16, u16, &'a [u8]);

/// EXIF data with these entries in the first directory and these in the one of the camera.
pub(crate) fn exif_block(first: &[Entry], camera: &[Entry]) -> Vec<u8> {
    let entries = first.len() + 1;
    let camera_at = 8 + 2 + 12 * entries + 4;
    let mut values_at = camera_at + 2 + 12 * camera.len() + 4;
    let mut values = Vec::new();
    let mut directory = |entries: &[Entry]| {
        let mut bytes = (entries.len() as u16).to_le_bytes().to_vec();
        for (tag, kind, value) in entries {
            let unit = [1, 1, 1, 2, 4, 8][usize::from(*kind)];
            let count = value.len().div_ceil(unit) as u32;
            bytes.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
            bytes.extend(count.to_le_bytes());
            let mut value = value.to_vec();
            if value.len() <= 4 {
                value.resize(4, 0);
                bytes.extend(&value);
            } else {
                bytes.extend((values_at as u32).to_le_bytes());
                values_at += value.len();
                values.extend(value);
            }
        }
        bytes.extend([0; 4]);
        bytes
    };
    let pointer = (camera_at as u32).to_le_bytes();
    let first = [first, &[(0x8769, 4, &pointer[..])]].concat();
    let directories = [directory(&first), directory(camera)].concat();
    [&b"II\x2a\0\x08\0\0\0"[..], &directories, &values].concat()
}

/// A JPEG file with EXIF data put behind its first mark.
pub(crate) fn jpeg_with_exif(file: &[u8], exif: &[u8]) -> Vec<u8> {
    let length = (2 + 6 + exif.len()) as u16;
    [&file[..2], &[0xFF, 0xE1], &length.to_be_bytes(), b"Exif\0\0", exif, &file[2..]].concat()
}

/// A TIFF file in RGB, turned.
pub(crate) fn tiff_rows([width, height]: [u32; 2], pixels: &[u8], orientation: u16) -> Vec<u8> {
    const ENTRIES: u16 = 11;
    let bits_at = 8 + 2 + 12 * u32::from(ENTRIES) + 4;
    let pixels_at = bits_at + 6;
    let short = |value: u16| u32::from(value);
    let entries: [(u16, u16, u32, u32); ENTRIES as usize] = [
        (254, 4, 1, 0),
        (256, 4, 1, width),
        (257, 4, 1, height),
        (258, 3, 3, bits_at),
        (259, 3, 1, short(1)),
        (262, 3, 1, short(2)),
        (273, 4, 1, pixels_at),
        (274, 3, 1, short(orientation)),
        (277, 3, 1, short(3)),
        (278, 4, 1, height),
        (279, 4, 1, pixels.len() as u32),
    ];
    let mut file = b"II\x2a\0\x08\0\0\0".to_vec();
    file.extend(ENTRIES.to_le_bytes());
    for (tag, kind, count, value) in entries {
        file.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
        file.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
    }
    file.extend([0; 4]);
    file.extend([8_u16.to_le_bytes(); 3].concat());
    file.extend(pixels);
    file
}
