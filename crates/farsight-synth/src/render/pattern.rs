//! How a surface's colour varies, smoothed to what a pixel can show.

use super::lanes::{
    Lanes, Vec3s, add_scaled, all, all3, choose, clamp, exp2, floor, integers, mix, mix_colors, scale, smooth_step,
};
use super::noise::{Noise, TWO_OCTAVES_DEVIATION, grain, units};
use crate::scene::{Color, Material, Pattern};

/// How much of the pattern one pixel covers, along u and v.
pub(crate) type Footprint = [Lanes; 2];

/// How much lighter or darker grains can be than the mean, times two.
const GRAIN_CONTRAST: f32 = 1.0;

/// How far the noise between two colours is spread: most of the surface is near one of them.
const NOISE_CONTRAST: f32 = 1.8;

/// The same for leaves, which are in the light or in the dark.
const LEAF_CONTRAST: f32 = 2.5;

/// Light of a lit window.
const LIT_WINDOW: Color = [0.75, 0.5, 0.24];

/// What is at four places of a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Look {
    /// Colour.
    pub(crate) color: Vec3s,
    /// Light it gives off.
    pub(crate) emission: Vec3s,
    /// Factor on the material's specular and reflectivity: of a wall with windows only the panes shine.
    pub(crate) shine: Lanes,
}

/// Holes in a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Holes {
    /// Larger ones, torn by noise.
    Noise(NoiseMask),
    /// Everywhere the same: this share of each pixel is none.
    Transparent(f32),
}

/// Holes where noise is high.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NoiseMask {
    noise: Noise,
    /// Share of the surface that is none.
    solid: f32,
    /// The noise is below this where there is none.
    level: f32,
}

impl Holes {
    /// The holes of each material, if one can look through parts of it.
    pub(crate) fn of_all(materials: &[Material]) -> Vec<Option<Self>> {
        materials.iter().map(|material| Self::of(&material.pattern)).collect()
    }

    fn of(pattern: &Pattern) -> Option<Self> {
        let (scale, solid, seed) = match *pattern {
            Pattern::Leaves { scale, density, seed, .. } => (scale, density, seed),
            Pattern::Worn { scale, wear, seed } => (scale, 1.0 - wear, seed),
            Pattern::Transparent { share } => return Some(Self::Transparent(share)),
            _ => return None,
        };
        let noise = Noise { scale, octaves: 2, seed };
        (solid < 1.0).then(|| Self::Noise(NoiseMask { noise, solid, level: Noise::quantile(solid) }))
    }

    /// Share of the sun that the surface stops. Glass counts as solid: behind it is a cabin in the shade.
    pub(crate) fn shade(&self) -> f32 {
        match self {
            Self::Noise(mask) => mask.solid,
            Self::Transparent(_) => 1.0,
        }
    }
}

impl NoiseMask {
    /// Share of the places that is no hole, 0 to 1, where each covers `footprint` of the pattern.
    #[inline]
    pub(crate) fn cover(&self, uv: [Lanes; 2], footprint: Lanes) -> Lanes {
        let width = footprint * all(1.0 / self.noise.scale);
        if width.simd_lt(all(2.0)).to_bitmask() == 0 {
            return all(self.solid);
        }
        // The noise rises by about twice its deviation from feature to feature.
        let edge = clamp(width, 0.03, 1.0) * all(2.0 * TWO_OCTAVES_DEVIATION);
        let near = clamp((all(self.level) - self.noise.at(uv, Lanes::ZERO)) / edge + all(0.5), 0.0, 1.0);
        // Where a pixel covers whole tufts, it shows their share.
        near + (all(self.solid) - near) * smooth_step(all(0.5), all(2.0), width)
    }
}

