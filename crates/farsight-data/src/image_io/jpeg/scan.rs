//! One scan: which blocks it has, and stepping over their codes.

use super::bits::{Bits, Stop, Table};
use super::{Flaw, Tables};

/// One colour channel.
pub(super) struct Component {
    id: u8,
    /// Blocks of one unit, across and down.
    pub(super) samples: [usize; 2],
    /// Blocks that hold pixels, across and down.
    blocks: [usize; 2],
    /// Blocks of a row, those that only fill the last unit included.
    stride: usize,
    /// For each block, which coefficients are not zero; empty unless the picture is progressive.
    nonzero: Vec<u64>,
    /// Bits that are still missing of each coefficient; [`NEVER`] before the first scan with it.
    missing_bits: [u8; 64],
}

/// A coefficient that no scan had.
const NEVER: u8 = u8::MAX;

impl Component {
    pub(super) fn new(id: u8, samples: u8) -> Option<Self> {
        let samples = [samples >> 4, samples & 15].map(usize::from);
        let known = samples.iter().all(|count| (1..=4).contains(count));
        known.then(|| Self { id, samples, blocks: [0; 2], stride: 0, nonzero: Vec::new(), missing_bits: [NEVER; 64] })
    }

    /// Computes how many blocks there are in a picture of this size whose finest channel has these samples.
    pub(super) fn lay_out(&mut self, size: [usize; 2], most: [usize; 2], progressive: bool) {
        self.blocks = [0, 1].map(|axis| (size[axis] * self.samples[axis]).div_ceil(8 * most[axis]));
        let padded = [0, 1].map(|axis| size[axis].div_ceil(8 * most[axis]) * self.samples[axis]);
        self.stride = padded[0];
        if progressive {
            self.nonzero = vec![0; padded[0] * padded[1]];
        }
    }

    /// Whether the lowest coefficient is there, and each that was begun is there to its last bit.
    pub(super) fn is_complete(&self) -> bool {
        self.missing_bits[0] == 0 && self.missing_bits.iter().all(|&bits| bits == 0 || bits == NEVER)
    }
}

/// Which coefficients of which channels a scan has.
pub(super) struct Scan<'a> {
    parts: Vec<Part<'a>>,
    progressive: bool,
    band: [usize; 2],
    /// Bits that this scan and those before it leave out.
    low_bits: u8,
    refines: bool,
    restart_interval: usize,
}

struct Part<'a> {
    component: usize,
    dc: Option<&'a Table>,
    ac: Option<&'a Table>,
}

impl<'a> Scan<'a> {
    /// Reads the header of a scan; `None` when it is none.
    pub(super) fn new(header: &[u8], progressive: bool, components: &[Component], tables: &'a Tables) -> Option<Self> {
        let [count, rest @ ..] = header else { return None };
        let (parts, rest) = rest.split_at_checked(2 * usize::from(*count))?;
        let [first, last, bits, ..] = *rest else { return None };
        let part = |part: &[u8]| {
            let component = components.iter().position(|component| component.id == part[0])?;
            let table = |tables: &'a [Option<Box<Table>>; 4], index: u8| tables.get(usize::from(index))?.as_deref();
            Some(Part { component, dc: table(&tables.dc, part[1] >> 4), ac: table(&tables.ac, part[1] & 15) })
        };
        let parts: Vec<Part> = parts.chunks_exact(2).map(part).collect::<Option<_>>()?;
        let band = if progressive { [first, last].map(usize::from) } else { [0, 63] };
        let scan = Self {
            parts,
            progressive,
            band,
            low_bits: if progressive { bits & 15 } else { 0 },
            refines: progressive && bits >> 4 != 0,
            restart_interval: tables.restart_interval,
        };
        scan.is_possible().then_some(scan)
    }

    fn is_possible(&self) -> bool {
        let [first, last] = self.band;
        let band = first <= last && last < 64;
        // Only the lowest coefficients of several channels stand together, and they stand alone.
        let together = !self.progressive || if first == 0 { last == 0 } else { self.parts.len() == 1 };
        let coded = self.parts.iter().all(|part| match (self.progressive, first) {
            (false, _) => part.dc.is_some() && part.ac.is_some(),
            (true, 0) => self.refines || part.dc.is_some(),
            (true, _) => part.ac.is_some(),
        });
        band && together && coded && matches!(self.parts.len(), 1..=4)
    }

