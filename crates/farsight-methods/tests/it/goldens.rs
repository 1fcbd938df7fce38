//! Heatmaps, corner loss and decoding against an independent implementation, computed in f64 (goldens `heatmaps`,
//! `disentangled`, `topk_decode`).
// Clippy's exceptions for tests reach functions marked `#[test]`, not the helpers beside them.

use farsight_core::DepthReference;
use farsight_core::box3d::NEAR_PLANE_M;
use farsight_core::detection::{Detection, View};
use farsight_core::heatmap::HeatmapRule;
use farsight_core::peaks::peaks;
use farsight_core::{Affine2, Box3d, Camera, ClassReference, Dimensions, wrapped_angle};
use farsight_methods::smoke::Codec;
use farsight_methods::smoke::codec::Regression;
use farsight_methods::smoke::corner_loss::corner_loss;
use farsight_methods::smoke::decode::detection;
use farsight_methods::smoke::targets::ObjectTarget;
use farsight_testing::Golden;

const MAP: [usize; 2] = [320, 96];
const HEAT_MAP_TOLERANCE: f32 = 1e-6;
/// As a share of the largest gradient, or of the loss: both are computed in double precision.
const LOSS_TOLERANCE: f64 = 1e-6;
const DECODE_TOLERANCE: f64 = 1e-4;
/// What official SMOKE divides the sum of its loss by.
const LOSS_DIVISOR: f64 = 300.0;

fn codec() -> Codec {
    Codec { classes: ClassReference::smoke(), depth: DepthReference::KITTI }
}

fn camera([fx, _, cx, _, fy, cy, ..]: [f64; 9]) -> Camera {
    Camera::from_intrinsics(fx, fy, cx, cy).unwrap()
}

fn affine([a, b, c, d, e, f, ..]: [f64; 9]) -> Affine2 {
    Affine2 { matrix: [[a, b, c], [d, e, f]] }
}

#[test]
fn heatmaps_and_radii_agree() {
    let golden = Golden::open("heatmaps");
    let integer = |alpha| HeatmapRule::DynamicInteger { alpha, min_radius: 1.0, max_radius: 24.0 };
    let rules = [
        ("fixed2", HeatmapRule::Fixed { radius: 2.0, min_radius: 0.0 }),
        ("cornernet", HeatmapRule::SMOKE),
        ("dyn080", integer(0.08)),
        ("dyn150", integer(0.15)),
        ("dghc120", HeatmapRule::Dynamic { alpha: 0.12, min_radius: 1.0, max_radius: 16.0 }),
    ];
    let (widths, heights, classes) = (golden.numbers("w"), golden.numbers("h"), golden.integers("cls"));
    let centers = golden.integers("center").as_chunks::<2>().0.to_vec();
    for (name, rule) in rules {
        let mut map = vec![0.0; 3 * MAP[0] * MAP[1]];
        let radii: Vec<f64> = (0..widths.len())
            .map(|i| {
                let gaussian = rule.gaussian(widths[i], heights[i], 1.0);
                gaussian.draw(&mut map[classes[i] * MAP[0] * MAP[1]..][..MAP[0] * MAP[1]], MAP[0], centers[i]);
                gaussian.radius
            })
            .collect();
        check_radii(&golden, name, &radii);
        let expected = golden.to_f32(&format!("{name}.heatmap"));
        let worst = map.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst <= HEAT_MAP_TOLERANCE, "{name}: {worst}");
    }
}

