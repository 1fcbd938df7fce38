//! Laws of the samplers.

use proptest::prelude::*;

use super::*;
use crate::{Box2d, Camera};

const SHAPE: [usize; 3] = [2, 7, 11];
/// Single precision of values up to 100.
const TOLERANCE: f32 = 1e-4;

/// Values of no order.
fn noise() -> Vec<f32> {
    (0..SHAPE.iter().product::<usize>()).map(|k| ((k * 7919 + 13) % 101) as f32 / 10.0 - 5.0).collect()
}

/// `2 x + 3 y - 1` in channel 0, its negative in channel 1.
fn ramp() -> Vec<f32> {
    let [_, height, width] = SHAPE;
    let value = |k: usize| 2.0 * (k % width) as f32 + 3.0 * (k / width) as f32 - 1.0;
    (0..height * width).map(value).chain((0..height * width).map(|k| -value(k))).collect()
}

fn map(values: &[f32]) -> FeatureMap<'_> {
    FeatureMap::new(values, SHAPE).expect("as many values")
}

fn is_close(found: &[f32], expected: &[f32]) -> bool {
    found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < TOLERANCE)
}

/// The cell (`x`, `y`) of a channel, zero outside.
fn cell(values: &[f32], channel: usize, x: i64, y: i64) -> f32 {
    let [_, height, width] = SHAPE;
    let is_inside = (0..width as i64).contains(&x) && (0..height as i64).contains(&y);
    if is_inside { values[(channel * height + y as usize) * width + x as usize] } else { 0.0 }
}

/// A sum over all cells, each weighted by its tent.
fn naive_sample(values: &[f32], channel: usize, [x, y]: [f64; 2]) -> f32 {
    let [_, height, width] = SHAPE;
    let tent = |distance: f64| (1.0 - distance.abs()).max(0.0);
    let cells = (0..height as i64).flat_map(|row| (0..width as i64).map(move |column| (column, row)));
    let terms = cells.map(|(column, row)| {
        tent(x - column as f64) * tent(y - row as f64) * f64::from(cell(values, channel, column, row))
    });
    terms.sum::<f64>() as f32
}

/// A sum over all cells, each weighted by how much of it the box covers; `None` when it covers nothing.
fn naive_mean(values: &[f32], channel: usize, area: &Box2d) -> Option<f32> {
    let [_, height, width] = SHAPE;
    let covered = |low: f64, high: f64, at: f64| (high.min(at + 0.5) - low.max(at - 0.5)).max(0.0);
    let (mut sum, mut weight) = (0.0, 0.0);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let share = covered(area.x1, area.x2, x as f64) * covered(area.y1, area.y2, y as f64);
        sum += share * f64::from(cell(values, channel, x as i64, y as i64));
        weight += share;
    }
    (weight > 0.0).then(|| (sum / weight) as f32)
}

fn any_box() -> impl Strategy<Value = Box2d> {
    let edges = (-4.0..14.0_f64, 0.01..9.0_f64, -4.0..9.0_f64, 0.01..9.0_f64);
    edges.prop_map(|(x, width, y, height)| Box2d::new(x, y, x + width, y + height))
}

