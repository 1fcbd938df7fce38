//! Paint, glass, lamps and trim of vehicles.

use super::workshop::{Detail, Workshop};
use crate::dice::Dice;
use crate::palette::{Palette, any_color, grey, matte, times, varied};
use crate::scene::{Color, Material, MaterialId, Pattern};

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

/// Strength of the sun's highlight on glass.
const GLASS_GLOSS: f32 = 0.9;

/// The materials of one vehicle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Livery {
    pub(super) body: MaterialId,
    pub(super) second: MaterialId,
    /// Glass with nothing behind it: mirrors, what is far away, lorries.
    pub(super) glass: MaterialId,
    /// Glass that one sees through, in front and behind the front doors.
    pub(super) window: MaterialId,
    pub(super) rear_window: MaterialId,
    /// Cloth on the inside of roof and doors.
    pub(super) lining: MaterialId,
    pub(super) seat: MaterialId,
    pub(super) trim: MaterialId,
    pub(super) gap: MaterialId,
    pub(super) under: MaterialId,
    pub(super) chrome: MaterialId,
    pub(super) tyre: MaterialId,
    pub(super) rim: MaterialId,
    pub(super) grille: MaterialId,
    pub(super) plate: MaterialId,
    /// The blue end of a plate.
    pub(super) plate_end: MaterialId,
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
    let [glass, window, rear_window] = glazing(palette, dice, workshop.detail);
    let (lining, seat) = (dice.log_range(0.02, 0.4) as f32, dice.log_range(0.015, 0.3) as f32);
    let (rim_tone, rim_gloss) = (dice.range32(0.12, 0.6), dice.range32(0.2, 0.9));
    let body = palette.glossy(color, body_gloss, body_shine, body_mirror);
    if dice.chance(0.35) {
        let amount = dice.range32(0.1, 0.5);
        let scale = dice.log_range(0.2, 1.5) as f32;
        let other = times([0.2, 0.17, 0.13], dice.range32(0.4, 1.2));
        palette.materials[usize::from(body)].pattern = Pattern::Noise { other, scale, amount, seed: dice.seed() };
    }
    let livery = Livery {
        body,
        second: palette.glossy(second, body_gloss, body_shine, body_mirror),
        glass,
        window,
        rear_window,
        lining: palette.matte(warm(dice, lining)),
        seat: palette.matte(warm(dice, seat)),
        trim: palette.glossy(grey(dice.range32(0.012, 0.05)), 0.15, 12.0, 0.01),
        gap: palette.matte(grey(0.006)),
        under: palette.matte(grey(0.01)),
        chrome: palette.glossy(grey(0.45), 0.9, 80.0, 0.4),
        tyre: palette.matte(grey(dice.range32(0.012, 0.035))),
        rim: palette.glossy(grey(rim_tone), rim_gloss, 40.0, 0.1),
        grille: grille(palette, dice),
        plate: plate(palette, dice),
        plate_end: palette.matte([0.01, 0.04, 0.3]),
        head_lamp: head_lamp(palette, dice, conduct.lights_on),
        tail_lamp: rear_lamp(palette, dice, lit([1.2, 0.05, 0.03], conduct.lights_on)),
        brake_lamp: rear_lamp(palette, dice, lit([3.0, 0.12, 0.06], conduct.braking)),
    };
    workshop.plate = Some(livery.plate);
    livery
}

/// Glass with nothing behind it, of the windows in front and of those behind. From far away a cabin is dark glass.
fn glazing(palette: &mut Palette, dice: &mut Dice, detail: Detail) -> [MaterialId; 3] {
    let tone = dice.range32(0.006, 0.04);
    let color = tinted(dice, tone);
    let mirror = dice.log_range(0.015, 0.1) as f32;
    let glass = palette.glossy(color, GLASS_GLOSS, 250.0, mirror);
    let share = dice.weighted(&[(0.5, 2.0), (0.75, 1.0)]);
    let rear_share = if dice.chance(0.3) { 0.75 } else { share };
    let [front, rear] = [share, rear_share].map(|share| {
        let pattern = Pattern::Sheer { share };
        let opaque = palette.materials[usize::from(glass)];
        let sheer = Material { pattern, gloss: GLASS_GLOSS / share, mirror: mirror / share, ..opaque };
        if detail == Detail::Far { glass } else { palette.add(sheer) }
    });
    [glass, front, rear]
}

