//! Laws of cameras, boxes, heatmaps, peaks and suppression.

#![allow(clippy::unwrap_used, reason = "the helpers of a test may panic")]

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use farsight_core::heatmap::HeatmapRule;
use farsight_core::nms::{SAME_OBJECT_OVERLAP, bev_nms, class_nms, soft_suppression};
use farsight_core::overlap::iou_bev;
use farsight_core::peaks::peaks;
use farsight_core::{
    Affine2, Box2d, Box3d, Camera, DepthReference, Detection, Dimensions, ObjectClass, RangeError, wrapped_angle,
};
use proptest::prelude::*;

const EXACT: f64 = 1e-9;

/// A camera with a fourth column, as KITTI's.
fn kitti_like() -> Camera {
    let projection =
        [[721.5377, 0.0, 609.5593, 44.857], [0.0, 721.5377, 172.854, 0.2164], [0.0, 0.0, 1.0, 0.002_745_9]];
    Camera::from_projection(projection).unwrap()
}

fn box3d(location: [f64; 3], yaw: f64) -> Box3d {
    Box3d { dimensions: Dimensions { height: 1.5, width: 1.6, length: 3.9 }, location, yaw }
}

/// The smallest distance from the origin to a fine grid of points in and on the box.
fn distance_by_sampling(object: &Box3d, steps: usize) -> f64 {
    let share = |i: usize| i as f64 / steps as f64;
    let corners = object.corners();
    // Corner 7 is bottom, back, one side; 2, 0 and 6 are its neighbours along length, height and width.
    let [origin, along, up, across] = [corners[7], corners[2], corners[0], corners[6]];
    let point = |a: f64, b: f64, c: f64| {
        [0, 1, 2]
            .map(|k| origin[k] + a * (along[k] - origin[k]) + b * (up[k] - origin[k]) + c * (across[k] - origin[k]))
    };
    let cells = (0..=steps).flat_map(|i| (0..=steps).flat_map(move |j| (0..=steps).map(move |k| [i, j, k])));
    cells
        .map(|[i, j, k]| point(share(i), share(j), share(k)).iter().map(|v| v * v).sum::<f64>().sqrt())
        .fold(f64::INFINITY, f64::min)
}

proptest! {
    #[test]
    fn the_nearest_point_is_where_sampling_finds_it(x in -20.0..20.0, y in -3.0..3.0, z in -20.0..40.0, yaw in -PI..PI) {
        let object = box3d([x, y, z], yaw);
        let sampled = distance_by_sampling(&object, 40);
        let nearest = object.nearest_distance_m();
        // Samples are at most half a diagonal of the grid's cells away from the true nearest point.
        prop_assert!(nearest <= sampled + EXACT && sampled <= nearest + 0.06, "{nearest} and {sampled}");
        prop_assert!(nearest <= object.center_distance_m());
    }

    #[test]
    fn moved_by_its_tolerance_a_box_overlaps_where_it_was_by_as_much_as_asked(
        x in -20.0..20.0, z in 5.0..60.0, yaw in -PI..PI, overlap in 0.1..0.95,
    ) {
        let object = box3d([x, 1.7, z], yaw);
        let factor = 1.0 + object.depth_tolerance_m(overlap) / z;
        let moved = Box3d { location: [x * factor, 1.7, z * factor], ..object };
        prop_assert!((iou_bev(&object, &moved) - overlap).abs() < EXACT, "{}", iou_bev(&object, &moved));
    }

    #[test]
    fn a_pixel_at_a_depth_is_the_point_it_came_from(x in -30.0..30.0, y in -3.0..3.0, z in 1.0..90.0) {
        let camera = kitti_like();
        let point = [x, y, z];
        let back = camera.point_from_pixel(camera.pixel_from_point(point).unwrap(), z);
        for (a, b) in point.iter().zip(back) {
            prop_assert!((a - b).abs() < EXACT);
        }
    }

    #[test]
    fn a_mirrored_world_is_a_mirrored_image(x in -30.0..30.0, y in -3.0..3.0, z in 1.0..90.0, yaw in -PI..PI, width in 1_usize..4000) {
        let (camera, mirrored) = (kitti_like(), kitti_like().mirrored(width));
        let [u, v] = camera.pixel_from_point([x, y, z]).unwrap();
        let [mu, mv] = mirrored.pixel_from_point([-x, y, z]).unwrap();
        prop_assert!((mu - (width as f64 - 1.0 - u)).abs() < EXACT && (mv - v).abs() < EXACT);
        let object = box3d([x, y, z], yaw);
        prop_assert!(wrapped_angle(object.mirrored().mirrored().yaw - yaw).abs() < EXACT);
        let twice = mirrored.mirrored(width);
        prop_assert!(twice.projection.as_flattened().iter().zip(camera.projection.as_flattened()).all(|(a, b)| (a - b).abs() < 1e-6));
    }

    #[test]
    fn maps_undo_and_follow_each_other(cx in -500.0..2000.0, cy in -500.0..900.0, window in 50.0..4000.0, px in -100.0..2000.0, py in -100.0..900.0) {
        let map = Affine2::window([cx, cy], window, [1280, 384]);
        let back = map.inverse().unwrap().apply(map.apply([px, py]));
        prop_assert!((back[0] - px).abs() < 1e-7 && (back[1] - py).abs() < 1e-7);
        let next = Affine2::mirror(1280);
        let (one, two) = (map.then(&next).apply([px, py]), next.apply(map.apply([px, py])));
        prop_assert!((one[0] - two[0]).abs() < 1e-7 && (one[1] - two[1]).abs() < 1e-7);
    }

    #[test]
    fn angles_wrap_by_whole_turns(angle in -50.0..50.0) {
        let wrapped = wrapped_angle(angle);
        prop_assert!(-PI < wrapped && wrapped <= PI);
        let turns = (angle - wrapped) / TAU;
        prop_assert!((turns - turns.round()).abs() < EXACT);
    }

    #[test]
    fn a_heatmap_has_its_peak_in_its_cell_and_stays_in_the_map(w in 0.0..400.0, h in 0.0..400.0, column in 0_usize..40, row in 0_usize..12) {
        let mut map = vec![0.0_f32; 40 * 12];
        let rule = HeatmapRule::Dynamic { alpha: 0.12, min_radius: 1.0, max_radius: 16.0 };
        rule.gaussian(w, h, 1.0).draw(&mut map, 40, [column, row]);
        prop_assert!((map[row * 40 + column] - 1.0).abs() < f32::EPSILON);
        prop_assert!(map.iter().all(|v| (0.0..=1.0).contains(v)));
        prop_assert_eq!(peaks(&map, [40, 12], 10, |_| 0.5).len(), 1);
    }
}

