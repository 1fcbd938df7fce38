//! What a mesh is built from: materials, random draws, level of detail, and what it is doing.

use serde::Deserialize;

use crate::palette::{CAR_COLORS, Palette, any_color, grey, varied};
use crate::rng::SceneRng;
use crate::scene::{Color, MaterialId};

/// How finely something is built, by its distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Detail {
    Far,
    Middle,
    Near,
}

impl Detail {
    /// What an object at this distance needs, for a camera of this focal length.
    pub(crate) fn at(distance_m: f64, focal_px: f64) -> Self {
        let metre_px = focal_px / distance_m.max(1.0);
        match metre_px {
            px if px > 24.0 => Self::Near,
            px if px > 11.0 => Self::Middle,
            _ => Self::Far,
        }
    }

    /// `near` corners around something round, fewer farther away.
    pub(crate) fn sides(self, near: usize) -> usize {
        match self {
            Self::Near => near,
            Self::Middle => (near * 2 / 3).max(5),
            Self::Far => (near * 2 / 5).max(4),
        }
    }
}

/// Parts of two steps.
pub(crate) const STRIDE: u8 = 16;

/// What a labelled object is doing, as far as it shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct ObjectState {
    /// Lamps are lit.
    pub(crate) lights_on: bool,
    /// Brake lamps are lit.
    pub(crate) braking: bool,
    /// Someone may be driving, walking, riding; otherwise it is parked.
    pub(crate) moving: bool,
    /// Where someone on foot is in two steps, in [`STRIDE`] parts; none where a posture is to be drawn.
    pub(crate) stride: Option<u8>,
}

/// Paint of private cars, shares.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Paint {
    pub(crate) white: f64,
    /// From silver to black.
    pub(crate) grey: f64,
    pub(crate) colored: f64,
}

/// A kind of number plate.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlateFormat {
    /// Relative frequency.
    pub(crate) share: f64,
    /// Width and height, metres.
    pub(crate) size_m: [f32; 2],
    /// Figures of a line, and lines.
    pub(crate) figures: usize,
    pub(crate) lines: usize,
    pub(crate) ground: Color,
    pub(crate) ink: Color,
    /// A blue end with the country's letters.
    #[serde(default)]
    pub(crate) band: bool,
    /// Share of vehicles that have one in front, too.
    #[serde(default = "always")]
    pub(crate) in_front: f64,
}

fn always() -> f64 {
    1.0
}

/// What vehicles of a region have in common, and this one's plates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Look {
    pub(crate) plate: PlateFormat,
    pub(crate) has_front_plate: bool,
    pub(crate) paint: Paint,
    /// The colours that this kind of vehicle comes in, where it has its own.
    pub(crate) colors: &'static [Color],
}

impl Look {
    /// Draws the paint of a private car.
    pub(super) fn car_color(&self, rng: &mut SceneRng, unusual: bool) -> Color {
        /// Least saturation of a colour that counts as one: difference of its channels over the largest.
        const COLORED: f32 = 0.2;
        if unusual {
            return any_color(rng);
        }
        let saturation = |[r, g, b]: Color| 1.0 - r.min(g).min(b) / r.max(g).max(b);
        let color = match rng.weighted(&[(0, self.paint.white), (1, self.paint.grey), (2, self.paint.colored)]) {
            0 => [0.78, 0.78, 0.76],
            1 => grey(rng.pick(&[0.018, 0.02, 0.04, 0.08, 0.2, 0.4, 0.42])),
            _ => {
                let colored: Vec<_> =
                    CAR_COLORS.into_iter().filter(|(color, _)| saturation(*color) > COLORED).collect();
                rng.weighted(&colored)
            }
        };
        let aged = rng.range32(0.75, 1.15);
        varied(rng, color, 0.12).map(|c| (c * aged).min(0.85))
    }
}

/// Everything that a mesh is drawn from.
pub(crate) struct BuildContext<'a> {
    pub(crate) palette: &'a mut Palette,
    pub(crate) rng: SceneRng,
    pub(crate) detail: Detail,
    pub(crate) state: ObjectState,
    /// Colours that no factory makes.
    pub(crate) unusual: bool,
    /// What number plates are made of, once something that has some is built.
    pub(crate) plate: Option<MaterialId>,
    /// What the region says; none in KITTI's city.
    pub(crate) look: Option<Look>,
}