    /// Steps over all blocks, of a picture with `mcus` units across and down; the bytes that this took.
    pub(super) fn walk(&self, components: &mut [Component], mcus: [usize; 2], data: &[u8]) -> Result<usize, Flaw> {
        // A channel that stands alone has only blocks with pixels.
        let alone = match self.parts.as_slice() {
            [part] => Some(components[part.component].blocks),
            _ => None,
        };
        let [across, down] = alone.unwrap_or(mcus);
        let units = across * down;
        let mut walker = Walker { scan: self, bits: Bits::new(data), end_of_band: 0 };
        for unit in 0..units {
            if self.restart_interval > 0 && unit > 0 && unit % self.restart_interval == 0 {
                if !walker.bits.restart() {
                    return Err(Flaw::Missing(unit as f64 / units as f64));
                }
                walker.end_of_band = 0;
            }
            let place = [unit % across, unit / across];
            match walker.unit(components, place, alone.is_some()) {
                Ok(()) => {}
                Err(Stop::NoCode) => return Err(Flaw::Broken),
                Err(Stop::Exhausted) if walker.bits.at_restart() => return Err(Flaw::Broken),
                // Some encoders lose the last bits, which nobody sees.
                Err(Stop::Exhausted) if unit + 1 == units => break,
                Err(Stop::Exhausted) => return Err(Flaw::Missing(unit as f64 / units as f64)),
            }
        }
        for part in &self.parts {
            components[part.component].missing_bits[self.band[0]..=self.band[1]].fill(self.low_bits);
        }
        Ok(walker.bits.used())
    }
}

/// Where a scan is.
struct Walker<'a> {
    scan: &'a Scan<'a>,
    bits: Bits<'a>,
    /// Blocks that have nothing more of this band.
    end_of_band: u32,
}

impl Walker<'_> {
    fn unit(&mut self, components: &mut [Component], [x, y]: [usize; 2], alone: bool) -> Result<(), Stop> {
        for part in &self.scan.parts {
            let component = &mut components[part.component];
            let [across, down] = if alone { [1, 1] } else { component.samples };
            for row in 0..down {
                for column in 0..across {
                    let block = (y * down + row) * component.stride + x * across + column;
                    self.block(part, &mut component.nonzero, block)?;
                }
            }
        }
        Ok(())
    }

    fn block(&mut self, part: &Part, nonzero: &mut [u64], block: usize) -> Result<(), Stop> {
        let scan = self.scan;
        match (part.dc, part.ac) {
            (Some(dc), Some(ac)) if !scan.progressive => self.whole(dc, ac),
            (_, _) if scan.band[0] == 0 && scan.refines => self.bits.skip(1),
            (Some(dc), _) if scan.band[0] == 0 => self.lowest(dc),
            (_, Some(ac)) => match nonzero.get_mut(block) {
                Some(mask) if scan.refines => self.refined_band(ac, mask),
                Some(mask) => self.first_band(ac, mask),
                None => Err(Stop::NoCode),
            },
            _ => Err(Stop::NoCode),
        }
    }

    fn lowest(&mut self, dc: &Table) -> Result<(), Stop> {
        let length = self.bits.symbol(dc)?;
        self.bits.skip(u32::from(length))
    }

    /// A block of a baseline picture.
    fn whole(&mut self, dc: &Table, ac: &Table) -> Result<(), Stop> {
        self.lowest(dc)?;
        let mut position = 1;
        while position < 64 {
            let symbol = self.bits.symbol(ac)?;
            let (run, length) = (usize::from(symbol >> 4), u32::from(symbol & 15));
            match (run, length) {
                (15, 0) => position += 16,
                (_, 0) => break,
                _ => {
                    position += run + 1;
                    self.bits.number(length)?;
                }
            }
        }
        Ok(())
    }

    /// The first bits of a band of one block.
    fn first_band(&mut self, ac: &Table, nonzero: &mut u64) -> Result<(), Stop> {
        if self.end_of_band > 0 {
            self.end_of_band -= 1;
            return Ok(());
        }
        let [mut position, last] = self.scan.band;
        while position <= last {
            let symbol = self.bits.symbol(ac)?;
            let (run, length) = (usize::from(symbol >> 4), u32::from(symbol & 15));
            match (run, length) {
                (15, 0) => position += 16,
                (_, 0) => {
                    self.end_of_band = (1 << run) - 1 + self.bits.number(run as u32)?;
                    break;
                }
                _ => {
                    position += run;
                    self.bits.number(length)?;
                    if position < 64 {
                        *nonzero |= 1 << position;
                    }
                    position += 1;
                }
            }
        }
        Ok(())
    }

    /// One more bit of a band of one block: a bit for each coefficient that is not zero, and new ones between them.
    fn refined_band(&mut self, ac: &Table, nonzero: &mut u64) -> Result<(), Stop> {
        let [mut position, last] = self.scan.band;
        while position <= last && self.end_of_band == 0 {
            let symbol = self.bits.symbol(ac)?;
            let (mut run, length) = (usize::from(symbol >> 4), u32::from(symbol & 15));
            if length == 0 && run < 15 {
                self.end_of_band = (1 << run) + self.bits.number(run as u32)?;
                break;
            }
            // The sign of the new one.
            self.bits.number(u32::from(length > 0))?;
            while position <= last {
                if *nonzero >> position & 1 == 1 {
                    self.bits.number(1)?;
                } else if run == 0 {
                    break;
                } else {
                    run -= 1;
                }
                position += 1;
            }
            if length > 0 && position < 64 {
                *nonzero |= 1 << position;
            }
            position += 1;
        }
        if self.end_of_band > 0 {
            self.end_of_band -= 1;
            if position <= last {
                let band = (u64::MAX << position) & (u64::MAX >> (63 - last));
                self.bits.skip((*nonzero & band).count_ones())?;
            }
        }
        Ok(())
    }
}
