// Exact answers are the point of several of these tests.
#![allow(clippy::float_cmp)]

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use proptest::prelude::*;

use super::{Block, Overlap, covered_share_2d, iou_2d, iou_3d, iou_bev};
use crate::{Box2d, Box3d, Dimensions};

/// How far two ways of computing one overlap may differ.
const TOLERANCE: f64 = 1e-9;

fn block(length: f64, width: f64, x: f64, z: f64, yaw: f64) -> Box3d {
    Box3d { dimensions: Dimensions { height: 1.5, width, length }, location: [x, 1.65, z], yaw }
}

/// Corners of the footprint in order around it, straight from rule 24.
fn footprint(b: &Box3d) -> [[f64; 2]; 4] {
    let (sin, cos) = b.yaw.sin_cos();
    let [l, w] = [b.dimensions.length / 2.0, b.dimensions.width / 2.0];
    [[l, w], [l, -w], [-l, -w], [-l, w]]
        .map(|[a, c]| [cos * a + sin * c + b.location[0], -sin * a + cos * c + b.location[2]])
}

/// The interval of z that a convex polygon covers at this x.
fn slice(polygon: &[[f64; 2]; 4], x: f64) -> Option<[f64; 2]> {
    let edges = (0..4).map(|i| (polygon[i], polygon[(i + 1) % 4]));
    let hits = edges.filter(|(p, q)| (p[0] - x) * (q[0] - x) < 0.0);
    hits.map(|(p, q)| p[1] + (x - p[0]) / (q[0] - p[0]) * (q[1] - p[1])).fold(None, |range, z| {
        let [low, high] = range.unwrap_or([z, z]);
        Some([z.min(low), z.max(high)])
    })
}

/// Shared area by slices: between two neighbouring corners or crossings its width is linear, so the middle slice tells
/// all of it.
fn area_by_slices(a: &Box3d, b: &Box3d) -> f64 {
    let [p, q] = [footprint(a), footprint(b)];
    let mut stops: Vec<f64> = p.iter().chain(&q).map(|c| c[0]).collect();
    for i in 0..4 {
        for j in 0..4 {
            let ([p0, p1], [q0, q1]) = ([p[i], p[(i + 1) % 4]], [q[j], q[(j + 1) % 4]]);
            let [[rx, rz], [sx, sz]] = [[p1[0] - p0[0], p1[1] - p0[1]], [q1[0] - q0[0], q1[1] - q0[1]]];
            let determinant = rx * sz - rz * sx;
            if determinant != 0.0 {
                stops.push(p0[0] + ((q0[0] - p0[0]) * sz - (q0[1] - p0[1]) * sx) / determinant * rx);
            }
        }
    }
    stops.sort_by(f64::total_cmp);
    let areas = stops.windows(2).map(|pair| {
        let middle = f64::midpoint(pair[0], pair[1]);
        let (Some(s), Some(t)) = (slice(&p, middle), slice(&q, middle)) else { return 0.0 };
        (s[1].min(t[1]) - s[0].max(t[0])).max(0.0) * (pair[1] - pair[0])
    });
    areas.sum()
}

fn any_box() -> impl Strategy<Value = Box3d> {
    let yaw = prop_oneof![-PI..PI, Just(0.0), Just(FRAC_PI_2), Just(FRAC_PI_4)];
    ([1.2..2.0, 0.3..3.0, 0.3..6.0], [-4.0..4.0, 1.0..2.0, 6.0..14.0], yaw).prop_map(
        |([height, width, length], location, yaw)| Box3d {
            dimensions: Dimensions { height, width, length },
            location,
            yaw,
        },
    )
}

/// `b` turned about the origin by `turn` and moved.
fn moved(b: &Box3d, turn: f64, shift: [f64; 2]) -> Box3d {
    let (sin, cos) = turn.sin_cos();
    let [x, y, z] = b.location;
    Box3d { location: [cos * x + sin * z + shift[0], y, -sin * x + cos * z + shift[1]], yaw: b.yaw + turn, ..*b }
}

fn scaled(b: &Box3d, factor: f64) -> Box3d {
    let Dimensions { height, width, length } = b.dimensions;
    let dimensions = Dimensions { height: height * factor, width: width * factor, length: length * factor };
    Box3d { dimensions, location: b.location.map(|v| v * factor), yaw: b.yaw }
}

