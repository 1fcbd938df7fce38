//! Whether a JPEG file has all of its picture, and no more.
//!
//! Decoders fill what is missing with grey and say nothing, and an end mark behind a cut hides it. So the entropy-coded
//! data are walked through once, without making pixels of them: baseline and progressive, with and without restarts
//! (ITU-T T.81, annexes F and G).

mod bits;
mod scan;

use bits::Table;
use scan::{Component, Scan};

/// What is wrong with a file.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Flaw {
    /// The file ends without an end mark.
    NoEnd,
    /// The file has an end mark, but its data end after this share of the picture.
    Missing(f64),
    /// More data follow than the picture has pixels.
    Longer,
    /// The data make no sense.
    Broken,
}

/// Data behind the last pixels of all scans that no encoder's padding explains, bytes.
const MAX_PADDING: usize = 256;

/// A picture with more scans is an attack; decoders refuse it.
const MAX_SCANS: usize = 100;

/// What is wrong with the data of a JPEG file; nothing is said of files that the decoder refuses.
pub(super) fn flaw(bytes: &[u8]) -> Option<Flaw> {
    let mut picture: Option<Picture> = None;
    let mut tables = Tables::default();
    let mut rest = bytes;
    let (mut scans, mut too_many) = (0, 0);
    loop {
        let Some((marker, segment, behind)) = next_segment(rest) else {
            return Some(Flaw::NoEnd);
        };
        rest = behind;
        match marker {
            0xC4 => tables.define(segment)?,
            0xC0..=0xC2 => picture = Some(Picture::new(marker == 0xC2, segment)?),
            // Lossless, hierarchical or arithmetic coding, or the height given later: nothing that is decoded here.
            0xC3..=0xCF | 0xDC => return None,
            0xDD => tables.restart_interval = usize::from(u16::from_be_bytes(*segment.first_chunk()?)),
            START_OF_SCAN => {
                scans += 1;
                let picture = picture.as_mut().filter(|_| scans <= MAX_SCANS)?;
                match picture.scan(segment, &tables, behind)? {
                    Ok(used) => rest = &behind[used..],
                    // Where the file ends, it is a lack of its end that is told.
                    Err(Flaw::Missing(_)) if !has_end(behind) => return Some(Flaw::NoEnd),
                    Err(flaw) => return Some(flaw),
                }
                let Some((left_over, restarts)) = left_over(rest) else { return Some(Flaw::NoEnd) };
                if left_over.windows(2).any(|pair| pair[0] != pair[1]) {
                    too_many += left_over.len();
                }
                // One restart too many is a habit of some encoders.
                if too_many > MAX_PADDING || restarts > 1 {
                    return Some(Flaw::Longer);
                }
            }
            END => return picture?.missing().map(Flaw::Missing),
            _ => {}
        }
    }
}

const START_OF_SCAN: u8 = 0xDA;
const END: u8 = 0xD9;

/// The next marker, what its segment holds, and what follows. Bytes between segments are stepped over, as decoders do.
fn next_segment(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let at = next_marker(bytes)?;
    let (marker, behind) = (bytes[at + 1], &bytes[at + 2..]);
    // The start of an image, its end, restarts and a mark of old have no segment.
    if matches!(marker, 0xD0..=0xD9 | 0x01) {
        return Some((marker, &[], behind));
    }
    let length = usize::from(u16::from_be_bytes(*behind.first_chunk()?)).max(2);
    Some((marker, behind.get(2..length)?, &behind[length..]))
}

/// Where the next marker begins: an FF before something that is neither FF nor 0.
fn next_marker(bytes: &[u8]) -> Option<usize> {
    bytes.windows(2).position(|pair| pair[0] == 0xFF && !matches!(pair[1], 0 | 0xFF))
}

/// What stands before the next marker that is no restart, without the last bytes of the picture itself, and the
/// restarts that are passed; `None` without such a marker.
fn left_over(bytes: &[u8]) -> Option<(&[u8], usize)> {
    const LAST_BYTES: usize = 16;
    let (mut end, mut restarts) = (0, 0);
    loop {
        end += next_marker(&bytes[end..])?;
        if !matches!(bytes[end + 1], 0xD0..=0xD7) {
            // Any number of FF may stand before a marker.
            let filled = bytes[..end].iter().rev().take_while(|&&byte| byte == 0xFF).count();
            return Some((bytes[..end - filled].get(LAST_BYTES..).unwrap_or_default(), restarts));
        }
        end += 2;
        restarts += 1;
    }
}

fn has_end(bytes: &[u8]) -> bool {
    bytes.windows(2).any(|pair| pair == [0xFF, END])
}

/// Codes and restarts as defined so far.
#[derive(Default)]
struct Tables {
    dc: [Option<Box<Table>>; 4],
    ac: [Option<Box<Table>>; 4],
    restart_interval: usize,
}

impl Tables {
    /// Reads a segment of codes; `None` when it is none.
    fn define(&mut self, mut segment: &[u8]) -> Option<()> {
        while let [kind, rest @ ..] = segment {
            let (counts, rest) = rest.split_first_chunk::<16>()?;
            let symbols = counts.iter().map(|&count| usize::from(count)).sum();
            let tables = if kind >> 4 == 0 { &mut self.dc } else { &mut self.ac };
            *tables.get_mut(usize::from(kind & 15))? = Some(Box::new(Table::new(counts, rest.get(..symbols)?)?));
            segment = &rest[symbols..];
        }
        Some(())
    }
}

/// The picture that a header announces.
struct Picture {
    progressive: bool,
    size: [usize; 2],
    components: Vec<Component>,
}

impl Picture {
    fn new(progressive: bool, header: &[u8]) -> Option<Self> {
        let [8, height_1, height_2, width_1, width_2, count, components @ ..] = header else { return None };
        let side = |bytes| usize::from(u16::from_be_bytes(bytes));
        let size = [side([*width_1, *width_2]), side([*height_1, *height_2])];
        let components = components.chunks_exact(3).take(usize::from(*count));
        let components: Vec<Component> =
            components.map(|parts| Component::new(parts[0], parts[1])).collect::<Option<_>>()?;
        let known = size.iter().all(|&side| side > 0) && matches!(components.len(), 1..=4);
        let whole = components.len() == usize::from(*count);
        let mut picture = Self { progressive, size, components };
        (known && whole).then(|| {
            let most = picture.most_samples();
            picture.components.iter_mut().for_each(|component| component.lay_out(size, most, progressive));
            picture
        })
    }

    /// The finest sampling of all components, across and down.
    fn most_samples(&self) -> [usize; 2] {
        [0, 1].map(|axis| self.components.iter().map(|component| component.samples[axis]).max().unwrap_or(1))
    }

    /// Walks through one scan and answers how many bytes it took; `None` when the header of the scan is none.
    fn scan(&mut self, header: &[u8], tables: &Tables, data: &[u8]) -> Option<Result<usize, Flaw>> {
        let most = self.most_samples();
        let scan = Scan::new(header, self.progressive, &self.components, tables)?;
        let mcus = [0, 1].map(|axis| self.size[axis].div_ceil(8 * most[axis]));
        Some(scan.walk(&mut self.components, mcus, data))
    }

    /// The share of the picture that is there when some of it is not.
    fn missing(&self) -> Option<f64> {
        let whole = self.components.iter().filter(|component| component.is_complete()).count();
        (whole < self.components.len()).then(|| whole as f64 / self.components.len() as f64)
    }
}
