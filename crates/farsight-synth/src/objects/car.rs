//! Passenger cars and vans.

use super::body::{Body, Glazing, Profile};
use super::context::{BuildContext, Detail};
use super::paint::{VehicleMaterials, car_materials, fleet_materials};
use super::wheels::Wheel;
use super::{cabin, faces};
use crate::mesh_builder::MeshBuilder;
use crate::rng::SceneRng;
use crate::scene::Mesh;

/// Body types of passenger cars.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Style {
    Hatchback,
    Saloon,
    Estate,
    Suv,
    Minivan,
    PanelVan,
    Bus,
    FullSizeSuv,
    KeiCar,
    Pickup,
}

/// A passenger car; its proportions say of which type.
pub(super) fn car(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let [height, _, length] = hwl;
    let tall = f64::from(((height - 1.5) / 0.2).clamp(0.0, 1.0));
    let long = f64::from(((length - 3.7) / 0.7).clamp(0.0, 1.0));
    let style = context.rng.weighted(&[
        (Style::Hatchback, 1.2 - long),
        (Style::Saloon, (0.05 + long) * (1.0 - tall)),
        (Style::Estate, (0.1 + 0.6 * long) * (1.0 - 0.7 * tall)),
        (Style::Suv, 0.05 + 0.5 * tall),
        (Style::Minivan, 0.02 + 0.6 * tall),
    ]);
    let materials = car_materials(context);
    build(style, hwl, materials, context)
}

/// A van: with windows all around, or a closed one.
pub(super) fn van(hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let big = f64::from(((hwl[0] - 2.0) / 0.4).clamp(0.0, 1.0));
    let style = context.rng.weighted(&[(Style::Minivan, 1.0 - big), (Style::PanelVan, 0.5 + big), (Style::Bus, 0.5)]);
    let materials = fleet_materials(context);
    build(style, hwl, materials, context)
}

/// A car of a style in a private car's paint.
pub(super) fn private(style: Style, hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let materials = car_materials(context);
    build(style, hwl, materials, context)
}

/// A van of a style in a firm's paint.
pub(super) fn at_work(style: Style, hwl: [f32; 3], context: &mut BuildContext) -> Mesh {
    let materials = fleet_materials(context);
    build(style, hwl, materials, context)
}

fn build(style: Style, hwl: [f32; 3], materials: VehicleMaterials, context: &mut BuildContext) -> Mesh {
    let detail = context.detail;
    let profile = profile(style, &mut context.rng);
    let body = Body::new(profile, hwl, detail);
    let mut shape = MeshBuilder::default();
    body.build(&mut shape, &materials);
    wheels(&mut shape, &body, hwl[1], &materials, context);
    faces::front(&mut shape, &body, hwl, &materials, context);
    faces::rear(&mut shape, &body, hwl, &materials, context);
    mirrors(&mut shape, &body, hwl[1], &materials);
    if detail > Detail::Far {
        gaps(&mut shape, &body, &materials, detail);
        cabin::build_surroundings(&mut shape, &body, hwl, &materials, context);
    }
    if style == Style::Pickup {
        bed(&mut shape, &body, hwl, &materials);
    }
    if detail == Detail::Near {
        extras(&mut shape, &body, hwl, &materials, context);
    }
    shape.mesh
}

/// Draws the proportions of a style.
fn profile(style: Style, rng: &mut SceneRng) -> Profile {
    let base = base_profile(style);
    let mut near = |value: f32, reach: f32| value + rng.range32(-reach, reach);
    let screen_start = near(base.screen[0], 0.015);
    let rear_start = near(base.rear[0], 0.015).min(0.965);
    let cowl = near(base.cowl, 0.02);
    Profile {
        nose: near(base.nose, 0.03),
        cowl,
        screen: [screen_start, near(base.screen[1], 0.02).max(screen_start + 0.08)],
        rear: [rear_start, near(base.rear[1], 0.008).clamp(rear_start + 0.015, 0.985)],
        deck: near(base.deck, 0.025),
        tail: near(base.tail, 0.03),
        roof: [near(base.roof[0], 0.012).min(0.99), near(base.roof[1], 0.015).min(0.99)],
        sill: near(base.sill, 0.015),
        axles: [near(base.axles[0], 0.012), near(base.axles[1], 0.012)],
        wheel_m: near(base.wheel_m, 0.022),
        roof_width: near(base.roof_width, 0.03),
        shoulder_width: near(base.shoulder_width, 0.012),
        nose_width: near(base.nose_width, 0.05),
        tail_width: near(base.tail_width, 0.03),
        pillar: near(base.pillar, 0.02),
        window_end: near(base.window_end, 0.02),
        glazing: if base.glazing == Glazing::Rear && rng.chance(0.5) { Glazing::None } else { base.glazing },
        black_sill: base.black_sill && rng.chance(0.7) || rng.chance(0.08),
        upright_lamps: base.upright_lamps && rng.chance(0.7),
    }
}

