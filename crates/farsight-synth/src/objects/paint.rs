//! Paint, glass, lamps and trim of vehicles.

use super::context::{BuildContext, Detail, Look, PlateFormat};
use crate::palette::{CAR_COLORS, Palette, any_color, grey, matte, times, varied};
use crate::rng::SceneRng;
use crate::scene::{Color, Material, MaterialId, Pattern};

/// Colours of vans, trucks and buses: white, then whatever the firm has.
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
const GLASS_SPECULAR: f32 = 0.9;

/// The materials of one vehicle.
#[derive(Debug, Clone, Copy)]
pub(super) struct VehicleMaterials {
    pub(super) body: MaterialId,
    pub(super) second: MaterialId,
    /// Glass with nothing behind it: mirrors, what is far away, trucks.
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
    /// Width and height of a plate, metres; none for 0.52 by 0.11.
    pub(super) plate_size: Option<[f32; 2]>,
    pub(super) plate_band: bool,
    pub(super) front_plate: bool,
    /// The blue end of a plate.
    pub(super) plate_end: MaterialId,
    pub(super) head_lamp: MaterialId,
    pub(super) tail_lamp: MaterialId,
    pub(super) brake_lamp: MaterialId,
}

/// Paint of a private car.
pub(super) fn car_materials(context: &mut BuildContext) -> VehicleMaterials {
    let color = match context.look {
        Some(look) => look.car_color(&mut context.rng, context.unusual),
        None => body_color(context, &CAR_COLORS),
    };
    materials(context, color)
}

/// Paint of a vehicle at work.
pub(super) fn fleet_materials(context: &mut BuildContext) -> VehicleMaterials {
    let own = context.look.map_or(&[][..], |look| look.colors);
    let color = if own.is_empty() || context.unusual {
        body_color(context, &FLEET_COLORS)
    } else {
        let color = context.rng.pick(own);
        varied(&mut context.rng, color, 0.15)
    };
    materials(context, color)
}

fn body_color(context: &mut BuildContext, colors: &[(Color, f64)]) -> Color {
    let rng = &mut context.rng;
    if context.unusual {
        return any_color(rng);
    }
    let color = rng.weighted(colors);
    let aged = rng.range32(0.75, 1.15);
    varied(rng, color, 0.15).map(|c| (c * aged).min(0.85))
}

fn materials(context: &mut BuildContext, color: Color) -> VehicleMaterials {
    let state = context.state;
    let look = context.look;
    let rng = &mut context.rng;
    let palette = &mut *context.palette;
    let clean = rng.range32(0.3, 1.0);
    let second = if rng.chance(0.5) { varied(rng, color, 0.5) } else { any_color(rng) };
    let (body_gloss, body_shine, body_mirror) =
        (clean * 0.8, rng.range32(30.0, 160.0), clean * rng.range32(0.04, 0.14));
    let [glass, window, rear_window] = glazing(palette, rng, context.detail);
    let (lining, seat) = (rng.log_range(0.02, 0.4) as f32, rng.log_range(0.015, 0.3) as f32);
    let (rim_tone, rim_gloss) = (rng.range32(0.12, 0.6), rng.range32(0.2, 0.9));
    let body = palette.glossy(color, body_gloss, body_shine, body_mirror);
    if rng.chance(0.35) {
        let amount = rng.range32(0.1, 0.5);
        let scale = rng.log_range(0.2, 1.5) as f32;
        let other = times([0.2, 0.17, 0.13], rng.range32(0.4, 1.2));
        palette.materials[usize::from(body)].pattern = Pattern::Noise { other, scale, amount, seed: rng.seed() };
    }
    let materials = VehicleMaterials {
        body,
        second: palette.glossy(second, body_gloss, body_shine, body_mirror),
        glass,
        window,
        rear_window,
        lining: palette.matte(warm(rng, lining)),
        seat: palette.matte(warm(rng, seat)),
        trim: palette.glossy(grey(rng.range32(0.012, 0.05)), 0.15, 12.0, 0.01),
        gap: palette.matte(grey(0.006)),
        under: palette.matte(grey(0.01)),
        chrome: palette.glossy(grey(0.45), 0.9, 80.0, 0.4),
        tyre: palette.matte(grey(rng.range32(0.012, 0.035))),
        rim: palette.glossy(grey(rim_tone), rim_gloss, 40.0, 0.1),
        grille: grille(palette, rng),
        plate: plate(palette, rng, look),
        plate_size: look.map(|look| look.plate.size_m),
        plate_band: look.is_none_or(|look| look.plate.band),
        front_plate: look.is_none_or(|look| look.has_front_plate),
        plate_end: palette.matte([0.01, 0.04, 0.3]),
        head_lamp: head_lamp(palette, rng, state.lights_on),
        tail_lamp: rear_lamp(palette, rng, lit([1.2, 0.05, 0.03], state.lights_on)),
        brake_lamp: rear_lamp(palette, rng, lit([3.0, 0.12, 0.06], state.braking)),
    };
    context.plate = Some(materials.plate);
    materials
}

