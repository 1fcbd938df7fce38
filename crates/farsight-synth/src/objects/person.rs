//! People: on foot, sitting, in a car, on a bicycle.

use super::bicycle::{CRANK, bicycle};
use super::context::{BuildContext, STRIDE};
use super::human::HumanMesh;
use super::outfit::Outfit;
use crate::mesh_builder::{MeshBuilder, sin_cos};
use crate::palette::{any_color, grey};
use crate::rng::SceneRng;
use crate::scene::{MaterialId, Mesh, Vec3};

/// A foot flat on the ground.
const FLAT: Vec3 = [0.17, 0.04, 0.0];
const SIDES: [f32; 2] = [-1.0, 1.0];

/// Where the ankles are, and the way from ankle to toe, as somebody walks or stands.
struct Stance {
    /// Left and right: x, and height above the ground.
    ankles: [[f32; 2]; 2],
    toes: [Vec3; 2],
    /// Share of a full step by which each arm swings ahead.
    swing: [f32; 2],
    /// Height of the hips.
    hips: f32,
}

impl Stance {
    fn sample(length: f32, rng: &mut SceneRng) -> Self {
        /// What the legs are doing.
        #[derive(Clone, Copy)]
        enum Gait {
            /// Both feet on the ground, a step apart.
            Step,
            /// One foot passes the other.
            Pass,
            Stand,
        }
        let long = length > 0.7;
        let gait = rng.weighted(&[
            (Gait::Step, if long { 6.0 } else { 1.5 }),
            (Gait::Pass, if long { 1.0 } else { 3.0 }),
            (Gait::Stand, if long { 1.0 } else { 3.0 }),
        ]);
        let step = ((length - 0.3) / 1.8).clamp(0.05, 0.5);
        let stance = match gait {
            Gait::Step => Self {
                ankles: [[step, 0.09], [-0.85 * step, 0.09 + 0.2 * step]],
                toes: [[0.16, -0.02, 0.0], [0.12, 0.06 + 0.15 * step, 0.0]],
                swing: [-1.0, 1.0],
                // The leg ahead is straight.
                hips: 0.09 + (0.84f32 * 0.84 - step * step).sqrt(),
            },
            Gait::Pass => Self {
                ankles: [[-0.02, 0.08], [-0.3 * rng.range32(0.3, 1.2), 0.25]],
                toes: [FLAT, [0.09, 0.12, 0.0]],
                swing: [0.1, -0.1],
                hips: 0.93,
            },
            Gait::Stand => Self {
                ankles: [[0.0, 0.08], [rng.range32(-0.1, 0.2), 0.08]],
                toes: [FLAT; 2],
                swing: [0.0; 2],
                hips: 0.925,
            },
        };
        if rng.chance(0.5) { stance.mirrored() } else { stance }
    }

    /// At this part of two steps, from 0 to 1: each foot stands while it goes back, and is lifted while it comes ahead.
    fn walking(length: f32, part: f32) -> Self {
        let step = ((length - 0.3) / 1.8).clamp(0.05, 0.5);
        let foot = |part: f32| {
            let part = part.fract();
            if part < 0.5 {
                ([step * (1.0 - 4.0 * part), 0.09], FLAT)
            } else {
                let ahead = 2.0 * part - 1.0;
                let lift = 4.0 * ahead * (1.0 - ahead);
                ([step * (2.0 * ahead - 1.0), 0.09 + 0.25 * step * lift], [0.14, 0.04 + 0.08 * lift, 0.0])
            }
        };
        let [left, right] = [foot(part), foot(part + 0.5)];
        let reach = left.0[0].abs().max(right.0[0].abs());
        let hips = 0.09 + (0.84f32 * 0.84 - reach * reach).sqrt();
        let swing = [left, right].map(|([x, _], _)| -x / step);
        Self { ankles: [left.0, right.0], toes: [left.1, right.1], swing, hips }
    }

    fn mirrored(mut self) -> Self {
        self.ankles.reverse();
        self.toes.reverse();
        self.swing.reverse();
        self
    }
}

/// What an arm is doing.
#[derive(Clone, Copy)]
enum Arm {
    /// Hangs and swings.
    Free,
    /// The hand is in a pocket or on the hip.
    Pocket,
    /// Holds something before the chest: a telephone, a strap.
    Raised,
}

