//! People: on foot, sitting, on a bicycle.

use super::{Detail, Workshop};
use crate::dice::Dice;
use crate::palette::{any_color, grey, varied};
use crate::scene::{Color, MaterialId, Mesh, Vec3};
use crate::shape::Shape;
use crate::vector::mix;

/// What someone wears.
struct Outfit {
    skin: MaterialId,
    hair: MaterialId,
    top: MaterialId,
    trousers: MaterialId,
    shoes: MaterialId,
    bag: MaterialId,
    /// Skirt or coat over the legs.
    coat: bool,
    bare_arms: bool,
}

const SKIN: [(Color, f64); 4] =
    [([0.55, 0.34, 0.25], 5.0), ([0.42, 0.24, 0.16], 3.0), ([0.2, 0.1, 0.06], 1.5), ([0.08, 0.04, 0.03], 1.0)];
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
const TROUSERS: [(Color, f64); 5] = [
    ([0.02, 0.02, 0.025], 4.0),
    ([0.04, 0.07, 0.16], 4.0),
    ([0.16, 0.15, 0.14], 2.0),
    ([0.4, 0.34, 0.25], 1.5),
    ([0.6, 0.6, 0.58], 0.5),
];

impl Outfit {
    fn draw(workshop: &mut Workshop) -> Self {
        let dice = &mut workshop.dice;
        let palette = &mut *workshop.palette;
        let skin = dice.weighted(&SKIN);
        let top = if dice.chance(0.2) { any_color(dice) } else { dice.weighted(&TOPS) };
        let trousers = dice.weighted(&TROUSERS);
        let hair = dice.weighted(&[
            ([0.012, 0.01, 0.01], 4.0),
            ([0.08, 0.05, 0.03], 3.0),
            (grey(0.4), 1.0),
            ([0.35, 0.24, 0.1], 1.0),
        ]);
        Self {
            skin: palette.matte(varied(dice, skin, 0.15)),
            hair: palette.matte(varied(dice, hair, 0.3)),
            top: palette.matte(varied(dice, top, 0.3)),
            trousers: palette.matte(varied(dice, trousers, 0.3)),
            shoes: palette.matte(grey(dice.pick(&[0.015, 0.02, 0.05, 0.5]))),
            bag: palette.matte(any_color(dice)),
            coat: dice.chance(0.2),
            bare_arms: dice.chance(0.3),
        }
    }
}

/// Draws limbs for a person of 1.75 m; the whole is stretched to its size afterwards.
struct Figure<'a> {
    shape: &'a mut Shape,
    detail: Detail,
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

    fn trunk(&mut self, hips: Vec3, neck: Vec3, material: MaterialId) {
        let sides = self.detail.sides(10);
        // Half depth and half width from hips to neck.
        let rows = [(0.0, 0.12, 0.165), (0.25, 0.12, 0.155), (0.65, 0.135, 0.19), (0.88, 0.11, 0.2), (1.0, 0.06, 0.07)];
        let ring = |&(share, depth, width): &(f32, f32, f32)| {
            let center = mix(hips, neck, share);
            (0..=sides)
                .map(|k| {
                    let (sin, cos) = crate::shape::sin_cos(std::f32::consts::TAU * k as f32 / sides as f32);
                    [center[0] + cos * depth, center[1], center[2] + sin * width]
                })
                .collect::<Vec<_>>()
        };
        let sections: Vec<Vec<Vec3>> = rows.iter().map(ring).collect();
        self.shape.skin(&sections, |_, _| Some(material));
    }

    fn head(&mut self, neck: Vec3, outfit: &Outfit, helmet: Option<MaterialId>) {
        let rings = [self.detail.sides(6), self.detail.sides(10)];
        let center = [neck[0] + 0.02, neck[1] - 0.15, neck[2]];
        self.limb(&[(neck, 0.055), ([center[0], neck[1] - 0.06, center[2]], 0.05)], outfit.skin);
        self.shape.ball(center, [0.1, 0.125, 0.08], rings, outfit.skin, || 0.0);
        let cap = [center[0] - 0.025, center[1] - 0.035, center[2]];
        self.shape.ball(cap, [0.1, 0.115, 0.09], rings, helmet.unwrap_or(outfit.hair), || 0.0);
    }

    /// One leg from the hip to a foot whose ankle is at `ankle`; the knee bends forward by `bend`.
    fn leg(&mut self, hip: Vec3, ankle: Vec3, bend: f32, outfit: &Outfit) {
        let middle = mix(hip, ankle, 0.5);
        let knee = [middle[0] + bend, middle[1], middle[2]];
        self.limb(&[(hip, 0.095), (knee, 0.065), (ankle, 0.045)], outfit.trousers);
        let toe = [ankle[0] + 0.17, ankle[1] + 0.05, ankle[2]];
        self.limb(&[(ankle, 0.045), (toe, 0.035)], outfit.shoes);
    }

    fn arm(&mut self, shoulder: Vec3, elbow: Vec3, hand: Vec3, outfit: &Outfit) {
        let lower = if outfit.bare_arms { outfit.skin } else { outfit.top };
        self.limb(&[(shoulder, 0.06), (elbow, 0.048)], outfit.top);
        self.limb(&[(elbow, 0.045), (hand, 0.033)], lower);
        self.shape.ball(hand, [0.045; 3], [3, 6], outfit.skin, || 0.0);
    }
}

