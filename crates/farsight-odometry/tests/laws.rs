//! Known motions come back within their error bars.
#![allow(clippy::unwrap_used, reason = "a test")]

mod world;

use farsight_core::Box2d;
use farsight_odometry::{CameraMotion, HeightEstimator, Odometry, OdometryFrame};
use world::{Board, HEIGHT_M, Pose, SIZE, board_box, camera, picture, posts};

const DT_S: f64 = 0.1;

/// Largest errors beside three standard deviations: m/s, as a share of the speed beside that, and rad/s.
const SPEED_MPS: f64 = 0.1;
const SPEED_SHARE: f64 = 0.03;
const YAW_RATE: f64 = 0.005;

/// The motions between pictures of a way; boards may be others in each, boxes cover what is told of them.
fn motions(poses: &[Pose], boards: impl Fn(usize) -> (Vec<Board>, Vec<Box2d>)) -> Vec<Option<CameraMotion>> {
    let mut odometry = Odometry::above_road(HEIGHT_M, 0.02);
    let camera = camera();
    let look = |(number, pose): (usize, &Pose)| {
        let (boards, objects) = boards(number);
        let rgb = picture(pose, &boards);
        odometry.update(&OdometryFrame {
            time_s: number as f64 * DT_S,
            image_size: SIZE,
            rgb: &rgb,
            camera: &camera,
            objects: &objects,
            looks_cut: false,
        })
    };
    poses.iter().enumerate().map(look).collect()
}

/// A way at this speed and yaw rate.
fn way(speed: f64, yaw_rate: f64, count: usize) -> Vec<Pose> {
    let mut pose = Pose::default();
    (0..count)
        .map(|_| {
            let now = pose;
            let yaw = pose.yaw + 0.5 * yaw_rate * DT_S;
            pose.x -= speed * DT_S * yaw.sin();
            pose.z += speed * DT_S * yaw.cos();
            pose.yaw += yaw_rate * DT_S;
            now
        })
        .collect()
}

#[track_caller]
fn check(found: &[Option<CameraMotion>], speed: f64, yaw_rate: f64) {
    assert!(found[0].is_none(), "one picture tells no motion");
    for (number, motion) in found.iter().enumerate().skip(1) {
        let motion =
            motion.unwrap_or_else(|| panic!("picture {number} of {speed} m/s, {yaw_rate} rad/s tells nothing"));
        let off = [motion.speed_mps - speed, motion.yaw_rate - yaw_rate];
        assert!(
            off[0].abs() < (SPEED_MPS + SPEED_SHARE * speed.abs()).min(3.0 * motion.speed_sigma_mps),
            "{number}: {speed} m/s: {motion:?}"
        );
        assert!(off[1].abs() < YAW_RATE.min(3.0 * motion.yaw_rate_sigma), "{number}: {yaw_rate} rad/s: {motion:?}");
    }
}

#[test]
fn a_known_motion_comes_back_within_its_error_bars() {
    for [speed, yaw_rate] in [[3.0, 0.0], [9.0, 0.15], [14.0, -0.05], [-2.0, 0.1]] {
        check(&motions(&way(speed, yaw_rate, 5), |_| (posts(), Vec::new())), speed, yaw_rate);
    }
}

#[test]
fn a_standing_camera_stands() {
    let found = motions(&way(0.0, 0.0, 4), |_| (posts(), Vec::new()));
    check(&found, 0.0, 0.0);
    for motion in found.iter().flatten() {
        assert!(motion.speed_mps.abs() < 0.02 && motion.yaw_rate.abs() < 1e-3, "{motion:?}");
    }
}

#[test]
fn turning_and_nodding_are_no_driving() {
    let pitches = [0.0, 0.004, -0.003, 0.006];
    let poses: Vec<Pose> =
        pitches.iter().enumerate().map(|(k, &pitch)| Pose { yaw: 0.02 * k as f64, pitch, ..Pose::default() }).collect();
    let found = motions(&poses, |_| (posts(), Vec::new()));
    check(&found, 0.0, 0.2);
    for (pair, motion) in pitches.windows(2).zip(&found[1..]) {
        let motion = motion.unwrap();
        let off = motion.pitch_rad - (pair[1] - pair[0]);
        assert!(off.abs() < 5e-4_f64.min(3.0 * motion.pitch_sigma_rad), "{pair:?}: {motion:?}");
    }
}