/// The look of a material at `uv`.
#[inline]
pub(crate) fn look(material: &Material, uv: [Lanes; 2], footprint: Footprint) -> Look {
    let base = material.color;
    let color = match material.pattern {
        Pattern::Plain | Pattern::Transparent { .. } | Pattern::Worn { .. } => all3(base),
        Pattern::Noise { other, scale, amount, seed } => {
            let noise = Noise { scale, octaves: 4, seed };
            let share = spread(noise.at(uv, widest(footprint)), NOISE_CONTRAST);
            let color = mix_colors(base, other, share * all(amount));
            grained(color, material, uv, footprint, seed)
        }
        Pattern::Stripes { other, period, share } => {
            let per_period = all(1.0 / period);
            mix_colors(base, other, pulse(uv[1] * per_period, share, footprint[1] * per_period))
        }
        Pattern::Leaves { other, scale, seed, .. } => {
            let noise = Noise { scale, octaves: 3, seed: !seed };
            mix_colors(base, other, spread(noise.at(uv, widest(footprint)), LEAF_CONTRAST))
        }
        Pattern::Bricks { other, size, joint, variation, seed } => {
            let bricks = Cells::new(size, seed, uv, footprint).in_running_bond();
            let [across, up] = bricks.covered([joint / size[0], joint / size[1]], 0.0);
            let color = mix(bricks.interpolated(base, variation), all3(other), across + up - across * up);
            grained(color, material, uv, footprint, seed)
        }
        Pattern::Windows { other, pitch, fill, lit, seed } => {
            return windows(material, other, fill, lit, &Cells::new(pitch, seed, uv, footprint));
        }
    };
    Look { color, emission: all3(material.emission), shine: Lanes::ONE }
}

/// Noise of mean 0 as a share of mean a half.
fn spread(noise: Lanes, contrast: f32) -> Lanes {
    clamp(all(0.5) + noise * all(contrast), 0.0, 1.0)
}

/// `color`, lighter and darker from grain to grain; paint and metal have none.
fn grained(color: Vec3s, material: &Material, uv: [Lanes; 2], footprint: Footprint, seed: u32) -> Vec3s {
    if material.specular > 0.0 || material.reflectivity > 0.0 {
        return color;
    }
    scale(color, all(1.0) + all(GRAIN_CONTRAST) * grain(uv, footprint, seed))
}

fn windows(material: &Material, glass: Color, fill: [f32; 2], lit: f32, cells: &Cells) -> Look {
    let [across, up] = cells.covered(fill, 0.5);
    let panes = across * up;
    let is_lit = choose(cells.units(1).simd_lt(all(lit)), Lanes::ONE, Lanes::ZERO);
    let glow = all(lit) + (is_lit - all(lit)) * cells.shown();
    Look {
        color: mix(all3(material.color), cells.interpolated(glass, 0.7), panes),
        emission: add_scaled(all3(material.emission), all3(LIT_WINDOW), glow * panes),
        shine: panes,
    }
}

/// A regular grid of rectangles on a surface, seen at four places.
#[derive(Clone, Copy)]
struct Cells {
    seed: u32,
    /// Place and footprint, in cells.
    at: [Lanes; 2],
    footprint: Footprint,
}

impl Cells {
    fn new(size: [f32; 2], seed: u32, uv: [Lanes; 2], footprint: Footprint) -> Self {
        let per_cell = [all(1.0 / size[0]), all(1.0 / size[1])];
        let in_cells = |values: [Lanes; 2]| [values[0] * per_cell[0], values[1] * per_cell[1]];
        Self { seed, at: in_cells(uv), footprint: in_cells(footprint) }
    }

    /// Every other row moved by half a cell.
    fn in_running_bond(mut self) -> Self {
        let half_row = floor(self.at[1]) * all(0.5);
        self.at[0] += half_row - floor(half_row);
        self
    }

    /// A random number in `[0, 1)` for the cells at these places.
    fn units(&self, which: u32) -> Lanes {
        units(integers(floor(self.at[0])), integers(floor(self.at[1])), self.seed.wrapping_add(which))
    }

