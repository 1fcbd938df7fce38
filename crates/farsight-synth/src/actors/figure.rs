//! Bodies: what people wear, and how their limbs are drawn.
//!
//! For a person of 1.75 m; the whole is stretched to its size afterwards.

use super::{Detail, Workshop};
use crate::dice::Dice;
use crate::palette::{Palette, any_color, grey, matte, times, varied};
use crate::scene::{Color, Material, MaterialId, Pattern, Vec3};
use crate::shape::{Shape, sin_cos};
use crate::vector::{add, dot, length, mix, scale, sub, unit};

const THIGH_M: f32 = 0.43;
const SHANK_M: f32 = 0.42;
const UPPER_ARM_M: f32 = 0.29;
const FOREARM_M: f32 = 0.27;

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
enum Below {
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
enum Hair {
    Short,
    Long,
    Bald,
    Hat,
}

/// How someone looks: clothes, hair and build.
pub(super) struct Outfit {
    skin: MaterialId,
    hair: MaterialId,
    hair_style: Hair,
    top: MaterialId,
    /// What an open jacket shows, otherwise the top itself.
    front: MaterialId,
    sleeves: Sleeves,
    trousers: MaterialId,
    below: Below,
    shoes: MaterialId,
    pub(super) bag: MaterialId,
    /// Factors on the width of the shoulders, and on that of waist and hips.
    shoulders: f32,
    girth: f32,
    /// How much wider than the leg trousers are, metres.
    loose: f32,
}

impl Outfit {
    pub(super) fn draw(workshop: &mut Workshop) -> Self {
        let dice = &mut workshop.dice;
        let palette = &mut *workshop.palette;
        let skin = dice.weighted(&SKIN);
        let hair = dice.weighted(&HAIR);
        let top_color = if dice.chance(0.2) { any_color(dice) } else { dice.weighted(&TOPS) };
        let trousers_color = if dice.chance(0.08) { any_color(dice) } else { dice.weighted(&TROUSERS) };
        let top = cloth(palette, top_color, dice);
        let open = dice.chance(0.2);
        let shirt_color = dice.weighted(&TOPS);
        Self {
            skin: palette.matte(varied(dice, skin, 0.15)),
            hair: palette.matte(varied(dice, hair, 0.3)),
            hair_style: dice.weighted(&[(Hair::Short, 5.0), (Hair::Long, 3.0), (Hair::Bald, 0.7), (Hair::Hat, 0.8)]),
            top,
            front: if open { cloth(palette, shirt_color, dice) } else { top },
            sleeves: if open {
                Sleeves::Long
            } else {
                dice.weighted(&[(Sleeves::Long, 5.0), (Sleeves::Short, 3.5), (Sleeves::None, 0.7)])
            },
            trousers: cloth(palette, trousers_color, dice),
            below: dice.weighted(&[
                (Below::Trousers, 6.5),
                (Below::Shorts, 1.3),
                (Below::Skirt, 1.2),
                (Below::Coat, 1.0),
            ]),
            shoes: palette.matte(grey(dice.pick(&[0.015, 0.02, 0.05, 0.5]))),
            bag: palette.matte(any_color(dice)),
            shoulders: dice.range32(0.85, 1.1),
            girth: dice.range32(0.88, 1.25),
            loose: dice.range32(0.0, 0.025),
        }
    }

    /// Material of thighs and shanks.
    fn legs(&self) -> [MaterialId; 2] {
        match self.below {
            Below::Trousers | Below::Coat => [self.trousers; 2],
            Below::Shorts => [self.trousers, self.skin],
            Below::Skirt => [self.skin; 2],
        }
    }

    /// Material of upper arms and forearms.
    fn arms(&self) -> [MaterialId; 2] {
        match self.sleeves {
            Sleeves::Long => [self.top; 2],
            Sleeves::Short => [self.top, self.skin],
            Sleeves::None => [self.skin; 2],
        }
    }
}

/// Cloth of this colour: mostly with folds, at times with stripes.
fn cloth(palette: &mut Palette, color: Color, dice: &mut Dice) -> MaterialId {
    let color = varied(dice, color, 0.3);
    let scale = dice.range32(0.12, 0.35);
    let folds = Pattern::Noise { other: times(color, 0.5), scale, amount: 0.7, seed: dice.seed() };
    let other = any_color(dice);
    let stripes = Pattern::Stripes { other, period: dice.range32(0.05, 0.16), share: dice.range32(0.2, 0.5) };
    let pattern = dice.weighted(&[(folds, 7.0), (stripes, 1.2), (Pattern::Plain, 1.5)]);
    palette.add(Material { pattern, ..matte(color) })
}

/// Draws a body.
pub(super) struct Figure<'a> {
    pub(super) shape: &'a mut Shape,
    pub(super) detail: Detail,
    pub(super) outfit: &'a Outfit,
}