impl Arm {
    /// `reach` is how far the hands hang away from the body, metres.
    fn sample(reach: f32, rng: &mut SceneRng) -> Self {
        let free = if reach > 0.06 { 30.0 } else { 6.0 };
        rng.weighted(&[(Self::Free, free), (Self::Pocket, 1.5), (Self::Raised, 1.5)])
    }

    /// Where the hand is, and whither the elbow points; the hips are at the height `hips`.
    fn pose(self, shoulder: Vec3, hips: f32, swing: f32, reach: f32, rng: &mut SceneRng) -> [Vec3; 2] {
        let side = shoulder[2].signum();
        match self {
            Self::Free => {
                let x = shoulder[0] + 0.06 + 0.22 * swing * rng.range32(0.3, 1.3);
                [[x, shoulder[1] + 0.53 - x.abs() * 0.2, side * (0.24 + reach)], [-1.0, 0.0, side * 0.6]]
            }
            Self::Pocket => [[0.06, -hips, side * 0.19], [-0.7, 0.0, side]],
            Self::Raised => {
                let hand = [rng.range32(0.2, 0.34), shoulder[1] + rng.range32(0.05, 0.3), side * 0.1];
                [hand, [-0.3, 1.0, side * rng.range32(0.2, 0.8)]]
            }
        }
    }
}

/// Someone who walks or stands.
pub(super) fn standing([_, width, length]: [f32; 3], context: &mut BuildContext) -> Mesh {
    let outfit = Outfit::sample(context);
    let rng = &mut context.rng;
    let stance = match context.state.stride {
        Some(part) => Stance::walking(length, f32::from(part) / f32::from(STRIDE)),
        None => Stance::sample(length, rng),
    };
    let mut shape = MeshBuilder::default();
    let mut figure = HumanMesh { shape: &mut shape, detail: context.detail, outfit: &outfit };
    let lean = rng.range32(-0.02, 0.07);
    let hips = [0.0, 0.05 - stance.hips, 0.0];
    let neck = [lean, -0.55 - stance.hips, 0.0];
    // Wide boxes are of people who hold their arms away from them.
    let reach = (width / 1.12 - 0.56).clamp(0.0, 0.3) / 2.0;
    let mut hands = [[0.0; 3]; 2];
    for (k, side) in SIDES.into_iter().enumerate() {
        let [x, height] = stance.ankles[k];
        figure.leg([0.0, -stance.hips, side * 0.09], [x, -height, side * 0.1], stance.toes[k]);
        let shoulder = [neck[0], neck[1] + 0.08, side * 0.185];
        let [hand, elbow] = Arm::sample(reach, rng).pose(shoulder, stance.hips, stance.swing[k], reach, rng);
        figure.arm(shoulder, hand, elbow);
        hands[k] = hand;
    }
    figure.trunk(hips, neck);
    figure.hem(hips);
    figure.head(neck, None);
    luggage(&mut figure, neck, hands, rng);
    shape.mesh
}

/// A rucksack, a bag at the shoulder, bags in the hands, or nothing.
fn luggage(figure: &mut HumanMesh, neck: Vec3, hands: [Vec3; 2], rng: &mut SceneRng) {
    /// What is carried.
    #[derive(Clone, Copy)]
    enum Luggage {
        Nothing,
        Rucksack,
        ShoulderBag,
        InHand,
    }
    let bag = figure.outfit.bag;
    let side = rng.whole(0, 1);
    let kind = rng.weighted(&[
        (Luggage::Nothing, 5.0),
        (Luggage::Rucksack, 1.6),
        (Luggage::ShoulderBag, 1.4),
        (Luggage::InHand, 1.2),
    ]);
    match kind {
        Luggage::Nothing => {}
        Luggage::Rucksack => rucksack(figure.shape, neck, rng.range32(0.8, 1.2), bag),
        Luggage::ShoulderBag => {
            let z = SIDES[side] * 0.26;
            let top = neck[1] + rng.range32(0.42, 0.55);
            figure.shape.cuboid([-0.16, top, z - 0.055], [0.14, top + rng.range32(0.2, 0.32), z + 0.055], bag);
            figure.shape.tube([neck[0], neck[1] + 0.05, 0.6 * z], [0.0, top, z], [0.012; 2], 4, bag);
        }
        Luggage::InHand => {
            let [x, y, z] = hands[side];
            let top = y + 0.1;
            let low = (top + rng.range32(0.25, 0.4)).min(-0.08);
            figure.shape.cuboid([x - 0.15, top, z - 0.045], [x + 0.15, low, z + 0.045], bag);
        }
    }
}