#[test]
fn what_moves_does_not_disturb() {
    let poses = way(8.0, 0.0, 5);
    // As fast as the camera, and large: a third of the road.
    let leader = |number: usize| Board { x: [-1.3, 1.3], height_m: 2.0, z: 8.0 + 0.8 * number as f64, seed: 900 };
    let with = |number: usize| [posts(), vec![leader(number)]].concat();
    check(&motions(&poses, |number| (with(number), vec![board_box(&poses[number], &leader(number))])), 8.0, 0.0);
    // Nobody tells of it.
    check(&motions(&poses, |number| (with(number), Vec::new())), 8.0, 0.0);
}

#[test]
fn half_of_the_picture_may_be_wrong() {
    let poses = way(6.0, 0.05, 5);
    // Boards hide half of what there is, and slide aside and come nearer as nothing does that stands.
    let wrong = |number: usize| {
        let moved = number as f64;
        let board = |k: usize| {
            let from = -8.0 + 3.2 * k as f64 + 0.12 * moved * if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            let z = poses[number].z + 9.0 - 0.1 * moved;
            Board { x: [from, from + 1.6], height_m: 4.0, z, seed: 500 + 10 * k as u32 }
        };
        [posts(), (0..6).map(board).collect()].concat()
    };
    check(&motions(&poses, |number| (wrong(number), Vec::new())), 6.0, 0.05);
}

#[test]
fn a_blank_picture_tells_nothing_and_neither_does_a_cut() {
    let (camera, mut odometry) = (camera(), Odometry::above_road(HEIGHT_M, 0.02));
    let seen = |pose: &Pose| picture(pose, &posts());
    let poses = way(5.0, 0.0, 6);
    let blank = vec![128; SIZE[0] * SIZE[1] * 3];
    let pictures = [seen(&poses[0]), seen(&poses[1]), blank.clone(), blank, seen(&poses[4]), seen(&poses[5])];
    let mut look = |time_s: f64, rgb: &[u8], looks_cut: bool| {
        let frame = OdometryFrame { time_s, image_size: SIZE, rgb, camera: &camera, objects: &[], looks_cut };
        odometry.update(&frame).is_some()
    };
    let told: Vec<bool> = pictures.iter().zip(0..).map(|(rgb, k)| look(f64::from(k) * DT_S, rgb, false)).collect();
    assert_eq!(told, [false, true, false, false, false, true]);
    assert!(!look(0.6, &pictures[5], true), "a cut");
    assert!(!look(0.6, &pictures[5], false), "not later");
    assert!(!look(5.0, &pictures[5], false), "much later");
    assert!(!look(5.1, &pictures[5][..300], false), "no such picture");
}

#[test]
fn twice_the_height_is_twice_the_speed() {
    let camera = camera();
    let pictures: Vec<Vec<u8>> = way(4.0, 0.0, 3).iter().map(|pose| picture(pose, &posts())).collect();
    let speed = |height_m: f64| {
        let mut odometry = Odometry::above_road(height_m, 0.0);
        let look = |(rgb, k): (&Vec<u8>, u32)| {
            let time_s = f64::from(k) * DT_S;
            let frame =
                OdometryFrame { time_s, image_size: SIZE, rgb, camera: &camera, objects: &[], looks_cut: false };
            odometry.update(&frame)
        };
        pictures.iter().zip(0..).filter_map(look).last().unwrap().speed_mps
    };
    let share = speed(2.0 * HEIGHT_M) / speed(HEIGHT_M);
    assert!((share - 2.0).abs() < 0.05, "{share}");
}

/// What pictures of a way at a speed tell of the height, if `told` of that speed is said.
fn height_at(speed: f64, told: f64, pictures: usize) -> Option<[f64; 2]> {
    let (mut estimator, camera) = (HeightEstimator::default(), camera());
    for (number, pose) in way(speed, 0.0, pictures).iter().enumerate() {
        let rgb = picture(pose, &posts());
        let (time_s, image_size) = (number as f64 * DT_S, SIZE);
        let frame = OdometryFrame { time_s, image_size, rgb: &rgb, camera: &camera, objects: &[], looks_cut: false };
        estimator.add(&frame, Some(told));
    }
    estimator.height_m()
}

#[test]
fn a_known_speed_tells_the_height() {
    for share in [1.0, 2.5] {
        let [height_m, sigma_m] = height_at(9.0, 9.0 * share, 12).unwrap();
        let off = height_m - HEIGHT_M * share;
        assert!(off.abs() < 2.0 * sigma_m && sigma_m < 0.05 * height_m, "{share}: {height_m} ±{sigma_m}");
    }
}

#[test]
fn few_pictures_and_slow_ones_tell_no_height() {
    assert_eq!(height_at(9.0, 9.0, 10), None);
    assert_eq!(height_at(2.0, 2.0, 14), None);
}