#[test]
fn the_field_of_view_reaches_from_edge_to_edge() {
    let camera = Camera::from_hfov(90.0, 1920, 1080).unwrap();
    let [left, _] = camera.pixel_from_point([-10.0, 0.0, 10.0]).unwrap();
    let [right, _] = camera.pixel_from_point([10.0, 0.0, 10.0]).unwrap();
    assert!((right - left - 1920.0).abs() < EXACT);
    for angle in [0.0, 180.0, -5.0, f64::NAN] {
        assert!(Camera::from_hfov(angle, 1920, 1080).is_err(), "{angle}");
    }
}

#[test]
fn alpha_is_yaw_less_the_ray() {
    assert!((box3d([10.0, 1.6, 10.0], 0.0).alpha() + PI / 4.0).abs() < EXACT);
    assert!((box3d([0.0, 1.6, 10.0], -FRAC_PI_2).alpha() + FRAC_PI_2).abs() < EXACT);
    assert!((box3d([-10.0, 1.6, 10.0], PI).alpha() + 3.0 * PI / 4.0).abs() < EXACT);
}

#[test]
fn a_box_beside_the_camera_is_cut_at_the_near_plane_and_one_behind_is_not_seen() {
    let camera = kitti_like();
    let beside = box3d([1.8, 1.6, 0.5], FRAC_PI_2).projected(&camera).unwrap();
    assert!([beside.x1, beside.y1, beside.x2, beside.y2].iter().all(|v| v.is_finite()));
    assert!(beside.x1 > 609.0, "it is on the right: {beside:?}");
    assert_eq!(box3d([0.0, 1.6, -10.0], 0.0).projected(&camera), None);
}

#[test]
fn equal_neighbours_are_both_peaks_and_no_number_is_none() {
    let map = [0.5, 0.5, 0.0, f32::NAN, 0.9, 0.0];
    let found: Vec<_> = peaks(&map, [6, 1], 10, |_| 0.1).iter().map(|p| p.cell[0]).collect();
    assert_eq!(found, [4, 0, 1]);
    assert!(peaks(&[f32::NAN; 6], [3, 2], 10, |_| 0.0).is_empty());
    assert_eq!(peaks(&map, [6, 1], 1, |_| 0.1).len(), 1);
}