impl Figure<'_> {
    fn limb(&mut self, joints: &[(Vec3, f32)], material: MaterialId) {
        let sides = self.detail.sides(8);
        for pair in joints.windows(2) {
            self.shape.tube(pair[0].0, pair[1].0, [pair[0].1, pair[1].1], sides, material);
        }
        if self.detail == Detail::Near {
            for (joint, radius) in joints.iter().skip(1) {
                self.shape.ball(*joint, [*radius; 3], [3, 6], material, || 0.0);
            }
        }
    }

    /// A level oval of half depth and half width around `center`, closed.
    fn oval(&self, center: Vec3, [depth, width]: [f32; 2]) -> Vec<Vec3> {
        let sides = self.detail.sides(12);
        (0..=sides)
            .map(|k| {
                let (sin, cos) = sin_cos(std::f32::consts::TAU * k as f32 / sides as f32);
                [center[0] + cos * depth, center[1], center[2] + sin * width]
            })
            .collect()
    }

    /// From the seat to the neck.
    pub(super) fn trunk(&mut self, hips: Vec3, neck: Vec3) {
        let Outfit { shoulders, girth, top, front, trousers, below, .. } = *self.outfit;
        // Share of the way up, half depth, half width.
        let rows = [
            (0.0, 0.09, 0.14),
            (0.12, 0.12 * girth, 0.165 * girth),
            (0.36, 0.105 * girth, 0.145 * girth),
            (0.66, 0.125, 0.175 * shoulders),
            (0.84, 0.105, 0.195 * shoulders),
            (0.93, 0.085, 0.13 * shoulders),
            (1.0, 0.055, 0.06),
        ];
        let sections: Vec<_> =
            rows.iter().map(|&(t, depth, width)| self.oval(mix(hips, neck, t), [depth, width])).collect();
        let sides = sections[0].len() - 1;
        self.shape.skin(&sections, |row, side| {
            Some(match (row, side) {
                (0, _) if below != Below::Coat => trousers,
                // The faces on both sides of the seam in front.
                (_, side) if side == 0 || side == sides - 1 => front,
                _ => top,
            })
        });
    }

    /// Skirt or coat around the legs, where one is worn.
    pub(super) fn hem(&mut self, hips: Vec3) {
        let girth = self.outfit.girth;
        let (material, low) = match self.outfit.below {
            Below::Skirt => (self.outfit.trousers, -0.5),
            Below::Coat => (self.outfit.top, -0.55),
            Below::Trousers | Below::Shorts => return,
        };
        let rows = [(hips[1] - 0.12, [0.13, 0.175]), (hips[1], [0.145, 0.185]), (low, [0.18, 0.2])];
        let sections: Vec<_> = rows
            .iter()
            .map(|&(y, [depth, width])| self.oval([hips[0], y, hips[2]], [depth * girth, width * girth]))
            .collect();
        self.shape.skin(&sections, |_, _| Some(material));
    }

    /// Neck, face and hair, or a helmet.
    pub(super) fn head(&mut self, neck: Vec3, helmet: Option<MaterialId>) {
        let Outfit { skin, hair, hair_style, top, .. } = *self.outfit;
        let rings = [self.detail.sides(6), self.detail.sides(10)];
        let at = |x: f32, y: f32| [neck[0] + x, neck[1] + y, neck[2]];
        self.limb(&[(at(0.0, 0.02), 0.055), (at(0.02, -0.06), 0.05)], skin);
        self.shape.ball(at(0.02, -0.15), [0.095, 0.125, 0.078], rings, skin, || 0.0);
        if hair_style == Hair::Long {
            self.shape.ball(at(-0.05, -0.1), [0.075, 0.17, 0.09], rings, hair, || 0.0);
        }
        if let Some(helmet) = helmet {
            self.shape.ball(at(0.0, -0.23), [0.14, 0.085, 0.105], rings, helmet, || 0.0);
            return;
        }
        match hair_style {
            Hair::Short | Hair::Long => self.shape.ball(at(-0.008, -0.18), [0.098, 0.115, 0.088], rings, hair, || 0.0),
            Hair::Bald => {}
            Hair::Hat => {
                self.shape.ball(at(0.01, -0.23), [0.11, 0.08, 0.1], rings, top, || 0.0);
                self.shape.ball(at(0.09, -0.2), [0.08, 0.015, 0.075], rings, top, || 0.0);
            }
        }
    }

    /// A leg whose knee points forward, and a foot that points along `toe` from the ankle.
    pub(super) fn leg(&mut self, hip: Vec3, ankle: Vec3, toe: Vec3) {
        let Outfit { girth, loose, shoes, .. } = *self.outfit;
        let [thigh, shank] = self.outfit.legs();
        let knee = bent(hip, ankle, [THIGH_M, SHANK_M], [1.0, 0.0, 0.0]);
        self.limb(&[(hip, 0.085 * girth), (knee, 0.06 + loose)], thigh);
        self.limb(&[(knee, 0.055 + loose), (ankle, 0.04 + loose)], shank);
        let heel = add(ankle, scale(toe, -0.2));
        self.limb(&[(add(heel, [0.0, 0.02, 0.0]), 0.04), (add(ankle, toe), 0.032)], shoes);
    }

    /// An arm whose elbow points towards `elbow`.
    pub(super) fn arm(&mut self, shoulder: Vec3, hand: Vec3, elbow: Vec3) {
        let [upper, forearm] = self.outfit.arms();
        let joint = bent(shoulder, hand, [UPPER_ARM_M, FOREARM_M], elbow);
        self.limb(&[(shoulder, 0.055), (joint, 0.045)], upper);
        self.limb(&[(joint, 0.043), (hand, 0.03)], forearm);
        self.shape.ball(add(hand, [0.0, 0.03, 0.0]), [0.04, 0.055, 0.03], [3, 6], self.outfit.skin, || 0.0);
    }
}

