//! How a surface's colour varies, smoothed to what a pixel can show.

use super::noise::{Noise, TWO_OCTAVES_DEVIATION, hash, unit};
use crate::scene::{Color, Material, Pattern};
use crate::vector::{add, exp2, floor, mix, scale, smooth_step};

/// How much of the pattern one pixel covers, along u and v.
pub(crate) type Footprint = [f32; 2];

/// Light of a lit window.
const LIT_WINDOW: Color = [0.75, 0.5, 0.24];

/// What is at one place of a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Look {
    /// Colour.
    pub(crate) color: Color,
    /// Light it gives off.
    pub(crate) emission: Color,
    /// Factor on the material's gloss and mirror: of a wall with windows only the panes shine.
    pub(crate) shine: f32,
}

/// Holes in a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Holes {
    noise: Noise,
    /// Share of the surface that is none.
    pub(crate) solid: f32,
    /// The noise is below this where there is none.
    level: f32,
}

impl Holes {
    /// The holes of a pattern, if one can look through parts of it.
    #[inline]
    pub(crate) fn of(pattern: &Pattern) -> Option<Self> {
        let (scale, solid, seed) = match *pattern {
            Pattern::Leaves { scale, density, seed, .. } => (scale, density, seed),
            Pattern::Worn { scale, wear, seed } => (scale, 1.0 - wear, seed),
            _ => return None,
        };
        let noise = Noise { scale, octaves: 2, seed };
        (solid < 1.0).then(|| Self { noise, solid, level: Noise::quantile(solid) })
    }

    /// Share of the pixel that is no hole, 0 to 1.
    #[inline]
    pub(crate) fn cover(&self, uv: [f32; 2], footprint: Footprint) -> f32 {
        let width = widest(footprint) / self.noise.scale;
        if width >= 2.0 {
            return self.solid;
        }
        // A pixel's width of noise: it rises by about twice its deviation from feature to feature.
        let edge = 2.0 * TWO_OCTAVES_DEVIATION * width.clamp(0.05, 1.0);
        let near = ((self.level - self.noise.at(uv, 0.0)) / edge + 0.5).clamp(0.0, 1.0);
        // Where a pixel covers whole tufts, it shows their share.
        if width <= 0.5 { near } else { near + (self.solid - near) * smooth_step(0.5, 2.0, width) }
    }
}

/// The look of a material at `uv`.
pub(crate) fn look(material: &Material, uv: [f32; 2], footprint: Footprint) -> Look {
    let base = material.color;
    let color = match material.pattern {
        Pattern::Plain | Pattern::Worn { .. } => base,
        Pattern::Noise { other, scale, amount, seed } => {
            let noise = Noise { scale, octaves: 4, seed };
            mix(base, other, (0.5 + noise.at(uv, widest(footprint))) * amount)
        }
        Pattern::Stripes { other, period, share } => {
            mix(base, other, pulse(uv[1] / period, share, footprint[1] / period))
        }
        Pattern::Leaves { other, scale, seed, .. } => {
            let noise = Noise { scale, octaves: 3, seed: !seed };
            mix(base, other, 0.5 + noise.at(uv, widest(footprint)))
        }
        Pattern::Bricks { other, size, joint, variation, seed } => {
            let wall = Cells { size, seed, uv, footprint };
            let shifted = wall.in_running_bond();
            let joints = shifted.covered([joint / size[0], joint / size[1]], joins);
            mix(shifted.varied(base, variation), other, joints)
        }
        Pattern::Windows { other, pitch, fill, lit, seed } => {
            return windows(material, other, fill, lit, &Cells { size: pitch, seed, uv, footprint });
        }
    };
    Look { color, emission: material.emission, shine: 1.0 }
}