/// Glass with nothing behind it, of the windows in front and of those behind. From far away a cabin is dark glass.
fn glazing(palette: &mut Palette, rng: &mut SceneRng, detail: Detail) -> [MaterialId; 3] {
    let tone = rng.range32(0.006, 0.04);
    let color = tinted(rng, tone);
    let reflectivity = rng.log_range(0.015, 0.1) as f32;
    let glass = palette.glossy(color, GLASS_SPECULAR, 250.0, reflectivity);
    let share = rng.weighted(&[(0.5, 2.0), (0.75, 1.0)]);
    let rear_share = if rng.chance(0.3) { 0.75 } else { share };
    let [front, rear] = [share, rear_share].map(|share| {
        let pattern = Pattern::Transparent { share };
        let opaque = palette.materials[usize::from(glass)];
        let transparent =
            Material { pattern, specular: GLASS_SPECULAR / share, reflectivity: reflectivity / share, ..opaque };
        if detail == Detail::Far { glass } else { palette.add(transparent) }
    });
    [glass, front, rear]
}

fn head_lamp(palette: &mut Palette, rng: &mut SceneRng, on: bool) -> MaterialId {
    let (housing, bowl) = (rng.range32(0.08, 0.5), rng.range32(0.5, 0.9));
    let warmth = rng.range32(0.7, 1.0);
    let emission = lit([6.0, 6.0 * warmth.sqrt(), 6.0 * warmth], on);
    let bowls = Pattern::Windows {
        other: [bowl, bowl, bowl * 1.03],
        pitch: [rng.range32(0.12, 0.22), rng.range32(0.12, 0.22)],
        fill: [rng.range32(0.6, 0.9), rng.range32(0.6, 0.9)],
        lit: 0.0,
        seed: rng.seed(),
    };
    palette.add(Material {
        pattern: bowls,
        specular: 0.9,
        shininess: 60.0,
        reflectivity: 0.3,
        emission,
        ..matte(grey(housing))
    })
}

/// Red glass, often with a clear or yellow strip.
fn rear_lamp(palette: &mut Palette, rng: &mut SceneRng, emission: Color) -> MaterialId {
    let red = [rng.range32(0.2, 0.45), 0.012, 0.012];
    let material = palette.glowing(red, emission);
    if rng.chance(0.6) {
        let other = rng.pick(&[[0.55, 0.5, 0.5], [0.5, 0.2, 0.03], [0.08, 0.004, 0.004]]);
        let (period, share) = (rng.range32(0.08, 0.3), rng.range32(0.2, 0.4));
        palette.materials[usize::from(material)].pattern = Pattern::Stripes { other, period, share };
    }
    material
}

/// Bars before the dark.
fn grille(palette: &mut Palette, rng: &mut SceneRng) -> MaterialId {
    let bars = rng.weighted(&[(0.02, 2.0), (0.2, 1.0), (0.5, 2.0)]);
    let (period, share) = (rng.range32(0.03, 0.1), rng.range32(0.2, 0.5));
    let pattern = Pattern::Stripes { other: grey(bars), period, share };
    palette.add(Material { pattern, specular: 0.3, shininess: 40.0, reflectivity: 0.03, ..matte(grey(0.012)) })
}

/// A number plate with its figures.
fn plate(palette: &mut Palette, rng: &mut SceneRng, look: Option<Look>) -> MaterialId {
    if let Some(PlateFormat { size_m, figures, lines, ground, ink, .. }) = look.map(|look| look.plate) {
        let pitch = [size_m[0] / figures as f32, size_m[1] / lines as f32];
        let fill = [rng.range32(0.45, 0.7), rng.range32(0.5, 0.7)];
        let pattern = Pattern::Windows { other: ink, pitch, fill, lit: 0.0, seed: rng.seed() };
        let worn = rng.range32(0.7, 1.05);
        return palette.add(Material { pattern, ..matte(times(ground, worn)) });
    }
    let color = plate_color(rng);
    let figure = if color[0] < 0.2 { grey(0.6) } else { grey(0.02) };
    let fill = [rng.range32(0.4, 0.65), rng.range32(0.55, 0.7)];
    let pattern = Pattern::Windows { other: figure, pitch: [0.065, 0.11], fill, lit: 0.0, seed: rng.seed() };
    palette.add(Material { pattern, ..matte(color) })
}

/// Grey that may be a little brown.
fn warm(rng: &mut SceneRng, tone: f32) -> Color {
    let warmth = rng.range32(0.0, 0.35);
    [tone, tone * (1.0 - 0.5 * warmth), tone * (1.0 - warmth)]
}

fn lit(emission: Color, on: bool) -> Color {
    if on { emission } else { [0.0; 3] }
}

fn tinted(rng: &mut SceneRng, tone: f32) -> Color {
    [tone, tone * rng.range32(1.0, 1.25), tone * rng.range32(1.0, 1.35)]
}

fn plate_color(rng: &mut SceneRng) -> Color {
    rng.weighted(&[([0.75, 0.75, 0.73], 9.0), ([0.75, 0.6, 0.1], 0.8), ([0.05, 0.05, 0.06], 0.3)])
}
