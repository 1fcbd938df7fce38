//! Passenger cars and vans.

use super::body::{Body, Glazing, Profile};
use super::context::{BuildContext, Detail};
use super::paint::{VehicleMaterials, car_materials, fleet_materials};
use super::profiles::base_profile;
use super::style::Style;
use super::wheels::Wheel;
use super::{cabin, faces};
use crate::mesh_builder::MeshBuilder;
use crate::rng::SceneRng;
use crate::scene::Mesh;

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