/// Where two bones between `from` and `to` meet, bent towards `towards`; on the straight line where they do not reach.
fn bent(from: Vec3, to: Vec3, [first, second]: [f32; 2], towards: Vec3) -> Vec3 {
    let way = sub(to, from);
    let span = length(way).max(1e-3);
    let axis = unit(way);
    if span >= first + second {
        return mix(from, to, first / (first + second));
    }
    let along = (first * first - second * second + span * span) / (2.0 * span);
    let out = (first * first - along * along).max(0.0).sqrt();
    let side = unit(sub(towards, scale(axis, dot(towards, axis))));
    add(add(from, scale(axis, along)), scale(side, out))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BONES: [f32; 2] = [THIGH_M, SHANK_M];

    #[test]
    fn bones_keep_their_lengths_and_bend_where_they_are_told_to() {
        let hip = [0.1, -0.9, 0.05];
        for towards in [[1.0, 0.0, 0.0], [-1.0, 0.2, 0.5]] {
            for ankle in [[0.3, -0.2, 0.1], [-0.4, -0.3, 0.0], [0.1, -0.5, -0.2]] {
                let knee = bent(hip, ankle, BONES, towards);
                assert!((length(sub(knee, hip)) - THIGH_M).abs() < 1e-5);
                assert!((length(sub(ankle, knee)) - SHANK_M).abs() < 1e-5);
                let straight = mix(hip, ankle, 0.5);
                assert!(dot(sub(knee, straight), towards) > 0.0, "{knee:?} bends away from {towards:?}");
            }
        }
    }

    #[test]
    fn what_bones_cannot_reach_is_on_a_straight_line() {
        let knee = bent([0.0; 3], [2.0, 0.0, 0.0], BONES, [0.0, 1.0, 0.0]);
        assert!((knee[0] - 2.0 * THIGH_M / (THIGH_M + SHANK_M)).abs() < 1e-6);
        assert_eq!([knee[1], knee[2]].map(f32::to_bits), [0; 2]);
    }
}