fn base_profile(style: Style) -> Profile {
    let hatchback = Profile {
        nose: 0.50,
        cowl: 0.655,
        screen: [0.245, 0.43],
        rear: [0.86, 0.96],
        deck: 0.68,
        tail: 0.60,
        roof: [0.955, 0.945],
        sill: 0.13,
        axles: [0.185, 0.815],
        wheel_m: 0.305,
        roof_width: 0.74,
        shoulder_width: 0.925,
        nose_width: 0.70,
        tail_width: 0.84,
        pillar: 0.57,
        window_end: 0.84,
        glazing: Glazing::Full,
        black_sill: false,
        upright_lamps: true,
    };
    match style {
        Style::Hatchback => hatchback,
        Style::Saloon => Profile {
            screen: [0.27, 0.43],
            rear: [0.71, 0.85],
            deck: 0.70,
            tail: 0.64,
            axles: [0.18, 0.79],
            pillar: 0.54,
            window_end: 0.755,
            upright_lamps: false,
            ..hatchback
        },
        Style::Estate => Profile {
            screen: [0.26, 0.41],
            rear: [0.915, 0.972],
            roof: [0.955, 0.95],
            axles: [0.18, 0.79],
            pillar: 0.53,
            window_end: 0.90,
            ..hatchback
        },
        Style::Suv => Profile {
            nose: 0.55,
            cowl: 0.65,
            screen: [0.25, 0.40],
            rear: [0.915, 0.972],
            sill: 0.17,
            wheel_m: 0.35,
            roof_width: 0.78,
            pillar: 0.54,
            window_end: 0.89,
            black_sill: true,
            ..hatchback
        },
        Style::FullSizeSuv => Profile {
            nose: 0.57,
            cowl: 0.64,
            screen: [0.25, 0.36],
            rear: [0.945, 0.978],
            deck: 0.66,
            roof: [0.965, 0.965],
            sill: 0.18,
            axles: [0.175, 0.80],
            wheel_m: 0.39,
            roof_width: 0.84,
            shoulder_width: 0.945,
            nose_width: 0.84,
            tail_width: 0.92,
            pillar: 0.50,
            window_end: 0.92,
            black_sill: true,
            ..hatchback
        },
        Style::KeiCar => Profile {
            nose: 0.47,
            cowl: 0.56,
            screen: [0.15, 0.29],
            rear: [0.955, 0.982],
            deck: 0.58,
            roof: [0.97, 0.97],
            sill: 0.11,
            axles: [0.15, 0.86],
            wheel_m: 0.275,
            roof_width: 0.85,
            shoulder_width: 0.95,
            nose_width: 0.82,
            tail_width: 0.94,
            pillar: 0.52,
            window_end: 0.92,
            ..hatchback
        },
        // The roof ends behind the rear seats; the top of the bed is where a saloon's boot is.
        Style::Pickup => Profile {
            nose: 0.57,
            cowl: 0.645,
            screen: [0.25, 0.355],
            rear: [0.60, 0.635],
            deck: 0.64,
            tail: 0.64,
            roof: [0.965, 0.965],
            sill: 0.19,
            axles: [0.17, 0.77],
            wheel_m: 0.395,
            roof_width: 0.82,
            shoulder_width: 0.945,
            nose_width: 0.84,
            tail_width: 0.95,
            pillar: 0.475,
            window_end: 0.60,
            black_sill: true,
            ..hatchback
        },
        Style::Minivan => Profile {
            nose: 0.45,
            cowl: 0.585,
            screen: [0.16, 0.37],
            rear: [0.925, 0.975],
            deck: 0.60,
            wheel_m: 0.315,
            roof_width: 0.80,
            pillar: 0.50,
            window_end: 0.90,
            ..hatchback
        },
        Style::PanelVan | Style::Bus => Profile {
            nose: 0.41,
            cowl: 0.52,
            screen: [0.115, 0.27],
            rear: [0.968, 0.985],
            deck: 0.58,
            tail: 0.50,
            roof: [0.965, 0.975],
            sill: 0.11,
            axles: [0.17, 0.79],
            wheel_m: 0.335,
            roof_width: 0.86,
            shoulder_width: 0.955,
            nose_width: 0.78,
            tail_width: 0.93,
            pillar: 0.39,
            window_end: 0.92,
            glazing: if style == Style::Bus { Glazing::Full } else { Glazing::Rear },
            ..hatchback
        },
    }
}