#[test]
fn an_error_bar_grows_with_the_focal_length_as_the_distance_does() {
    let error = Some(RangeError { bias: -3.0, depth: 1.2, score: -0.2, cut: 0.6 });
    let depth = DepthReference { focal_px: Some(700.0), error, ..DepthReference::KITTI };
    let sigma_m = |z: f64, f: f64| depth.sigma_m(z, 0.7, false, 4.0 * f).unwrap();
    assert!((sigma_m(40.0, 350.0) - 2.0 * sigma_m(20.0, 175.0)).abs() < EXACT);
    assert!(sigma_m(40.0, 175.0) > sigma_m(20.0, 175.0));
    let cut = depth.sigma_m(20.0, 0.7, true, 700.0).unwrap();
    assert!((cut - 0.6_f64.exp() * sigma_m(20.0, 175.0)).abs() < EXACT);
    assert_eq!(depth.sigma_m(-1.0, 0.7, false, 700.0), None, "behind the camera there is none");
    assert_eq!(DepthReference::KITTI.sigma_m(20.0, 0.7, false, 700.0), None, "not fitted");
}

#[test]
fn a_turned_camera_keeps_its_focal_length() {
    let (f, cx, cy) = (700.0, 610.0, 170.0);
    let (sin, cos) = 0.3_f64.sin_cos();
    // K R for a pitch of 0.3 radians.
    let rows =
        [[f, -cx * sin, cx * cos, 0.0], [0.0, f * cos - cy * sin, f * sin + cy * cos, 0.0], [0.0, -sin, cos, 0.0]];
    let camera = Camera::from_projection(rows).unwrap();
    assert!((camera.focal_x() - f).abs() < 1e-9, "{}", camera.focal_x());
    assert!((camera.focal_y() - f).abs() < 1e-9, "{}", camera.focal_y());
}

#[test]
fn a_camera_whose_image_axis_points_along_the_view_is_refused() {
    let with_second_row = |row: [f64; 4]| {
        Camera::from_projection([[700.0, 0.0, 600.0, 0.0], row, [0.0, 1e9, 1.0, 0.0]])
            .map_err(|error| error.to_string())
    };
    assert!(with_second_row([0.0, 700.0, 180.0, 0.0]).is_err(), "all but along the last row");
    let refused = "the projection is not a camera: an axis of the image points along the view";
    assert_eq!(with_second_row([0.0, 1e12, 1e3 - 1e-4, 0.0]).unwrap_err(), refused);
}

#[test]
fn all_distances_to_a_box_are_off_by_the_same_factor() {
    let aside = Detection { range_sigma_m: Some(1.0), ..standing(ObjectClass::Car, 0.9, -15.0) };
    // The box 1 m deeper on its ray, and larger by as much.
    let factor = 21.0 / 20.0;
    let moved = aside.box3d.scaled(factor);
    for distance_m in [Box3d::depth_m, Box3d::center_distance_m, Box3d::nearest_distance_m] {
        let [here, there] = [&aside.box3d, &moved].map(distance_m);
        assert!((aside.sigma_of_m(here).unwrap() - (there - here)).abs() < 1e-9, "{here} {there}");
    }
}

/// Something 3.9 m long that stands across, 20 m ahead and so far to the right.
fn standing(class: ObjectClass, score: f64, x: f64) -> Detection {
    let box2d = Box2d::new(0.0, 0.0, 10.0, 10.0);
    Detection { class, score, box2d, box3d: box3d([x, 1.6, 20.0], 0.0), range_sigma_m: None }
}

#[test]
fn of_things_in_one_place_the_best_stays() {
    // Cars 3.9 m long, one behind the other: the second covers half of the first, the third touches the second, the
    // fourth the third.
    let (car, van) = (ObjectClass::Car, ObjectClass::Van);
    let all = vec![
        standing(car.clone(), 0.9, 0.0),
        standing(van, 0.8, 1.3),
        standing(car.clone(), 0.7, 3.9),
        standing(car, 0.6, 7.0),
    ];
    let left = |max_overlap: f64| bev_nms(all.clone(), max_overlap).iter().map(|d| d.score).collect::<Vec<_>>();
    assert_eq!(left(0.2), [0.9, 0.7, 0.6]);
    assert_eq!(left(0.05), [0.9, 0.7]);
    assert_eq!(left(1.0), [0.9, 0.8, 0.7, 0.6]);
}