fn windows(material: &Material, glass: Color, fill: [f32; 2], lit: f32, cells: &Cells) -> Look {
    let panes = cells.covered(fill, |across, up| across * up);
    let shown = cells.shown();
    let is_lit = if unit(cells.hash(1)) < lit { 1.0 } else { 0.0 };
    let glow = lit + (is_lit - lit) * shown;
    let glass = cells.varied(glass, 0.7);
    Look {
        color: mix(material.color, glass, panes),
        emission: add(material.emission, scale(LIT_WINDOW, glow * panes)),
        shine: panes,
    }
}

/// Where either of two shares of a cell is covered.
fn joins(across: f32, up: f32) -> f32 {
    across + up - across * up
}

/// A regular grid of rectangles on a surface, seen at one place.
#[derive(Clone, Copy)]
struct Cells {
    size: [f32; 2],
    seed: u32,
    uv: [f32; 2],
    footprint: Footprint,
}

impl Cells {
    /// Every other row moved by half a cell.
    fn in_running_bond(mut self) -> Self {
        let row = floor(self.uv[1] / self.size[1]);
        self.uv[0] += 0.5 * self.size[0] * (row & 1) as f32;
        self
    }

    /// A number of the cell at this place.
    fn hash(&self, which: u32) -> u32 {
        let cell = |axis: usize| floor(self.uv[axis] / self.size[axis]);
        hash(cell(0), cell(1), self.seed.wrapping_add(which))
    }

    /// 1 where single cells can be told apart, 0 where a pixel covers several.
    fn shown(&self) -> f32 {
        let cells = [0, 1].map(|axis| self.footprint[axis] / self.size[axis]);
        (2.0 - 2.0 * widest(cells)).clamp(0.0, 1.0)
    }

    /// `color` with the cell's own brightness.
    fn varied(&self, color: Color, variation: f32) -> Color {
        scale(color, exp2((unit(self.hash(0)) - 0.5) * 2.0 * variation * self.shown()))
    }

    /// Share of the pixel within `shares` of the cells, around their borders of whole numbers.
    fn covered(&self, shares: [f32; 2], both: fn(f32, f32) -> f32) -> f32 {
        let [across, up] = [0, 1].map(|axis| {
            let (at, width) = (self.uv[axis] / self.size[axis], self.footprint[axis] / self.size[axis]);
            pulse(at - 0.5 + 0.5 * shares[axis], shares[axis], width)
        });
        both(across, up)
    }
}

#[inline]
fn widest(footprint: Footprint) -> f32 {
    footprint[0].max(footprint[1])
}

/// Mean, over `width` around `x`, of the function that is 1 in the first `share` of every unit and 0 in the rest.
fn pulse(x: f32, share: f32, width: f32) -> f32 {
    let width = width.max(1e-3);
    let x = x - floor(x) as f32;
    let integral = |x: f32| {
        let whole = floor(x) as f32;
        whole * share + (x - whole).min(share)
    };
    (integral(x + 0.5 * width) - integral(x - 0.5 * width)) / width
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pulse_is_sharp_near_and_its_mean_far() {
        for (x, expected) in [(0.1, 1.0), (0.29, 1.0), (0.31, 0.0), (7.1, 1.0), (-0.9, 1.0), (0.9, 0.0), (0.3, 0.5)] {
            assert!((pulse(x, 0.3, 0.0) - expected).abs() < 1e-2, "pulse at {x}");
        }
        assert!((pulse(0.77, 0.3, 50.0) - 0.3).abs() < 0.02);
    }

    #[test]
    fn holes_take_their_share_near_and_far() {
        let leaves = Pattern::Leaves { other: [0.0; 3], scale: 0.5, density: 0.6, seed: 3 };
        let holes = Holes::of(&leaves).expect("holes");
        for footprint in [0.01, 0.3, 0.7, 4.0] {
            let places = (0..10_000).map(|i| [(i % 100) as f32 * 0.23, (i / 100) as f32 * 0.23]);
            let mean = places.map(|uv| holes.cover(uv, [footprint; 2])).sum::<f32>() / 10_000.0;
            assert!((mean - 0.6).abs() < 0.06, "{mean} of the surface is leaf at footprint {footprint}");
        }
    }
}