fn check_radii(golden: &Golden, name: &str, radii: &[f64]) {
    if name == "dghc120" {
        // Continuous: as good as the f32 it is stored in.
        let expected = golden.numbers("dghc120.gamma");
        assert!(radii.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{name}: {radii:?}");
    } else {
        let expected: Vec<_> = golden.integers(&format!("{name}.radius")).into_iter().map(|r| r as f64).collect();
        assert_eq!(radii, expected, "{name}");
    }
}

#[test]
fn the_corner_loss_and_its_gradient_agree() {
    let golden = Golden::open("disentangled");
    let [cameras, inverse_maps] = ["tgt.K", "tgt.Tinv"].map(|name| golden.rows::<9>(name));
    let [raw, gradients] = ["raw", "d_raw"].map(|name| golden.rows::<8>(name));
    let [dimensions, locations] = ["tgt.lhw", "tgt.loc"].map(|name| golden.rows::<3>(name));
    let [masks, flips, classes] = ["tgt.mask", "tgt.flip", "tgt.cls"].map(|name| golden.integers(name));
    let yaws = golden.numbers("tgt.ry");
    let cells = golden.integers("tgt.ipt").as_chunks::<2>().0.to_vec();

    let mut sums = [0.0; 3];
    let scale = gradients.as_flattened().iter().fold(0.0_f64, |max, g| max.max(g.abs()));
    for i in (0..masks.len()).filter(|i| masks[*i] == 1) {
        let [length, height, width] = dimensions[i];
        // The official label of a flipped image has front and back exchanged.
        let yaw = if flips[i] == 1 { wrapped_angle(yaws[i] + std::f64::consts::PI) } else { yaws[i] };
        let box3d = Box3d { dimensions: Dimensions { height, width, length }, location: locations[i], yaw };
        let target = ObjectTarget { class: classes[i], cell: cells[i], box3d };
        let feature = camera(cameras[i]).transformed(&affine(inverse_maps[i]).inverse().unwrap());
        let loss = corner_loss(&codec(), raw[i], &target, &feature);
        for (sum, part) in sums.iter_mut().zip([loss.orientation, loss.dimensions, loss.location]) {
            *sum += part.value / LOSS_DIVISOR;
        }
        let smoke = loss.orientation + loss.dimensions + loss.location;
        for (channel, (found, expected)) in smoke.gradient.iter().zip(gradients[i]).enumerate() {
            let difference = (found / LOSS_DIVISOR - expected).abs();
            assert!(difference <= LOSS_TOLERANCE * scale, "slot {i}, channel {channel}: {found} {expected}");
        }
    }
    for (name, found) in ["loss_ori", "loss_dim", "loss_loc"].into_iter().zip(sums) {
        let expected = golden.numbers(name)[0];
        assert!((found - expected).abs() <= LOSS_TOLERANCE * expected, "{name}: {found} {expected}");
    }
}

#[test]
fn peaks_and_detections_agree() {
    let golden = Golden::open("topk_decode");
    let heatmap = golden.to_f32("heatmap");
    let regressions = golden.numbers("reg");
    let image_camera = camera(golden.rows("K")[0]);
    let feature = image_camera.transformed(&affine(golden.rows("trans_feat")[0]));
    let input_camera = feature.transformed(&Affine2::scaling(4.0));
    let view = View { image_size: [1242, 375], camera: image_camera, input_camera };
    for count in [50, 100] {
        let found = peaks(&heatmap, MAP, count, |_| 0.0);
        let expected = |name: &str| golden.integers(&format!("k{count}.{name}"));
        assert_eq!(found.iter().map(|p| p.class).collect::<Vec<_>>(), expected("cls"), "top {count}");
        assert_eq!(found.iter().map(|p| p.cell[0]).collect::<Vec<_>>(), expected("x"), "top {count}");
        assert_eq!(found.iter().map(|p| p.cell[1]).collect::<Vec<_>>(), expected("y"), "top {count}");
        let rows = golden.rows::<14>(&format!("k{count}.rows"));
        let mut boxes = 0;
        for (peak, row) in found.iter().zip(&rows) {
            let index = peak.cell[1] * MAP[0] + peak.cell[0];
            let activated = std::array::from_fn(|channel| regressions[channel * MAP[0] * MAP[1] + index]);
            let regression = Regression::from_activated(activated);
            assert_eq!(peak.class, row[0] as usize);
            assert!(wrapped_angle(regression.alpha() - row[1]).abs() < DECODE_TOLERANCE, "{row:?}");
            let score = f64::from(peak.value);
            let Some(found) = detection(&codec(), peak, score, regression, &feature, &view) else {
                // The map is random: some of its boxes lie behind the camera. Official SMOKE keeps them, we do not.
                assert!(row[11] < row[8], "{row:?}");
                continue;
            };
            boxes += check_detection(&found, row);
        }
        // Enough of them lie wholly ahead to have a box that official SMOKE has too.
        assert!(boxes > 20, "{boxes}");
    }
}

/// Compares a detection with a golden row; 1 when its 2D box could be compared too.
fn check_detection(found: &Detection, row: &[f64; 14]) -> usize {
    let Dimensions { height, width, length } = found.box3d.dimensions;
    let [x, y, z] = found.box3d.location;
    assert!(wrapped_angle(found.box3d.yaw - row[12]).abs() < DECODE_TOLERANCE, "{row:?}");
    for (found, expected) in [height, width, length, x, y, z].iter().zip(&row[6..12]) {
        assert!((found - expected).abs() <= DECODE_TOLERANCE * expected.abs().max(1.0), "{found} {row:?}");
    }
    assert!((found.score - row[13]).abs() < DECODE_TOLERANCE);
    if found.box3d.corners().iter().any(|corner| corner[2] < NEAR_PLANE_M) {
        // Ours is cut at the near plane; official SMOKE projects what is behind the camera, too.
        return 0;
    }
    let b = found.box2d;
    for (found, expected) in [b.x1, b.y1, b.x2, b.y2].iter().zip(&row[2..6]) {
        assert!((found - expected).abs() <= DECODE_TOLERANCE * expected.abs().max(1.0), "{found} {row:?}");
    }
    1
}