fn head_lamp(palette: &mut Palette, dice: &mut Dice, on: bool) -> MaterialId {
    let (housing, bowl) = (dice.range32(0.08, 0.5), dice.range32(0.5, 0.9));
    let warmth = dice.range32(0.7, 1.0);
    let emission = lit([6.0, 6.0 * warmth.sqrt(), 6.0 * warmth], on);
    let bowls = Pattern::Windows {
        other: [bowl, bowl, bowl * 1.03],
        pitch: [dice.range32(0.12, 0.22), dice.range32(0.12, 0.22)],
        fill: [dice.range32(0.6, 0.9), dice.range32(0.6, 0.9)],
        lit: 0.0,
        seed: dice.seed(),
    };
    palette.add(Material { pattern: bowls, gloss: 0.9, shininess: 60.0, mirror: 0.3, emission, ..matte(grey(housing)) })
}

/// Red glass, often with a clear or yellow strip.
fn rear_lamp(palette: &mut Palette, dice: &mut Dice, emission: Color) -> MaterialId {
    let red = [dice.range32(0.2, 0.45), 0.012, 0.012];
    let material = palette.glowing(red, emission);
    if dice.chance(0.6) {
        let other = dice.pick(&[[0.55, 0.5, 0.5], [0.5, 0.2, 0.03], [0.08, 0.004, 0.004]]);
        let (period, share) = (dice.range32(0.08, 0.3), dice.range32(0.2, 0.4));
        palette.materials[usize::from(material)].pattern = Pattern::Stripes { other, period, share };
    }
    material
}

/// Bars before the dark.
fn grille(palette: &mut Palette, dice: &mut Dice) -> MaterialId {
    let bars = dice.weighted(&[(0.02, 2.0), (0.2, 1.0), (0.5, 2.0)]);
    let (period, share) = (dice.range32(0.03, 0.1), dice.range32(0.2, 0.5));
    let pattern = Pattern::Stripes { other: grey(bars), period, share };
    palette.add(Material { pattern, gloss: 0.3, shininess: 40.0, mirror: 0.03, ..matte(grey(0.012)) })
}

/// A number plate with its figures.
fn plate(palette: &mut Palette, dice: &mut Dice) -> MaterialId {
    let color = plate_color(dice);
    let figure = if color[0] < 0.2 { grey(0.6) } else { grey(0.02) };
    let fill = [dice.range32(0.4, 0.65), dice.range32(0.55, 0.7)];
    let pattern = Pattern::Windows { other: figure, pitch: [0.065, 0.11], fill, lit: 0.0, seed: dice.seed() };
    palette.add(Material { pattern, ..matte(color) })
}

/// Grey that may be a little brown.
fn warm(dice: &mut Dice, tone: f32) -> Color {
    let warmth = dice.range32(0.0, 0.35);
    [tone, tone * (1.0 - 0.5 * warmth), tone * (1.0 - warmth)]
}

fn lit(emission: Color, on: bool) -> Color {
    if on { emission } else { [0.0; 3] }
}

fn tinted(dice: &mut Dice, tone: f32) -> Color {
    [tone, tone * dice.range32(1.0, 1.25), tone * dice.range32(1.0, 1.35)]
}

fn plate_color(dice: &mut Dice) -> Color {
    dice.weighted(&[([0.75, 0.75, 0.73], 9.0), ([0.75, 0.6, 0.1], 0.8), ([0.05, 0.05, 0.06], 0.3)])
}
