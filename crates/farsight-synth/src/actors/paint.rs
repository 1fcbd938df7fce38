//! Paint, glass, lamps and trim of vehicles.

use super::Workshop;
use crate::dice::Dice;
use crate::palette::{any_color, grey, times, varied};
use crate::scene::{Color, MaterialId, Pattern};

/// Colours of cars and how often they are drawn: mostly black, grey, silver and white, as in Europe's streets. Chosen by eye, not counted.
const CAR_COLORS: [(Color, f64); 14] = [
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

/// Colours of vans, lorries and buses: white, then whatever the firm has.
const FLEET_COLORS: [(Color, f64); 8] = [
    ([0.78, 0.78, 0.77], 10.0),
    ([0.40, 0.41, 0.42], 3.0),
    ([0.03, 0.03, 0.035], 2.5),
    ([0.05, 0.12, 0.35], 2.0),
    ([0.45, 0.03, 0.03], 1.8),
    ([0.75, 0.50, 0.03], 1.5),
    ([0.05, 0.20, 0.09], 0.8),
    ([0.65, 0.22, 0.03], 0.8),
];

/// The materials of one vehicle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Livery {
    pub(super) body: MaterialId,
    pub(super) second: MaterialId,
    pub(super) glass: MaterialId,
    pub(super) trim: MaterialId,
    pub(super) gap: MaterialId,
    pub(super) under: MaterialId,
    pub(super) chrome: MaterialId,
    pub(super) tyre: MaterialId,
    pub(super) rim: MaterialId,
    pub(super) plate: MaterialId,
    pub(super) head_lamp: MaterialId,
    pub(super) tail_lamp: MaterialId,
    pub(super) brake_lamp: MaterialId,
}

/// Paint of a private car.
pub(super) fn car_livery(workshop: &mut Workshop) -> Livery {
    let color = body_color(workshop, &CAR_COLORS);
    livery(workshop, color)
}

/// Paint of a vehicle at work.
pub(super) fn fleet_livery(workshop: &mut Workshop) -> Livery {
    let color = body_color(workshop, &FLEET_COLORS);
    livery(workshop, color)
}

fn body_color(workshop: &mut Workshop, colors: &[(Color, f64)]) -> Color {
    let dice = &mut workshop.dice;
    if workshop.unusual {
        return any_color(dice);
    }
    let color = dice.weighted(colors);
    let aged = dice.range32(0.75, 1.15);
    varied(dice, color, 0.15).map(|c| (c * aged).min(0.85))
}

fn livery(workshop: &mut Workshop, color: Color) -> Livery {
    let conduct = workshop.conduct;
    let dice = &mut workshop.dice;
    let palette = &mut *workshop.palette;
    let clean = dice.range32(0.3, 1.0);
    let second = if dice.chance(0.5) { varied(dice, color, 0.5) } else { any_color(dice) };
    let (body_gloss, body_shine, body_mirror) =
        (clean * 0.8, dice.range32(30.0, 160.0), clean * dice.range32(0.04, 0.14));
    let glass_tone = dice.range32(0.006, 0.04);
    let (rim_tone, rim_gloss) = (dice.range32(0.12, 0.6), dice.range32(0.2, 0.9));
    let body = palette.glossy(color, body_gloss, body_shine, body_mirror);
    if dice.chance(0.35) {
        let amount = dice.range32(0.1, 0.5);
        let scale = dice.log_range(0.2, 1.5) as f32;
        let other = times([0.2, 0.17, 0.13], dice.range32(0.4, 1.2));
        palette.materials[usize::from(body)].pattern = Pattern::Noise { other, scale, amount, seed: dice.seed() };
    }
    Livery {
        body,
        second: palette.glossy(second, body_gloss, body_shine, body_mirror),
        glass: palette.glossy(tinted(dice, glass_tone), 0.9, 250.0, dice.range32(0.03, 0.12)),
        trim: palette.glossy(grey(dice.range32(0.012, 0.05)), 0.15, 12.0, 0.01),
        gap: palette.matte(grey(0.006)),
        under: palette.matte(grey(0.01)),
        chrome: palette.glossy(grey(0.45), 0.9, 80.0, 0.4),
        tyre: palette.matte(grey(dice.range32(0.012, 0.035))),
        rim: palette.glossy(grey(rim_tone), rim_gloss, 40.0, 0.1),
        plate: palette.matte(plate_color(dice)),
        head_lamp: head_lamp(palette, dice, conduct.lights_on),
        tail_lamp: palette.glowing([0.28, 0.012, 0.012], lit([1.2, 0.05, 0.03], conduct.lights_on)),
        brake_lamp: palette.glowing([0.3, 0.012, 0.012], lit([3.0, 0.12, 0.06], conduct.braking)),
    }
}

fn head_lamp(palette: &mut crate::palette::Palette, dice: &mut Dice, on: bool) -> MaterialId {
    let tone = dice.range32(0.25, 0.6);
    let warmth = dice.range32(0.7, 1.0);
    let material = palette.glossy([tone, tone, tone * 1.03], 0.9, 60.0, 0.3);
    palette.materials[usize::from(material)].emission = lit([6.0, 6.0 * warmth.sqrt(), 6.0 * warmth], on);
    material
}

fn lit(emission: Color, on: bool) -> Color {
    if on { emission } else { [0.0; 3] }
}

fn tinted(dice: &mut Dice, tone: f32) -> Color {
    [tone, tone * dice.range32(1.0, 1.25), tone * dice.range32(1.0, 1.35)]
}

fn plate_color(dice: &mut Dice) -> Color {
    dice.weighted(&[([0.75, 0.75, 0.73], 8.0), ([0.75, 0.6, 0.1], 1.5), ([0.05, 0.05, 0.06], 0.5)])
}
