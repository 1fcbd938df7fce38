//! The samplers on tensors against those of the core, which have no tensor library.

use farsight_core::Box2d;
use farsight_core::samplers::{self as core, FeatureMap, IntegralImage, grid_in_box};
use farsight_train::samplers::{box_means, grid_sample, roi_align};
use tch::{Kind, Tensor};

const SHAPE: [usize; 3] = [3, 9, 14];
/// Single precision of values up to 5; PyTorch goes through coordinates from -1 to 1.
const TOLERANCE: f64 = 1e-5;

fn values() -> Vec<f32> {
    (0..SHAPE.iter().product::<usize>()).map(|k| ((k * 7919 + 13) % 101) as f32 / 10.0 - 5.0).collect()
}

fn map() -> Tensor {
    Tensor::from_slice(&values()).view(SHAPE.map(|side| side as i64))
}

/// Places in and around the map, of no order.
fn numbers(count: usize, low: f64, high: f64) -> Vec<f64> {
    (0..count).map(|k| low + (high - low) * ((k * 104_729 + 71) % 9973) as f64 / 9973.0).collect()
}

fn boxes() -> Vec<Box2d> {
    let (xs, ys, widths) = (numbers(60, -4.0, 14.0), numbers(60, -9.0, 9.0), numbers(60, 0.05, 12.0));
    let mut boxes: Vec<Box2d> = (0..60)
        .map(|k| {
            let (x, y) = (xs[k], ys[(k * 7) % 60]);
            Box2d::new(x, y, x + widths[(k * 11) % 60], y + widths[(k * 13) % 60])
        })
        .collect();
    // All of it, a row, nothing, and no numbers.
    boxes.push(Box2d::new(-0.5, -0.5, 13.5, 8.5));
    boxes.push(Box2d::new(-0.5, 2.5, 13.5, 3.5));
    boxes.push(Box2d::new(4.0, 5.0, 4.0, 5.0));
    boxes.push(Box2d::new(f64::NAN, 0.0, 3.0, 3.0));
    boxes
}

#[track_caller]
fn assert_same(found: &Tensor, shape: &[i64], expected: &[f32]) {
    assert_eq!(found.size(), shape);
    let expected = Tensor::from_slice(expected).view(shape);
    let off = (found - expected).abs().max().double_value(&[]);
    assert!(off < TOLERANCE, "{off}");
}

#[test]
fn samples_at_points_are_those_of_the_core() {
    let (xs, ys) = (numbers(500, -3.0, 17.0), numbers(500, -3.0, 12.0));
    let mut points: Vec<[f64; 2]> = xs.into_iter().zip(ys.into_iter().rev()).map(|(x, y)| [x, y]).collect();
    points.extend([[0.0, 0.0], [13.0, 8.0], [-0.5, 8.5], [f64::NAN, 1.0], [1.0, f64::INFINITY]]);
    let values = values();
    let expected = core::grid_sample(FeatureMap::new(&values, SHAPE).unwrap(), &points);
    assert_same(&grid_sample(&map(), &points), &[3, points.len() as i64], &expected);
}

#[test]
fn bins_of_boxes_are_those_of_the_core() {
    let values = values();
    let core_map = FeatureMap::new(&values, SHAPE).unwrap();
    let boxes = &boxes()[..61];
    for samples in [1, 2, 3] {
        let expected = core::roi_align(core_map, boxes, [4, 3], samples);
        assert_same(&roi_align(&map(), boxes, [4, 3], samples), &[61, 3, 3, 4], &expected);
    }
}

#[test]
fn means_over_boxes_are_those_of_the_core() {
    let values = values();
    let boxes = boxes();
    let expected = IntegralImage::new(FeatureMap::new(&values, SHAPE).unwrap()).means(&boxes);
    assert_same(&box_means(&map(), &boxes), &[3, boxes.len() as i64], &expected);
}

/// Samplers are linear in the map, so the gradient of a sum of samples times the map is that sum.
#[test]
fn gradients_reach_the_map() {
    let boxes = &boxes()[..61];
    let points: Vec<[f64; 2]> = boxes.iter().flat_map(|area| grid_in_box(area, [2, 2])).collect();
    let samplers: [&dyn Fn(&Tensor) -> Tensor; 3] =
        [&|map| grid_sample(map, &points), &|map| roi_align(map, boxes, [4, 3], 2), &|map| box_means(map, boxes)];
    for sampler in samplers {
        let map = map().to_kind(Kind::Double).set_requires_grad(true);
        let sum = sampler(&map).sum(Kind::Double);
        sum.backward();
        let again = (map.grad() * &map).sum(Kind::Double).double_value(&[]);
        let sum = sum.double_value(&[]);
        assert!((again - sum).abs() < 1e-9 * sum.abs().max(1.0), "{again}, not {sum}");
    }
}