proptest! {
    #[test]
    fn samples_are_those_of_the_definition(x in -3.0..14.0_f64, y in -3.0..10.0_f64) {
        let values = noise();
        let expected = [0, 1].map(|channel| naive_sample(&values, channel, [x, y]));
        prop_assert!(is_close(&grid_sample(map(&values), &[[x, y]]), &expected));
    }

    #[test]
    fn a_ramp_is_sampled_exactly(x in 0.0..10.0_f64, y in 0.0..6.0_f64) {
        let expected = (2.0 * x + 3.0 * y - 1.0) as f32;
        prop_assert!(is_close(&grid_sample(map(&ramp()), &[[x, y]]), &[expected, -expected]));
    }

    #[test]
    fn means_are_those_of_the_definition(area in any_box()) {
        let values = noise();
        let expected = [0, 1].map(|channel| naive_mean(&values, channel, &area).unwrap_or(0.0));
        prop_assert!(is_close(&IntegralImage::new(map(&values)).means(&[area]), &expected), "{:?}", area);
    }

    #[test]
    fn a_constant_map_has_that_mean_wherever_a_box_meets_it(area in any_box()) {
        let values = vec![3.25; SHAPE.iter().product()];
        let means = IntegralImage::new(map(&values)).means(&[area]);
        let meets = area.x1 < 10.5 && area.x2 > -0.5 && area.y1 < 6.5 && area.y2 > -0.5;
        prop_assert!(is_close(&means, &[if meets { 3.25 } else { 0.0 }; 2]), "{:?}: {:?}", area, means);
    }

    #[test]
    fn a_ramps_mean_over_whole_cells_is_its_value_in_their_middle(
        left in 0_usize..11, right in 0_usize..11, upper in 0_usize..7, lower in 0_usize..7,
    ) {
        prop_assume!(left <= right && upper <= lower);
        let area = Box2d::new(left as f64 - 0.5, upper as f64 - 0.5, right as f64 + 0.5, lower as f64 + 0.5);
        let expected = (left + right) as f32 + 1.5 * (upper + lower) as f32 - 1.0;
        prop_assert!(is_close(&IntegralImage::new(map(&ramp())).means(&[area]), &[expected, -expected]));
    }

    #[test]
    fn bins_of_a_ramp_are_its_values_in_their_middles(
        x in 0.0..5.0_f64, y in 0.0..3.0_f64, width in 0.5..5.0_f64, height in 0.5..3.0_f64, samples in 1_usize..4,
    ) {
        let area = Box2d::new(x, y, x + width, y + height);
        let bins = grid_in_box(&area, [3, 2]).into_iter().map(|[x, y]| (2.0 * x + 3.0 * y - 1.0) as f32);
        let positive: Vec<f32> = bins.collect();
        let expected: Vec<f32> = positive.iter().copied().chain(positive.iter().map(|value| -value)).collect();
        prop_assert!(is_close(&roi_align(map(&ramp()), &[area], [3, 2], samples), &expected));
    }

    #[test]
    fn a_face_seen_in_perspective_has_its_cells_where_the_camera_sees_them(
        x in -4.0..4.0_f64, y in -1.0..2.0_f64, z in 6.0..40.0_f64, yaw in -1.2..1.2_f64,
    ) {
        let camera = Camera::from_intrinsics(720.0, 715.0, 610.0, 172.0).expect("a camera");
        let across = [yaw.cos(), 0.0, -yaw.sin()];
        // A face 4 m wide and 1.5 m high.
        let on_face = |u: f64, v: f64| [x + 4.0 * u * across[0], y + 1.5 * v, z + 4.0 * u * across[2]];
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(u, v)| on_face(u, v));
        let grid = grid_on_face(face_corners(&camera, corners).expect("before the camera"), [5, 3]).expect("a square");
        for (k, [u, v]) in grid.into_iter().enumerate() {
            let point = on_face(((k % 5) as f64 + 0.5) / 5.0, ((k / 5) as f64 + 0.5) / 3.0);
            let [expected_u, expected_v] = camera.pixel_from_point(point).expect("before the camera");
            let is_there = (u - expected_u).abs() < 1e-6 && (v - expected_v).abs() < 1e-6;
            prop_assert!(is_there, "{u} {v}, not {expected_u} {expected_v}");
        }
    }
}

#[test]
fn a_map_over_its_own_box_is_itself() {
    let values = noise();
    let whole = Box2d::new(-0.5, -0.5, 10.5, 6.5);
    assert_eq!(grid_sample(map(&values), &grid_in_box(&whole, [11, 7])), values);
    assert_eq!(roi_align(map(&values), &[whole, whole], [11, 7], 1), [values.clone(), values].concat());
}

#[test]
fn outside_a_map_is_zero() {
    let values = vec![4.0; SHAPE.iter().product()];
    let points =
        [[-0.5, 3.0], [10.5, 6.5], [-1.0, 3.0], [f64::NAN, 3.0], [3.0, f64::INFINITY], [0.0, 0.0], [10.0, 6.0]];
    let samples = grid_sample(map(&values), &points);
    assert_eq!(samples[..7], [2.0, 1.0, 0.0, 0.0, 0.0, 4.0, 4.0]);
    let nothing = [Box2d::new(f64::NAN, 0.0, 1.0, 1.0), Box2d::new(3.0, 2.0, 3.0, 4.0), Box2d::new(5.0, 2.0, 4.0, 3.0)];
    assert_eq!(IntegralImage::new(map(&values)).means(&nothing), [0.0; 6]);
    assert_eq!(FeatureMap::new(&values, [2, 7, 10]), None);
    assert_eq!(roi_align(map(&values), &[], [3, 3], 2), [0.0; 0]);
}

#[test]
fn what_no_square_looks_like_has_no_grid() {
    let line = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]];
    assert_eq!(grid_on_face(line, [2, 2]), None);
    let crossed = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    assert_eq!(grid_on_face(crossed, [2, 2]), None);
    assert_eq!(grid_on_face([[f64::NAN, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], [2, 2]), None);
    let camera = Camera::from_intrinsics(700.0, 700.0, 600.0, 180.0).expect("a camera");
    assert_eq!(face_corners(&camera, [[0.0, 0.0, 5.0], [1.0, 0.0, 5.0], [1.0, 1.0, -5.0], [0.0, 1.0, 5.0]]), None);
}