    /// 1 where single cells can be told apart, 0 where a pixel covers several.
    fn shown(&self) -> Lanes {
        clamp(all(2.0) - all(2.0) * widest(self.footprint), 0.0, 1.0)
    }

    /// `color` with the cells' own brightness.
    fn interpolated(&self, color: Color, variation: f32) -> Vec3s {
        scale(all3(color), exp2((self.units(0) - all(0.5)) * all(2.0 * variation) * self.shown()))
    }

    /// Share of the pixel, across and up, that lies within `shares` of the cells, around `middle` of each (0 is its
    /// border).
    fn covered(&self, shares: [f32; 2], middle: f32) -> [Lanes; 2] {
        let axis = |i: usize| pulse(self.at[i] + all(0.5 * shares[i] - middle), shares[i], self.footprint[i]);
        [axis(0), axis(1)]
    }
}

#[inline]
pub(crate) fn widest(footprint: Footprint) -> Lanes {
    footprint[0].fast_max(footprint[1])
}

/// Mean, over `width` around `x`, of the function that is 1 in the first `share` of every unit and 0 in the rest.
#[inline]
fn pulse(x: Lanes, share: f32, width: Lanes) -> Lanes {
    let width = width.fast_max(all(1e-3));
    let x = x - floor(x);
    let integral = |x: Lanes| {
        let whole = floor(x);
        whole * all(share) + (x - whole).fast_min(all(share))
    };
    let half = all(0.5) * width;
    (integral(x + half) - integral(x - half)) / width
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pulse_is_sharp_near_and_its_mean_far() {
        let at = |x: f32, width: f32| pulse(all(x), 0.3, all(width)).to_array()[0];
        for (x, expected) in [(0.1, 1.0), (0.29, 1.0), (0.31, 0.0), (7.1, 1.0), (-0.9, 1.0), (0.9, 0.0), (0.3, 0.5)] {
            assert!((at(x, 0.0) - expected).abs() < 1e-2, "pulse at {x}");
        }
        assert!((at(0.77, 50.0) - 0.3).abs() < 0.02);
    }

    #[test]
    fn holes_take_their_share_near_and_far() {
        let leaves = Pattern::Leaves { other: [0.0; 3], scale: 0.5, density: 0.6, seed: 3 };
        let Some(Holes::Noise(holes)) = Holes::of(&leaves) else { panic!("leaves have holes") };
        for footprint in [0.01, 0.3, 0.7, 4.0] {
            let places = (0..10_000).map(|i| [all((i % 100) as f32 * 0.23), all((i / 100) as f32 * 0.23)]);
            let mean = places.map(|uv| holes.cover(uv, all(footprint)).to_array()[0]).sum::<f32>() / 10_000.0;
            assert!((mean - 0.6).abs() < 0.06, "{mean} of the surface is leaf at footprint {footprint}");
        }
    }

    #[test]
    fn windows_shine_and_walls_do_not() {
        let pattern = Pattern::Windows { other: [0.0; 3], pitch: [2.0, 3.0], fill: [0.5, 0.5], lit: 1.0, seed: 1 };
        let wall =
            Material { color: [0.5; 3], pattern, specular: 0.0, shininess: 1.0, reflectivity: 0.1, emission: [0.0; 3] };
        let near = [all(0.01); 2];
        let pane = look(&wall, [all(1.0), all(1.5)], near);
        let border = look(&wall, [all(0.1), all(1.5)], near);
        let [pane_shine, border_shine] = [pane, border].map(|look| look.shine.to_array()[0]);
        assert!((pane_shine - 1.0).abs() < 1e-3 && border_shine.abs() < 1e-3, "{pane_shine} and {border_shine}");
        assert!(pane.emission[0].to_array()[0] > 0.5 && border.emission[0].to_array()[0] < 1e-3);
        assert!((border.color[0].to_array()[0] - 0.5).abs() < 1e-3);
    }
}