#[test]
fn no_two_things_stand_in_one_place() {
    let (car, van) = (ObjectClass::Car, ObjectClass::Van);
    // Cars 3.9 m long, one behind the other. Overlaps with the first: of the second a half, of the third an eighth, of
    // the last none; of the third with the second more than a third.
    let step = 3.9 / 3.0;
    let eighth = 3.9 * 7.0 / 9.0;
    let all = vec![
        standing(car.clone(), 0.8, 0.0),
        standing(van.clone(), 0.6, step),
        standing(car.clone(), 0.5, eighth),
        standing(car.clone(), 0.4, 12.0),
    ];
    let scores: Vec<(ObjectClass, f64)> =
        soft_suppression(all.clone()).into_iter().map(|d| (d.class, d.score)).collect();
    let second = 0.6 * (1.0 - 0.8);
    let with_van = iou_bev(&all[1].box3d, &all[2].box3d) / 0.25;
    assert!((iou_bev(&all[0].box3d, &all[1].box3d) - 0.5).abs() < 1e-9 && with_van > 1.0);
    let third = 0.5 * (1.0 - 0.8 * 0.5) * (1.0 - second);
    let expected = [(car.clone(), 0.8), (car.clone(), 0.4), (car, third), (van, second)];
    for ((class, score), (expected_class, expected)) in scores.iter().zip(&expected) {
        assert!(class == expected_class && (score - expected).abs() < 1e-9, "{scores:?}, expected {expected:?}");
    }

    // What is left out below changes nothing above, and one alone keeps its score.
    for most in 0..all.len() {
        let fewer = soft_suppression(all[..most].to_vec());
        for detection in fewer {
            assert!(scores.contains(&(detection.class.clone(), detection.score)), "{detection:?} of the first {most}");
        }
    }
}

#[test]
fn what_is_seen_as_one_at_one_distance_is_one() {
    let (car, van, pedestrian) = (ObjectClass::Car, ObjectClass::Van, ObjectClass::Pedestrian);
    // Boxes 100 pixels wide and so far apart in the image; in space never in one place, so far apart in depth, with an
    // error bar of 1 m.
    let seen = |class: &ObjectClass, score: f64, x1: f64, z: f64| Detection {
        class: class.clone(),
        score,
        box2d: Box2d::new(x1, 0.0, x1 + 100.0, 50.0),
        box3d: box3d([0.0, 1.6, z], 0.0),
        range_sigma_m: Some(1.0),
    };
    let second = |other: Detection| soft_suppression(vec![seen(&car, 0.8, 0.0, 20.0), other])[1].score;
    for (x1, z) in [(0.0, 22.0), (10.0, 22.0), (30.0, 22.0), (0.0, 23.0), (30.0, 18.0)] {
        let in_sight = (((100.0 - x1) / (100.0 + x1) - 0.4) / 0.3_f64).min(1.0);
        let in_depth = 1.0 - (z - 20.0_f64).abs() / 2.0_f64.sqrt() / 2.5;
        assert!(
            in_sight * in_depth > 0.1 && iou_bev(&box3d([0.0, 1.6, 20.0], 0.0), &box3d([0.0, 1.6, z], 0.0)) < 1e-12
        );
        for class in [&car, &van] {
            let score = second(seen(class, 0.5, x1, z));
            assert!((score - 0.5 * (1.0 - 0.8 * in_sight * in_depth)).abs() < 1e-9, "{class} at {x1}, {z}: {score}");
        }
    }
    // Too far apart in the image, or in space by error bars of 1.4 m together; somebody before a car; nothing known of
    // the distance.
    for other in [
        seen(&car, 0.5, 50.0, 22.0),
        seen(&car, 0.5, 0.0, 23.6),
        seen(&pedestrian, 0.5, 0.0, 22.0),
        Detection { range_sigma_m: None, ..seen(&car, 0.5, 0.0, 22.0) },
    ] {
        assert!((second(other.clone()) - 0.5).abs() < 1e-12, "{other:?}");
    }
}

#[test]
fn of_boxes_of_a_class_around_one_thing_the_best_stays() {
    let found = |class: ObjectClass, score: f64, x1: f64| Detection {
        class,
        score,
        box2d: Box2d::new(x1, 0.0, x1 + 100.0, 50.0),
        box3d: box3d([0.0, 1.6, 20.0], 0.0),
        range_sigma_m: None,
    };
    let (car, van) = (ObjectClass::Car, ObjectClass::Van);
    // Overlaps with the first: of the second 0.82, of the van 1, of the last 0.67.
    let all =
        vec![found(car.clone(), 0.9, 0.0), found(car.clone(), 0.8, 10.0), found(van, 0.7, 0.0), found(car, 0.6, 20.0)];
    let left: Vec<f64> = class_nms(all, SAME_OBJECT_OVERLAP).iter().map(|d| d.score).collect();
    assert_eq!(left, [0.9, 0.7, 0.6]);
}