fn wheels(shape: &mut MeshBuilder, body: &Body, width: f32, materials: &VehicleMaterials, context: &mut BuildContext) {
    let rim = context.rng.range32(0.58, 0.74);
    let spokes = context.rng.pick(&[5, 5, 6, 7, 10, 12]);
    for axle in body.profile.axles {
        for side in [-1.0, 1.0] {
            let center = [body.x(axle), -body.wheel_radius(), side * width / 2.0 * 0.955];
            let wheel = Wheel { center, radius: body.wheel_radius(), width: 0.2, rim, spokes };
            wheel.build(shape, materials, context.detail);
        }
    }
}

fn mirrors(shape: &mut MeshBuilder, body: &Body, width: f32, materials: &VehicleMaterials) {
    let p = &body.profile;
    let t = p.screen[0] + (p.screen[1] - p.screen[0]) * 0.55;
    let [half, level] = body.shoulder(t);
    let x = body.x(t);
    let out = width / 2.0 - half + 0.02;
    for side in [-1.0f32, 1.0] {
        let (inner, outer) = (side * half, side * (half + out.max(0.1)).min(width / 2.0));
        let low = [x - 0.06, -level - 0.15, inner.min(outer)];
        let high = [x + 0.06, -level - 0.01, inner.max(outer)];
        shape.block_of(
            low,
            high,
            [
                Some(materials.glass),
                Some(materials.body),
                Some(materials.body),
                Some(materials.trim),
                Some(materials.body),
                Some(materials.body),
            ],
        );
    }
}

/// The dark inside of a pick-up's bed, or its cover, between the rails.
fn bed(shape: &mut MeshBuilder, body: &Body, [_, width, _]: [f32; 3], materials: &VehicleMaterials) {
    let p = &body.profile;
    let [front, rear] = [p.rear[1] + 0.015, 0.985];
    let half = width / 2.0 * 0.8;
    let corner = |t: f32, side: f32| [body.x(t), -body.roof_height(t) - 0.006, side * half];
    let points = [corner(front, -1.0), corner(rear, -1.0), corner(rear, 1.0), corner(front, 1.0)];
    shape.quad(points, materials.trim, 0);
}

/// The gaps around the doors.
fn gaps(shape: &mut MeshBuilder, body: &Body, materials: &VehicleMaterials, detail: Detail) {
    let p = &body.profile;
    let doors = [p.screen[0] + 0.055, p.pillar, p.window_end - 0.06];
    let half_gap = if detail == Detail::Near { 0.006 } else { 0.012 };
    for t in doors {
        let near_wheel = p.axles.iter().any(|axle| (t - axle).abs() < 0.075);
        let t = if near_wheel { t - 0.05 } else { t };
        let flank = body.flank(t);
        let x = body.x(t);
        for pair in flank.windows(2) {
            for side in [-1.0f32, 1.0] {
                let at = |[z, h]: [f32; 2], offset: f32| [x + offset, -h, side * (z + 0.004)];
                let points =
                    [at(pair[0], -half_gap), at(pair[0], half_gap), at(pair[1], half_gap), at(pair[1], -half_gap)];
                shape.quad(points, materials.gap, 0);
            }
        }
    }
}

/// Door handles, a strip along the doors, roof rails, an aerial.
fn extras(
    shape: &mut MeshBuilder,
    body: &Body,
    [height, width, _]: [f32; 3],
    materials: &VehicleMaterials,
    context: &mut BuildContext,
) {
    let p = &body.profile;
    let handle = if context.rng.chance(0.6) { materials.body } else { materials.trim };
    for t in [p.pillar - 0.04, p.pillar + 0.17] {
        let [z, h] = body.flank(t)[2];
        for side in [-1.0f32, 1.0] {
            let (a, b) = (side * (z - 0.02), side * (z + 0.018).min(width / 2.0));
            shape.cuboid([body.x(t) - 0.09, -h - 0.015, a.min(b)], [body.x(t) + 0.09, -h + 0.02, a.max(b)], handle);
        }
    }
    if context.rng.chance(0.3) {
        let rail = if context.rng.chance(0.5) { materials.chrome } else { materials.trim };
        for side in [-1.0f32, 1.0] {
            let z = side * width / 2.0 * p.roof_width * 0.9;
            let at = |t: f32| [body.x(t), -body.roof_height(t).min(height - 0.03), z];
            shape.tube(at(p.screen[1] + 0.06), at(p.rear[0] - 0.03), [0.018; 2], 5, rail);
        }
    }
    if context.rng.chance(0.4) {
        // A strip of rubber along the doors.
        let level = -height * context.rng.range32(0.30, 0.36);
        for side in [-1.0f32, 1.0] {
            let z = side * width / 2.0 * 1.002;
            let [a, b] = [body.x(p.axles[0] + 0.1), body.x(p.axles[1] - 0.1)];
            shape.quad(
                [[a, level + 0.03, z], [b, level + 0.03, z], [b, level - 0.03, z], [a, level - 0.03, z]],
                materials.trim,
                0,
            );
        }
    }
}