proptest! {
    #[test]
    fn area_equals_the_area_by_slices(a in any_box(), b in any_box()) {
        let area = Block::new(&a).intersection_area(&Block::new(&b));
        prop_assert!((area - area_by_slices(&a, &b)).abs() < TOLERANCE);
    }

    #[test]
    fn overlap_is_symmetric(a in any_box(), b in any_box()) {
        prop_assert!((iou_bev(&a, &b) - iou_bev(&b, &a)).abs() < TOLERANCE);
        prop_assert!((iou_3d(&a, &b) - iou_3d(&b, &a)).abs() < TOLERANCE);
    }

    #[test]
    fn overlap_does_not_depend_on_place_heading_or_unit(
        a in any_box(), b in any_box(), turn in -PI..PI, shift in [-50.0..50.0, -50.0..50.0], factor in 0.01..100.0
    ) {
        for change in [&|c: &Box3d| moved(c, turn, shift), &|c: &Box3d| scaled(c, factor)] as [&dyn Fn(&Box3d) -> Box3d; 2] {
            prop_assert!((iou_bev(&a, &b) - iou_bev(&change(&a), &change(&b))).abs() < TOLERANCE);
            prop_assert!((iou_3d(&a, &b) - iou_3d(&change(&a), &change(&b))).abs() < TOLERANCE);
        }
    }

    #[test]
    fn a_box_overlaps_itself_wholly(a in any_box(), factor in prop_oneof![Just(1e-6), Just(1.0), Just(1e6)]) {
        let a = scaled(&a, factor);
        prop_assert_eq!(iou_bev(&a, &a), 1.0);
        prop_assert_eq!(iou_3d(&a, &a), 1.0);
    }

    #[test]
    fn a_box_inside_another_overlaps_by_the_ratio_of_the_areas(a in any_box(), share in 0.01..1.0_f64) {
        let Dimensions { height, width, length } = a.dimensions;
        let inner = Box3d { dimensions: Dimensions { height, width: width * share, length: length * share }, ..a };
        prop_assert!((iou_bev(&a, &inner) - share * share).abs() < TOLERANCE);
        prop_assert!((Block::new(&inner).covered(&Block::new(&a)).bev - 1.0).abs() < TOLERANCE);
    }

    #[test]
    fn parallel_boxes_that_share_a_line_of_edges_come_out_right(
        yaw in -PI..PI, width in 0.5..3.0, length in 0.5..6.0, longer in 1.0..2.0_f64
    ) {
        // Same centre, heading and width: the case where the devkit's library fails (rule 26).
        let (a, b) = (block(length, width, 2.0, 20.0, yaw), block(length * longer, width, 2.0, 20.0, yaw));
        prop_assert!((iou_bev(&a, &b) - 1.0 / longer).abs() < TOLERANCE);
    }

    #[test]
    fn any_numbers_give_a_share(values in proptest::array::uniform14(any::<f64>())) {
        let box3d = |v: &[f64]| Box3d {
            dimensions: Dimensions { height: v[0], width: v[1], length: v[2] },
            location: [v[3], v[4], v[5]],
            yaw: v[6],
        };
        let (a, b) = (box3d(&values[..7]), box3d(&values[7..]));
        let box2d = |v: &[f64]| Box2d::new(v[0], v[1], v[2], v[3]);
        let (c, d) = (box2d(&values[..4]), box2d(&values[4..8]));
        for overlap in [iou_bev(&a, &b), iou_3d(&a, &b), iou_2d(&c, &d), covered_share_2d(&c, &d)] {
            prop_assert!((0.0..=1.0).contains(&overlap), "{}", overlap);
        }
    }
}