/// Someone who walks or stands.
pub(super) fn standing([_, width, length]: [f32; 3], workshop: &mut Workshop) -> Mesh {
    let outfit = Outfit::draw(workshop);
    let dice = &mut workshop.dice;
    let mut shape = Shape::default();
    let stride = ((length - 0.35) / 0.9).clamp(0.05, 0.9);
    let reach = (width / 2.0 - 0.22).clamp(0.02, 0.2);
    let phase = if dice.chance(0.5) { 1.0 } else { -1.0 };
    let detail = workshop.detail;
    let mut figure = Figure { shape: &mut shape, detail };
    let (hips, neck) = ([0.0, -0.92, 0.0], [0.03 * stride, -1.48, 0.0]);
    for side in [-1.0f32, 1.0] {
        let ahead = phase * side * stride;
        let lift = if ahead < 0.0 { 0.08 * stride } else { 0.0 };
        figure.leg([0.0, -0.9, side * 0.09], [ahead * 0.45, -0.07 - lift, side * 0.1], 0.04 + 0.05 * stride, &outfit);
        let swing = -ahead * 0.35;
        let shoulder = [neck[0], -1.41, side * 0.2];
        let elbow = [swing * 0.5, -1.14, side * (0.24 + 0.5 * reach)];
        figure.arm(
            shoulder,
            elbow,
            [swing + 0.08, -0.9 - 0.2 * stride * swing.max(0.0), side * (0.25 + reach)],
            &outfit,
        );
    }
    figure.trunk(hips, neck, outfit.top);
    figure.head(neck, &outfit, None);
    if outfit.coat {
        figure.limb(&[([0.01, -1.05, 0.0], 0.17), ([0.0, -0.5, 0.0], 0.21)], outfit.top);
    }
    luggage(&mut shape, dice, &outfit);
    shape.mesh
}

fn luggage(shape: &mut Shape, dice: &mut Dice, outfit: &Outfit) {
    if dice.chance(0.25) {
        shape.block([-0.3, -1.42, -0.15], [-0.1, -1.0, 0.15], outfit.bag);
    } else if dice.chance(0.2) {
        shape.block([-0.1, -0.82, 0.24], [0.2, -0.45, 0.34], outfit.bag);
    }
}

/// Someone who sits, on a chair that belongs to them.
pub(super) fn sitting(_: [f32; 3], workshop: &mut Workshop) -> Mesh {
    let outfit = Outfit::draw(workshop);
    let mut shape = Shape::default();
    let mut figure = Figure { shape: &mut shape, detail: workshop.detail };
    let (hips, neck) = ([-0.15, -0.5, 0.0], [-0.12, -1.05, 0.0]);
    for side in [-1.0f32, 1.0] {
        let knee = [0.28, -0.52, side * 0.11];
        let ankle = [0.25, -0.08, side * 0.12];
        figure.limb(&[([-0.15, -0.5, side * 0.1], 0.09), (knee, 0.07), (ankle, 0.05)], outfit.trousers);
        figure.limb(&[(ankle, 0.045), ([0.42, -0.04, side * 0.12], 0.035)], outfit.shoes);
        figure.arm([-0.12, -0.98, side * 0.2], [-0.05, -0.72, side * 0.26], [0.2, -0.6, side * 0.16], &outfit);
    }
    figure.trunk(hips, neck, outfit.top);
    figure.head(neck, &outfit, None);
    shape.block([-0.36, -0.46, -0.22], [0.08, -0.42, 0.22], outfit.bag);
    shape.block([-0.38, -0.9, -0.22], [-0.34, 0.0, 0.22], outfit.bag);
    shape.mesh
}

