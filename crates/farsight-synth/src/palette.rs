//! Materials by name: what a scene is made of, collected while it is built.

use crate::rng::SceneRng;
use crate::scene::{Color, Material, MaterialId, Pattern};

/// Share of red, green and blue in what the eye sees as grey (ITU-R BT.709, linear light).
pub(crate) const LUMA: Color = [0.2126, 0.7152, 0.0722];

/// Colours of cars and how often they are drawn: mostly black, grey, silver and white, as in Europe's streets. Chosen
/// by eye, not counted.
pub(crate) const CAR_COLORS: [(Color, f64); 14] = [
    ([0.018, 0.018, 0.02], 24.0),
    ([0.40, 0.41, 0.42], 17.0),
    ([0.20, 0.21, 0.22], 12.0),
    ([0.075, 0.08, 0.09], 9.0),
    ([0.78, 0.78, 0.76], 15.0),
    ([0.015, 0.04, 0.15], 6.0),
    ([0.05, 0.14, 0.36], 3.5),
    ([0.36, 0.02, 0.02], 4.5),
    ([0.16, 0.015, 0.02], 2.0),
    ([0.02, 0.09, 0.05], 2.0),
    ([0.14, 0.10, 0.06], 2.0),
    ([0.50, 0.44, 0.32], 2.0),
    ([0.75, 0.52, 0.03], 1.0),
    ([0.60, 0.18, 0.02], 0.7),
];

/// The materials of a scene in the making.
#[derive(Debug, Default)]
pub(crate) struct Palette {
    pub(crate) materials: Vec<Material>,
}

impl Palette {
    /// The number of a new material. A scene needs a few hundred; past the last number there is, the last is used
    /// again.
    pub(crate) fn add(&mut self, material: Material) -> MaterialId {
        if self.materials.len() < usize::from(MaterialId::MAX) {
            self.materials.push(material);
        }
        (self.materials.len() - 1) as MaterialId
    }

    pub(crate) fn matte(&mut self, color: Color) -> MaterialId {
        self.add(matte(color))
    }

    pub(crate) fn noise(&mut self, color: Color, other: Color, scale: f32, seed: u32) -> MaterialId {
        self.add(Material { pattern: Pattern::Noise { other, scale, amount: 1.0, seed }, ..matte(color) })
    }

    pub(crate) fn glowing(&mut self, color: Color, emission: Color) -> MaterialId {
        self.add(Material { emission, specular: 0.5, shininess: 60.0, reflectivity: 0.05, ..matte(color) })
    }

    pub(crate) fn glossy(&mut self, color: Color, specular: f32, shininess: f32, reflectivity: f32) -> MaterialId {
        self.add(Material { specular, shininess, reflectivity, ..matte(color) })
    }
}

/// A surface without shine.
pub(crate) fn matte(color: Color) -> Material {
    Material { color, pattern: Pattern::Plain, specular: 0.0, shininess: 1.0, reflectivity: 0.0, emission: [0.0; 3] }
}

pub(crate) fn grey(value: f32) -> Color {
    [value; 3]
}

pub(crate) fn times(color: Color, by: f32) -> Color {
    color.map(|c| c * by)
}

/// `color` with each channel up to `reach` (a share) brighter or darker, and all together likewise.
pub(crate) fn varied(rng: &mut SceneRng, color: Color, reach: f32) -> Color {
    let all = 1.0 + rng.range32(-reach, reach);
    color.map(|c| (c * all * (1.0 + 0.4 * rng.range32(-reach, reach))).clamp(0.0, 1.0))
}

/// A colour from hue (0 to 1), saturation and value, linear light.
pub(crate) fn from_hsv(hue: f32, saturation: f32, value: f32) -> Color {
    let channel = |n: f32| {
        let k = (n + hue * 6.0).rem_euclid(6.0);
        value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0))
    };
    [channel(5.0), channel(3.0), channel(1.0)]
}

/// Any colour at all.
pub(crate) fn any_color(rng: &mut SceneRng) -> Color {
    let (hue, saturation) = (rng.range32(0.0, 1.0), rng.range32(0.0, 1.0));
    from_hsv(hue, saturation, rng.range32(0.02, 0.8))
}
