//! What people wear, and how they are built.

use super::context::BuildContext;
use crate::palette::{Palette, any_color, grey, matte, times, varied};
use crate::rng::SceneRng;
use crate::scene::{Color, Material, MaterialId, Pattern};

const SKIN: [(Color, f64); 4] =
    [([0.55, 0.34, 0.25], 5.0), ([0.42, 0.24, 0.16], 3.0), ([0.2, 0.1, 0.06], 1.5), ([0.08, 0.04, 0.03], 1.0)];
const HAIR: [(Color, f64); 4] =
    [([0.012, 0.01, 0.01], 4.0), ([0.08, 0.05, 0.03], 3.0), ([0.4, 0.4, 0.4], 1.0), ([0.35, 0.24, 0.1], 1.0)];
const TOPS: [(Color, f64); 9] = [
    ([0.02, 0.02, 0.025], 5.0),
    ([0.7, 0.7, 0.68], 3.0),
    ([0.15, 0.16, 0.17], 3.0),
    ([0.03, 0.06, 0.18], 2.5),
    ([0.4, 0.04, 0.04], 1.5),
    ([0.3, 0.24, 0.15], 1.5),
    ([0.06, 0.14, 0.07], 1.0),
    ([0.25, 0.45, 0.65], 1.0),
    ([0.7, 0.35, 0.05], 0.7),
];
const TROUSERS: [(Color, f64); 6] = [
    ([0.02, 0.02, 0.025], 4.0),
    ([0.04, 0.07, 0.16], 3.0),
    ([0.12, 0.18, 0.3], 1.5),
    ([0.16, 0.15, 0.14], 2.0),
    ([0.4, 0.34, 0.25], 1.5),
    ([0.6, 0.6, 0.58], 0.7),
];

/// What is worn from the waist down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Below {
    Trousers,
    Shorts,
    Skirt,
    /// Trousers under a coat that reaches to the knees.
    Coat,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sleeves {
    Long,
    Short,
    None,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hair {
    Short,
    Long,
    Bald,
    Hat,
}

/// How someone looks: clothes, hair and build.
pub(super) struct Outfit {
    pub(super) skin: MaterialId,
    pub(super) hair: MaterialId,
    pub(super) hair_style: Hair,
    pub(super) top: MaterialId,
    /// What an open jacket shows, otherwise the top itself.
    pub(super) front: MaterialId,
    sleeves: Sleeves,
    pub(super) trousers: MaterialId,
    pub(super) below: Below,
    pub(super) shoes: MaterialId,
    pub(super) bag: MaterialId,
    /// Factors on the width of the shoulders, and on that of waist and hips.
    pub(super) shoulders: f32,
    pub(super) girth: f32,
    /// How much wider than the leg trousers are, metres.
    pub(super) loose: f32,
}

impl Outfit {
    pub(super) fn sample(context: &mut BuildContext) -> Self {
        let rng = &mut context.rng;
        let palette = &mut *context.palette;
        let skin = rng.weighted(&SKIN);
        let hair = rng.weighted(&HAIR);
        let top_color = if rng.chance(0.2) { any_color(rng) } else { rng.weighted(&TOPS) };
        let trousers_color = if rng.chance(0.08) { any_color(rng) } else { rng.weighted(&TROUSERS) };
        let top = cloth(palette, top_color, rng);
        let open = rng.chance(0.2);
        let shirt_color = rng.weighted(&TOPS);
        Self {
            skin: palette.matte(varied(rng, skin, 0.15)),
            hair: palette.matte(varied(rng, hair, 0.3)),
            hair_style: rng.weighted(&[(Hair::Short, 5.0), (Hair::Long, 3.0), (Hair::Bald, 0.7), (Hair::Hat, 0.8)]),
            top,
            front: if open { cloth(palette, shirt_color, rng) } else { top },
            sleeves: if open {
                Sleeves::Long
            } else {
                rng.weighted(&[(Sleeves::Long, 5.0), (Sleeves::Short, 3.5), (Sleeves::None, 0.7)])
            },
            trousers: cloth(palette, trousers_color, rng),
            below: rng.weighted(&[
                (Below::Trousers, 6.5),
                (Below::Shorts, 1.3),
                (Below::Skirt, 1.2),
                (Below::Coat, 1.0),
            ]),
            shoes: palette.matte(grey(rng.pick(&[0.015, 0.02, 0.05, 0.5]))),
            bag: palette.matte(any_color(rng)),
            shoulders: rng.range32(0.85, 1.1),
            girth: rng.range32(0.88, 1.25),
            loose: rng.range32(0.0, 0.025),
        }
    }

    /// Material of thighs and shanks.
    pub(super) fn legs(&self) -> [MaterialId; 2] {
        match self.below {
            Below::Trousers | Below::Coat => [self.trousers; 2],
            Below::Shorts => [self.trousers, self.skin],
            Below::Skirt => [self.skin; 2],
        }
    }

    /// Material of upper arms and forearms.
    pub(super) fn arms(&self) -> [MaterialId; 2] {
        match self.sleeves {
            Sleeves::Long => [self.top; 2],
            Sleeves::Short => [self.top, self.skin],
            Sleeves::None => [self.skin; 2],
        }
    }
}

/// Cloth of this colour: mostly with folds, at times with stripes.
fn cloth(palette: &mut Palette, color: Color, rng: &mut SceneRng) -> MaterialId {
    let color = varied(rng, color, 0.3);
    let scale = rng.range32(0.12, 0.35);
    let folds = Pattern::Noise { other: times(color, 0.5), scale, amount: 0.7, seed: rng.seed() };
    let other = any_color(rng);
    let stripes = Pattern::Stripes { other, period: rng.range32(0.05, 0.16), share: rng.range32(0.2, 0.5) };
    let pattern = rng.weighted(&[(folds, 7.0), (stripes, 1.2), (Pattern::Plain, 1.5)]);
    palette.add(Material { pattern, ..matte(color) })
}