/// Someone in a car, above the doors, on a seat at `hips`.
pub(super) fn riding(shape: &mut Shape, hips: Vec3, workshop: &mut Workshop) {
    let outfit = Outfit::draw(workshop);
    let mut figure = Figure { shape, detail: workshop.detail };
    let at = |[x, y, z]: Vec3| [hips[0] + x, hips[1] + y, hips[2] + z];
    let neck = at([-0.12, -0.53, 0.0]);
    for side in [-1.0f32, 1.0] {
        figure.arm(
            at([-0.1, -0.47, side * 0.19]),
            at([0.1, -0.25, side * 0.23]),
            at([0.36, -0.36, side * 0.14]),
            &outfit,
        );
    }
    figure.trunk(hips, neck, outfit.top);
    figure.head(neck, &outfit, None);
}

/// Someone on a bicycle, for boxes of about 1.75 x 0.6 x 1.75 m.
pub(super) fn cyclist(_: [f32; 3], workshop: &mut Workshop) -> Mesh {
    let outfit = Outfit::draw(workshop);
    let dice = &mut workshop.dice;
    let frame_color = any_color(dice);
    let frame = workshop.palette.glossy(frame_color, 0.5, 40.0, 0.05);
    let dark = workshop.palette.matte(grey(0.02));
    let helmet = dice.chance(0.4).then(|| workshop.palette.matte(any_color(dice)));
    let lean = dice.range32(0.05, 0.3);
    let pedal = dice.range32(-0.17, 0.17);
    let mut shape = Shape::default();
    bicycle(&mut shape, frame, dark, workshop.detail);
    let mut figure = Figure { shape: &mut shape, detail: workshop.detail };
    let (hips, neck) = ([-0.22, -0.98, 0.0], [-0.17 + lean, -1.47, 0.0]);
    for side in [-1.0f32, 1.0] {
        let ankle = [-0.02 + side * 0.1, -0.3 + side * pedal, side * 0.11];
        figure.leg([-0.2, -0.95, side * 0.09], ankle, 0.2, &outfit);
        let shoulder = [neck[0], -1.4, side * 0.19];
        let hand = [0.42, -1.03, side * 0.27];
        let mut elbow = mix(shoulder, hand, 0.5);
        elbow[1] += 0.06;
        elbow[2] += side * 0.04;
        figure.arm(shoulder, elbow, hand, &outfit);
    }
    figure.trunk(hips, neck, outfit.top);
    figure.head(neck, &outfit, helmet);
    shape.mesh
}

/// A bicycle 1.75 m long.
pub(crate) fn bicycle(shape: &mut Shape, frame: MaterialId, dark: MaterialId, detail: Detail) {
    let sides = detail.sides(18);
    let axis = [0.0, 0.0, 1.0];
    let [rear, front] = [[-0.535, -0.34, 0.0], [0.535, -0.34, 0.0]];
    for hub in [rear, front] {
        for z in [-0.018, 0.018] {
            shape.disc([hub[0], hub[1], z], axis, [0.30, 0.34], sides, &[dark]);
        }
        if detail == Detail::Near {
            let spokes = [frame, dark];
            for k in 0..8 {
                let (sin, cos) = crate::shape::sin_cos(std::f32::consts::TAU * k as f32 / 8.0);
                let rim = [hub[0] + 0.3 * cos, hub[1] + 0.3 * sin, 0.0];
                shape.tube(hub, rim, [0.004; 2], 3, spokes[k % 2]);
            }
        }
    }
    let [crank, seat, head] = [[-0.08, -0.3, 0.0], [-0.22, -0.85, 0.0], [0.36, -0.88, 0.0]];
    for (a, b) in [(rear, crank), (crank, seat), (crank, head), (seat, head), (rear, seat), (head, front)] {
        shape.tube(a, b, [0.02; 2], 5, frame);
    }
    shape.tube([0.4, -1.03, -0.29], [0.4, -1.03, 0.29], [0.016; 2], 5, dark);
    shape.tube(head, [0.4, -1.03, 0.0], [0.018; 2], 5, dark);
    shape.block([-0.35, -0.95, -0.07], [-0.1, -0.89, 0.07], dark);
}