fn rucksack(shape: &mut MeshBuilder, neck: Vec3, size: f32, bag: MaterialId) {
    let center = [neck[0] - 0.2, neck[1] + 0.27, 0.0];
    shape.ellipsoid(center, [0.12 * size, 0.23 * size, 0.15 * size], [6, 10], bag, || 0.0);
}

/// Someone who sits, on a chair that belongs to them.
pub(super) fn sitting(_: [f32; 3], context: &mut BuildContext) -> Mesh {
    let outfit = Outfit::sample(context);
    let mut shape = MeshBuilder::default();
    let mut figure = HumanMesh { shape: &mut shape, detail: context.detail, outfit: &outfit };
    let (hips, neck) = ([-0.15, -0.46, 0.0], [-0.12, -1.05, 0.0]);
    for side in SIDES {
        figure.leg([-0.13, -0.5, side * 0.1], [0.25, -0.08, side * 0.12], FLAT);
        figure.arm([-0.12, -0.97, side * 0.185], [0.2, -0.6, side * 0.14], [-1.0, 0.5, side * 0.5]);
    }
    figure.trunk(hips, neck);
    figure.head(neck, None);
    shape.cuboid([-0.36, -0.42, -0.22], [0.08, -0.38, 0.22], outfit.bag);
    shape.cuboid([-0.38, -0.9, -0.22], [-0.34, 0.0, 0.22], outfit.bag);
    shape.mesh
}

/// Someone in a car, above the doors, on a seat at `hips`.
pub(super) fn riding(shape: &mut MeshBuilder, hips: Vec3, context: &mut BuildContext) {
    let outfit = Outfit::sample(context);
    let mut figure = HumanMesh { shape, detail: context.detail, outfit: &outfit };
    let at = |[x, y, z]: Vec3| [hips[0] + x, hips[1] + y, hips[2] + z];
    let neck = at([-0.12, -0.53, 0.0]);
    for side in SIDES {
        figure.arm(at([-0.1, -0.47, side * 0.18]), at([0.36, -0.36, side * 0.14]), [0.0, 1.0, side * 0.3]);
    }
    figure.trunk(hips, neck);
    figure.head(neck, None);
}

/// Someone on a bicycle, for boxes of about 1.75 x 0.6 x 1.75 m.
pub(super) fn cyclist(_: [f32; 3], context: &mut BuildContext) -> Mesh {
    let outfit = Outfit::sample(context);
    let rng = &mut context.rng;
    let frame_color = any_color(rng);
    let frame = context.palette.glossy(frame_color, 0.5, 40.0, 0.05);
    let dark = context.palette.matte(grey(0.02));
    let helmet = rng.chance(0.3).then(|| context.palette.matte(any_color(rng)));
    let lean = rng.range32(0.05, 0.35);
    let turn = rng.range32(0.0, std::f32::consts::TAU);
    let mut shape = MeshBuilder::default();
    bicycle(&mut shape, frame, dark, context.detail);
    let mut figure = HumanMesh { shape: &mut shape, detail: context.detail, outfit: &outfit };
    let (hips, neck) = ([-0.22, -0.92, 0.0], [-0.2 + lean, -1.5 + 0.25 * lean, 0.0]);
    for side in SIDES {
        let (sin, cos) = sin_cos(turn);
        let ankle = [CRANK[0] - 0.08 + side * 0.17 * cos, CRANK[1] - 0.09 + side * 0.17 * sin, side * 0.11];
        figure.leg([-0.2, -0.93, side * 0.09], ankle, [0.17, 0.06, 0.0]);
        let shoulder = [neck[0], neck[1] + 0.08, side * 0.185];
        figure.arm(shoulder, [0.4, -1.06, side * 0.26], [-0.5, 1.0, side]);
    }
    figure.trunk(hips, neck);
    figure.head(neck, helmet);
    // Nothing, a basket in front, a pannier behind, a rucksack.
    match rng.weighted(&[(0, 6.0), (1, 1.5), (2, 1.5), (3, 1.5)]) {
        1 => shape.cuboid([0.44, -1.0, -0.17], [0.7, -0.75, 0.17], outfit.bag),
        2 => shape.cuboid([-0.7, -0.72, -0.19], [-0.38, -0.4, -0.06], outfit.bag),
        3 => rucksack(&mut shape, neck, 1.0, outfit.bag),
        _ => {}
    }
    shape.mesh
}
