//! Bodies of people, limb by limb.
//!
//! For a person of 1.75 m; the whole is stretched to its size afterwards.

use super::context::Detail;
use super::outfit::{Below, Hair, Outfit};
use crate::mesh_builder::{MeshBuilder, sin_cos};
use crate::scene::{MaterialId, Vec3};
use crate::vector::{add, dot, length, mix, scale, sub, unit};

const THIGH_M: f32 = 0.43;
const SHANK_M: f32 = 0.42;
const UPPER_ARM_M: f32 = 0.29;
const FOREARM_M: f32 = 0.27;

/// Draws a body.
pub(super) struct HumanMesh<'a> {
    pub(super) shape: &'a mut MeshBuilder,
    pub(super) detail: Detail,
    pub(super) outfit: &'a Outfit,
}

impl HumanMesh<'_> {
    fn limb(&mut self, joints: &[(Vec3, f32)], material: MaterialId) {
        let sides = self.detail.sides(8);
        for pair in joints.windows(2) {
            self.shape.tube(pair[0].0, pair[1].0, [pair[0].1, pair[1].1], sides, material);
        }
        if self.detail == Detail::Near {
            for (joint, radius) in joints.iter().skip(1) {
                self.shape.ellipsoid(*joint, [*radius; 3], [3, 6], material, || 0.0);
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
        self.shape.loft(&sections, |row, side| {
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
        self.shape.loft(&sections, |_, _| Some(material));
    }

    /// Neck, face and hair, or a helmet.
    pub(super) fn head(&mut self, neck: Vec3, helmet: Option<MaterialId>) {
        let Outfit { skin, hair, hair_style, top, .. } = *self.outfit;
        let rings = [self.detail.sides(6), self.detail.sides(10)];
        let at = |x: f32, y: f32| [neck[0] + x, neck[1] + y, neck[2]];
        self.limb(&[(at(0.0, 0.02), 0.055), (at(0.02, -0.06), 0.05)], skin);
        self.shape.ellipsoid(at(0.02, -0.15), [0.095, 0.125, 0.078], rings, skin, || 0.0);
        if hair_style == Hair::Long {
            self.shape.ellipsoid(at(-0.05, -0.1), [0.075, 0.17, 0.09], rings, hair, || 0.0);
        }
        if let Some(helmet) = helmet {
            self.shape.ellipsoid(at(0.0, -0.23), [0.14, 0.085, 0.105], rings, helmet, || 0.0);
            return;
        }
        match hair_style {
            Hair::Short | Hair::Long => {
                self.shape.ellipsoid(at(-0.008, -0.18), [0.098, 0.115, 0.088], rings, hair, || 0.0);
            }
            Hair::Bald => {}
            Hair::Hat => {
                self.shape.ellipsoid(at(0.01, -0.23), [0.11, 0.08, 0.1], rings, top, || 0.0);
                self.shape.ellipsoid(at(0.09, -0.2), [0.08, 0.015, 0.075], rings, top, || 0.0);
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
        self.shape.ellipsoid(add(hand, [0.0, 0.03, 0.0]), [0.04, 0.055, 0.03], [3, 6], self.outfit.skin, || 0.0);
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