#[test]
fn known_overlaps_seen_from_above() {
    let octagon = 8.0 * (2.0_f64.sqrt() - 1.0);
    let cases = [
        ("the same", block(4.0, 2.0, 0.0, 10.0, 0.0), block(4.0, 2.0, 0.0, 10.0, 0.0), 1.0),
        ("half a turn", block(4.0, 2.0, 0.0, 10.0, 0.4), block(4.0, 2.0, 0.0, 10.0, 0.4 + PI), 1.0),
        ("crossed", block(4.0, 2.0, 0.0, 10.0, 0.0), block(4.0, 2.0, 0.0, 10.0, FRAC_PI_2), 4.0 / 12.0),
        (
            "squares turned by 45 degrees",
            block(2.0, 2.0, 0.0, 0.0, 0.0),
            block(2.0, 2.0, 0.0, 0.0, FRAC_PI_4),
            octagon / (8.0 - octagon),
        ),
        ("half beside", block(4.0, 2.0, 0.0, 10.0, 0.0), block(4.0, 2.0, 2.0, 10.0, 0.0), 1.0 / 3.0),
        ("touching sides", block(4.0, 2.0, 0.0, 10.0, 0.0), block(4.0, 2.0, 4.0, 10.0, 0.0), 0.0),
        ("touching corners", block(2.0, 2.0, 0.0, 0.0, 0.0), block(2.0, 2.0, 2.0, 2.0, 0.0), 0.0),
        ("apart inside the circles", block(6.0, 1.0, 0.0, 0.0, 0.0), block(6.0, 1.0, 0.0, 2.0, 0.0), 0.0),
        ("far apart", block(4.0, 2.0, 0.0, 10.0, 0.0), block(4.0, 2.0, 0.0, 90.0, 0.0), 0.0),
        ("a shared edge, half as long", block(4.0, 2.0, 0.0, 0.0, 0.0), block(2.0, 2.0, 1.0, 0.0, 0.0), 0.5),
        ("micrometres", block(4e-6, 2e-6, 30.0, 10.0, 0.0), block(4e-6, 2e-6, 30.0, 10.0, FRAC_PI_2), 1.0 / 3.0),
        ("continents", block(4e6, 2e6, 30.0, 10.0, 0.0), block(4e6, 2e6, 30.0, 10.0, FRAC_PI_2), 1.0 / 3.0),
        ("a pebble on a continent", block(4e6, 2e6, 0.0, 0.0, 0.3), block(1e-6, 1e-6, 7e5, 7e4, 0.9), 1e-12 / 8e12),
        ("no width", block(4.0, 0.0, 0.0, 10.0, 0.0), block(4.0, 2.0, 0.0, 10.0, 0.0), 0.0),
        ("two without area", block(4.0, 0.0, 0.0, 10.0, 0.0), block(4.0, 0.0, 0.0, 10.0, 0.0), 0.0),
        ("negative width", block(4.0, -2.0, 0.0, 10.0, 0.0), block(4.0, 2.0, 0.0, 10.0, 0.0), 0.0),
        ("both negative", block(-4.0, -2.0, 0.0, 10.0, 0.0), block(4.0, 2.0, 0.0, 10.0, 0.0), 1.0),
        ("endless", block(f64::INFINITY, 2.0, 0.0, 10.0, 0.0), block(4.0, 2.0, 0.0, 10.0, 0.0), 0.0),
        ("no number", block(4.0, 2.0, f64::NAN, 10.0, 0.0), block(4.0, 2.0, 0.0, 10.0, 0.0), 0.0),
        ("no heading", block(4.0, 2.0, 0.0, 10.0, f64::NAN), block(4.0, 2.0, 0.0, 10.0, 0.0), 0.0),
    ];
    let failed: Vec<_> = cases
        .iter()
        .filter(|(_, a, b, want)| {
            (iou_bev(a, b) - want).abs() > want * TOLERANCE || (iou_bev(b, a) - want).abs() > want * TOLERANCE
        })
        .map(|(name, a, b, want)| format!("{name}: {} {}, expected {want}", iou_bev(a, b), iou_bev(b, a)))
        .collect();
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn known_overlaps_in_space() {
    let car = block(4.0, 2.0, 0.0, 10.0, 0.2);
    let lifted = |metres: f64| Box3d { location: [0.0, 1.65 - metres, 10.0], ..car };
    let flat = |height: f64| Box3d { dimensions: Dimensions { height, ..car.dimensions }, ..car };
    let cases = [
        ("the same", car, 1.0),
        ("half a height up", lifted(0.75), 1.0 / 3.0),
        ("on top", lifted(1.5), 0.0),
        ("above", lifted(4.0), 0.0),
        ("half as high", flat(0.75), 0.5),
        ("no height", flat(0.0), 0.0),
        ("upside down", flat(-1.5), 0.0),
        ("height that is no number", flat(f64::NAN), 0.0),
    ];
    for (name, other, want) in cases {
        assert!((iou_3d(&car, &other) - want).abs() < TOLERANCE, "{name}: {}", iou_3d(&car, &other));
        assert!((iou_3d(&other, &car) - want).abs() < TOLERANCE, "{name}, turned round: {}", iou_3d(&other, &car));
    }
}

#[test]
fn boxes_that_only_say_not_there_coincide_from_above_alone() {
    // DontCare's default box against a 2D-only detection written with the same numbers: quirk Q2.
    let nowhere = Box3d {
        dimensions: Dimensions { height: -1.0, width: -1.0, length: -1.0 },
        location: [-1000.0; 3],
        yaw: -10.0,
    };
    assert_eq!(Block::new(&nowhere).covered(&Block::new(&nowhere)), Overlap { bev: 1.0, volume: 0.0 });
    assert_eq!(iou_3d(&nowhere, &nowhere), 0.0);
}

#[test]
fn known_overlaps_in_the_image() {
    let unit = Box2d::new(0.0, 0.0, 10.0, 10.0);
    let cases = [
        ("the same", unit, 1.0, 1.0),
        ("exactly one half", Box2d::new(0.0, 0.0, 10.0, 5.0), 0.5, 0.5),
        ("no pixel is added at the edge", Box2d::new(10.0, 0.0, 20.0, 10.0), 0.0, 0.0),
        ("around", Box2d::new(-10.0, -10.0, 10.0, 10.0), 0.25, 1.0),
        ("swapped edges", Box2d::new(10.0, 10.0, 0.0, 0.0), 0.0, 0.0),
        ("swapped far apart", Box2d::new(90.0, 90.0, 50.0, 50.0), 0.0, 0.0),
        ("no number", Box2d::new(f64::NAN, 0.0, 10.0, 10.0), 0.0, 0.0),
        ("endless", Box2d::new(f64::NEG_INFINITY, 0.0, f64::INFINITY, 10.0), 0.0, 1.0),
    ];
    for (name, other, iou, covered) in cases {
        assert_eq!(iou_2d(&unit, &other), iou, "{name}");
        assert_eq!(covered_share_2d(&unit, &other), covered, "{name}");
    }
}
