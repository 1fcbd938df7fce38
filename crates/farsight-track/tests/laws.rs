//! What must hold of any street.
#![allow(clippy::unwrap_used, reason = "the helpers of a test may panic")]

mod street;

use farsight_core::{Box2d, Detection};
use farsight_track::{EgoMotion, Frame, Motion, Noise, Track, TrackError, Tracker, TrackerOptions};
use proptest::prelude::*;

use street::{Car, Chance, IMAGE_SIZE, Lasting, camera};

fn update(tracker: &mut Tracker, time_s: f64, detections: &[Detection]) -> Result<Vec<Track>, TrackError> {
    tracker.update(&Frame {
        time_s,
        image_size: IMAGE_SIZE,
        camera: &camera(),
        detections,
        ego: None,
        looks_cut: false,
    })
}

/// A car without error in the detector.
fn exact(car: &Car) -> Detection {
    car.seen(1.0, 0.05, 1.0)
}

/// Shares of cases in which 90% intervals hold what is true.
#[derive(Debug, Default)]
struct Coverage {
    cases: [f64; 3],
    held: [f64; 3],
}

impl Coverage {
    fn count(&mut self, what: usize, holds: bool) {
        self.cases[what] += 1.0;
        self.held[what] += f64::from(u8::from(holds));
    }

    /// Of distance, closing speed, time to collision.
    fn shares(&self) -> [f64; 3] {
        [0, 1, 2].map(|what| self.held[what] / self.cases[what])
    }
}

/// Both ways to move are the same.
fn one_way(acceleration_psd: f64) -> [Motion; 2] {
    [Motion { acceleration_psd, lasts_s: 1.0 }; 2]
}

/// Follows cars one after the other, each for 2 seconds at 10 frames a second, and looks at the last frame.
fn coverage(options: &TrackerOptions, sigma: f64, runs: u64) -> Coverage {
    let noise = &options.noise;
    let mut coverage = Coverage::default();
    let dt: f64 = 0.1;
    for seed in 0..runs {
        let chance = &mut Chance::new(seed);
        let place = [chance.between(-3.0, 3.0), chance.between(15.0, 50.0)];
        let mut car = Car::new(place, [0.3 * chance.normal(), chance.between(-6.0, 0.0)]);
        let share = noise.persistent_share;
        let white = ((1.0 - share).sqrt() * sigma).max(noise.least_white);
        let mut factor = Lasting::new(share.sqrt() * sigma, noise.persistent_s, chance);
        let mut lasting = Lasting::new(1.0, noise.height_s, chance);
        let mut tracker = Tracker::new(options.clone());
        let [even, pushed] = options.motion.map(|mode| mode.lasts_s);
        let mut mode = usize::from(chance.between(0.0, even + pushed) > even);
        let (mut told, mut size) = (Vec::new(), 0.0);
        for frame in 0..=20 {
            size += noise.size_drift * dt.sqrt() * chance.normal();
            let height_px = exact(&car).box2d.height();
            let of = |share: f64, px: f64| share.hypot(px / height_px);
            let log_growth = size
                + of(noise.height_share, noise.height_px) * lasting.after(dt, chance)
                + of(noise.white_height_share, noise.white_height_px) * chance.normal();
            let log_factor = factor.after(dt, chance) + white * chance.normal();
            let detection = car.seen(log_factor.exp(), sigma, log_growth.exp());
            told = update(&mut tracker, f64::from(frame) * dt, &[detection]).unwrap();
            if frame < 20 {
                let pushed = (options.motion[mode].acceleration_psd * dt).sqrt();
                if chance.between(0.0, 1.0) > (-dt / options.motion[mode].lasts_s).exp() {
                    mode = 1 - mode;
                }
                let velocity = car.velocity;
                car.velocity = velocity.map(|v| v + pushed * chance.normal());
                // The velocity of the step lies between.
                car.place = [0, 1].map(|axis| car.place[axis] + dt * f64::midpoint(velocity[axis], car.velocity[axis]));
            }
        }
        let [track] = &told[..] else { panic!("{} tracks of one car, seed {seed}", told.len()) };
        let [low, high] = track.range_interval_m();
        coverage.count(0, (low..=high).contains(&car.place[1]));
        let Some(closing) = track.closing else { continue };
        let off = closing.mps + car.velocity[1];
        coverage.count(1, off.abs() <= 1.645 * closing.sigma_mps);
        if car.velocity[1] < 0.0 {
            let ttc_s = -car.near_m() / car.velocity[1];
            let holds =
                closing.ttc_interval_s.is_some_and(|(low, high)| low <= ttc_s && high.is_none_or(|h| ttc_s <= h));
            coverage.count(2, holds);
        }
    }
    coverage
}

/// Nine of ten, give or take what 600 cases and a linear filter leave open.
fn assert_covered(coverage: &Coverage) {
    for (what, share) in ["distance", "closing speed", "time to collision"].into_iter().zip(coverage.shares()) {
        assert!((0.85..=0.95).contains(&share), "{share} of the {what}: {coverage:?}");
    }
    assert!(coverage.cases.iter().all(|cases| *cases > 500.0), "{coverage:?}");
}

/// Errors that are new in each image.
fn white() -> Noise {
    Noise { persistent_share: 0.0, height_share: 0.0, height_px: 0.0, ..Noise::default() }
}

#[test]
fn intervals_hold_nine_of_ten_at_constant_velocity() {
    for noise in [white(), Noise::default()] {
        // A car that never accelerates, and a tracker that knows.
        let options = TrackerOptions { motion: one_way(1e-6), noise, ..TrackerOptions::default() };
        assert_covered(&coverage(&options, 0.06, 600));
    }
}

#[test]
fn intervals_hold_nine_of_ten_of_cars_that_accelerate() {
    for noise in [white(), Noise::default()] {
        // Not so much that cars of this street leave the image.
        let options = TrackerOptions { motion: one_way(0.5), noise, ..TrackerOptions::default() };
        assert_covered(&coverage(&options, 0.06, 600));
    }
}

#[test]
fn intervals_hold_nine_of_ten_of_cars_that_move_now_this_way_now_that() {
    let motion = [Motion { acceleration_psd: 0.02, lasts_s: 2.0 }, Motion { acceleration_psd: 1.0, lasts_s: 1.0 }];
    for noise in [white(), Noise::default()] {
        assert_covered(&coverage(&TrackerOptions { motion, noise, ..TrackerOptions::default() }, 0.06, 600));
    }
}

#[test]
fn errors_that_last_taken_for_new_ones_make_intervals_too_narrow() {
    // The street errs as it does; the tracker is told that errors are new in each image. The law above can fail.
    let street = TrackerOptions { motion: one_way(1e-6), ..TrackerOptions::default() };
    let fooled = TrackerOptions { noise: white(), ..street.clone() };
    let mut held = 0.0;
    for seed in 0..200 {
        let chance = &mut Chance::new(seed);
        let mut car = Car::new([0.0, chance.between(15.0, 50.0)], [0.0, -3.0]);
        let mut factor = Lasting::new(0.055, street.noise.persistent_s, chance);
        let mut tracker = Tracker::new(fooled.clone());
        let mut told = Vec::new();
        for frame in 0..=20 {
            let log_factor = factor.after(0.1, chance) + 0.02 * chance.normal();
            told = update(&mut tracker, 0.1 * f64::from(frame), &[car.seen(log_factor.exp(), 0.06, 1.0)]).unwrap();
            if frame < 20 {
                car = car.after(0.1);
            }
        }
        let [low, high] = told[0].range_interval_m();
        held += f64::from(u8::from((low..=high).contains(&car.place[1]))) / 200.0;
    }
    assert!(held < 0.7, "{held}");
}

#[test]
fn without_errors_of_the_detector_speed_and_time_to_collision_are_right() {
    let mut car = Car::new([1.5, 30.0], [0.0, -5.0]);
    let mut tracker = Tracker::default();
    for frame in 0..30 {
        let told = update(&mut tracker, 0.1 * f64::from(frame), &[exact(&car)]).unwrap();
        match frame {
            // Three detections in two tenths of a second are no speed.
            0..=2 => assert!(told[0].velocity.is_none() && told[0].closing.is_none(), "{told:?}"),
            20.. => {
                let (velocity, closing) = (told[0].velocity.unwrap(), told[0].closing.unwrap());
                assert!((velocity.mps[0]).abs() < 0.1 && (velocity.mps[2] + 5.0).abs() < 0.3, "{velocity:?}");
                let ttc_s = car.near_m() / 5.0;
                assert!((closing.ttc_s.unwrap() / ttc_s - 1.0).abs() < 0.05, "{closing:?}, not {ttc_s}");
                assert!((told[0].range_m() - car.place[1]).abs() < 0.1, "{told:?}");
            }
            _ => {}
        }
        car = car.after(0.1);
    }
}

#[test]
fn a_distance_gets_sharper_with_time_and_no_sharper_than_what_lasts() {
    let car = Car::new([1.5, 30.0], [0.0, 0.0]);
    let mut tracker = Tracker::default();
    let mut sigmas = Vec::new();
    for frame in 0..30 {
        sigmas.extend(
            update(&mut tracker, 0.1 * f64::from(frame), &[exact(&car)]).unwrap().first().map(|t| t.range_sigma_m),
        );
    }
    assert!(sigmas.windows(2).all(|pair| pair[1] < pair[0] + 1e-9), "{sigmas:?}");
    let last = sigmas.last().unwrap() / 30.0;
    assert!(last < 0.05 && last > 0.03, "{last} of an error of 0.05");
}

#[test]
fn who_passes_in_front_of_another_keeps_its_identity() {
    // One crosses before the other, which is not seen for as long as it is covered.
    let (mut near, mut far) = (Car::new([-2.2, 14.0], [1.5, 0.0]), Car::new([1.6, 24.0], [-1.0, 0.0]));
    let mut tracker = Tracker::default();
    let mut identities = Vec::new();
    let mut coasted = 0;
    for frame in 0..40 {
        let (n, f) = (exact(&near), exact(&far));
        let is_covered = f.box2d.x1 > n.box2d.x1 - 5.0 && f.box2d.x2 < n.box2d.x2 + 5.0;
        let seen = if is_covered { vec![n] } else { vec![f, n] };
        let told = update(&mut tracker, 0.1 * f64::from(frame), &seen).unwrap();
        if frame > 0 {
            let at = |z: f64| told.iter().find(|track| (track.range_m() - z).abs() < 3.0).unwrap();
            identities.push([at(14.0).id, at(24.0).id]);
            coasted += u32::from(at(24.0).coasting);
            let place = at(24.0).box3d.location[0];
            assert!((place - far.place[0]).abs() < 0.5, "at {place}, not {}", far.place[0]);
        }
        (near, far) = (near.after(0.1), far.after(0.1));
    }
    assert!(coasted >= 2, "{coasted}");
    assert!(identities.iter().all(|pair| *pair == identities[0]), "{identities:?}");
}

#[test]
fn what_stands_still_tells_its_distance_to_a_camera_that_knows_its_speed() {
    let ego = EgoMotion { speed_mps: 10.0, speed_sigma_mps: 0.1, yaw_rate: 0.0, yaw_rate_sigma: 0.002 };
    // Every distance is a tenth too long, as those of a country with smaller cars are.
    let follow = |speed_mps: f64, seconds: f64, is_known: bool| {
        let mut car = Car::new([3.0, 42.0], [0.0, speed_mps - 10.0]);
        let mut tracker = Tracker::default();
        let mut told = Vec::new();
        let frames = (10.0 * seconds) as u32;
        for frame in 0..=frames {
            let frame = Frame {
                time_s: 0.1 * f64::from(frame),
                image_size: IMAGE_SIZE,
                camera: &camera(),
                detections: &[car.seen(1.1, 0.08, 1.0)],
                ego: is_known.then_some(ego),
                looks_cut: false,
            };
            told = tracker.update(&frame).unwrap();
            if frame.time_s < seconds - 0.05 {
                car = car.after(0.1);
            }
        }
        let track = &told[0];
        let true_m = car.place[1];
        let [speed, _] = track.speed_mps(&ego).unwrap();
        let [low, high] = track.range_interval_m();
        assert!((low..=high).contains(&true_m), "{track:?}");
        (track.range_m() / true_m - 1.0, speed)
    };
    let (unknown, _) = follow(0.0, 3.0, false);
    assert!(unknown > 0.07, "{unknown}");
    let (known, speed) = follow(0.0, 3.0, true);
    assert!(known.abs() < 0.6 * unknown && speed < 0.4, "{known} too long, at {speed} m/s");
    // What moves is not taken to stand: who drives ahead, slowly or as we do, and who comes towards us.
    for speed_mps in [5.0, 10.0, -8.0] {
        let (off, speed) = follow(speed_mps, 1.8, true);
        // A tenth of the closing speed is the detector's error.
        let allowed = 0.11 * (speed_mps - 10.0).abs() + 0.4;
        assert!(off > 0.06 && (speed - speed_mps.abs()).abs() < allowed, "{off}, {speed} at {speed_mps} m/s");
    }
}

/// Error of the closing speed after 0.8 seconds, m/s, and its standard deviation, of a car that does this speed over
/// the ground before a camera that drives, seen with the errors that a tracker expects.
fn closing_error(seed: u64, speed_mps: f64, camera_mps: f64, is_known: bool) -> [f64; 2] {
    let ego = EgoMotion { speed_mps: camera_mps, speed_sigma_mps: 0.1, yaw_rate: 0.0, yaw_rate_sigma: 0.002 };
    let (chance, options, sigma) = (&mut Chance::new(seed), TrackerOptions::default(), 0.08);
    let noise = options.noise.clone();
    let mut car = Car::new([chance.between(-4.0, 4.0), chance.between(45.0, 70.0)], [0.0, speed_mps - camera_mps]);
    let mut factor = Lasting::new(noise.persistent_share.sqrt() * sigma, noise.persistent_s, chance);
    let mut lasting = Lasting::new(noise.height_share, noise.height_s, chance);
    let mut tracker = Tracker::new(options);
    let mut told = Vec::new();
    for frame in 0..=8 {
        let log_factor = factor.after(0.1, chance) + (1.0 - noise.persistent_share).sqrt() * sigma * chance.normal();
        let log_growth = lasting.after(0.1, chance) + noise.white_height_share * chance.normal();
        let frame = Frame {
            time_s: 0.1 * f64::from(frame),
            image_size: IMAGE_SIZE,
            camera: &camera(),
            detections: &[car.seen(log_factor.exp(), sigma, log_growth.exp())],
            ego: is_known.then_some(ego),
            looks_cut: false,
        };
        told = tracker.update(&frame).unwrap();
        car = car.after(0.1);
    }
    let closing = told[0].closing.unwrap();
    [closing.mps + car.velocity[1], closing.sigma_mps]
}

#[test]
fn a_camera_that_knows_its_speed_is_no_surer_than_it_is_right() {
    // Of standing and of moving cars: sum of errors with and without that knowledge, and how often 90% intervals hold.
    let (mut errors, mut held, runs) = ([[0.0; 2]; 2], 0.0, 300);
    for seed in 0..runs {
        let chance = &mut Chance::new(1000 + seed);
        let moves = seed % 2 == 0;
        let speed_mps = if moves { 8.0 * chance.normal() } else { 0.0 };
        let camera_mps = chance.between(3.0, 20.0);
        let [known, sigma] = closing_error(seed, speed_mps, camera_mps, true);
        let [unknown, _] = closing_error(seed, speed_mps, camera_mps, false);
        let sums = &mut errors[usize::from(moves)];
        *sums = [sums[0] + known.abs(), sums[1] + unknown.abs()];
        held += f64::from(u8::from(known.abs() <= 1.645 * sigma));
    }
    let share = held / runs as f64;
    assert!((0.85..=0.97).contains(&share), "{share}");
    let [standing, moving] = errors;
    assert!(standing[0] < 0.3 * standing[1], "{standing:?}");
    // Slow ones are taken for standing in part.
    assert!(standing[0] + moving[0] < 0.8 * (standing[1] + moving[1]), "{standing:?}, {moving:?}");
}

#[test]
fn a_camera_that_nods_loses_nobody() {
    let places = [[-4.0, 14.0], [-2.5, 20.0], [1.5, 26.0], [3.0, 48.0], [-1.0, 62.0]];
    let cars = places.map(|place| Car::new(place, [0.0, 0.0]));
    let mut tracker = Tracker::default();
    for frame in 0..30 {
        // Up and down by most of the height of those that are far away.
        let nod_px = [0.0, 18.0, -14.0, 22.0][frame % 4];
        let seen: Vec<Detection> = cars
            .iter()
            .map(|car| {
                let seen = exact(car);
                let Box2d { x1, y1, x2, y2 } = seen.box2d;
                Detection { box2d: Box2d::new(x1, y1 + nod_px, x2, y2 + nod_px), ..seen }
            })
            .collect();
        let told = update(&mut tracker, 0.1 * frame as f64, &seen).unwrap();
        let ids: Vec<u64> = told.iter().map(|track| track.id).collect();
        assert_eq!(ids, [1, 2, 3, 4, 5], "frame {frame}");
        assert!(told.iter().all(|track| !track.coasting), "frame {frame}: {told:?}");
    }
}

#[test]
fn who_is_gone_for_long_is_known_again_or_another() {
    for (gap, is_same) in [(0.6, true), (1.6, true), (4.0, false)] {
        let mut tracker = Tracker::default();
        let car = Car::new([1.0, 20.0], [0.0, 0.5]);
        let mut before = Vec::new();
        for frame in 0..25 {
            let time_s = 0.1 * f64::from(frame);
            before = update(&mut tracker, time_s, &[exact(&car.after(time_s))]).unwrap();
        }
        let back = 2.4 + gap;
        let told = (1..).map(|step| 2.4 + 0.1 * f64::from(step)).take_while(|time_s| *time_s < back - 1e-6);
        let coasting: Vec<usize> = told.map(|time_s| update(&mut tracker, time_s, &[]).unwrap().len()).collect();
        // It is told for a while, and then no more.
        let steps = (tracker.options().max_coast_s / 0.1).round() as usize;
        let expected = coasting.iter().enumerate().map(|(step, _)| usize::from(step < steps)).collect::<Vec<_>>();
        assert_eq!(coasting, expected);
        let mut after = Vec::new();
        for step in 0..3 {
            let time_s = back + 0.1 * f64::from(step);
            after = update(&mut tracker, time_s, &[exact(&car.after(time_s))]).unwrap();
        }
        assert_eq!(after[0].id == before[0].id, is_same, "after {gap} s");
        assert_eq!(after.len(), 1);
    }
}

#[test]
fn what_was_hardly_seen_hardly_coasts() {
    // Seen in so many frames, it is told for so many frames more.
    for (seen, expected) in [(2, 0), (5, 1), (9, 2), (13, 3), (40, 5)] {
        let mut tracker = Tracker::default();
        let car = Car::new([1.0, 20.0], [0.0, 0.5]);
        let mut told = 0;
        for frame in 0..seen + 10 {
            let time_s = 0.1 * f64::from(frame);
            let detections = if frame < seen { vec![exact(&car.after(time_s))] } else { Vec::new() };
            let tracks = update(&mut tracker, time_s, &detections).unwrap();
            told += tracks.iter().filter(|track| track.coasting).count();
        }
        assert_eq!(told, expected, "after {seen} frames");
    }
}

#[test]
fn low_scores_continue_tracks_and_begin_none() {
    let mut tracker = Tracker::default();
    let car = Car::new([1.0, 20.0], [0.0, 0.0]);
    let unsure = |car: &Car| Detection { score: 0.2, ..exact(car) };
    for frame in 0..20 {
        let seen = if frame < 5 { exact(&car) } else { unsure(&car) };
        let other = unsure(&Car::new([-5.0, 20.0], [0.0, 0.0]));
        let told = update(&mut tracker, 0.1 * f64::from(frame), &[seen, other]).unwrap();
        assert_eq!(told.len(), 1, "in frame {frame}");
        assert!(told.iter().all(|track| !track.coasting));
    }
    // Nor do they make one of what was seen once.
    let mut tracker = Tracker::default();
    update(&mut tracker, 0.0, &[]).unwrap();
    for frame in 1..10 {
        let seen = if frame == 1 { exact(&car) } else { unsure(&car) };
        assert!(update(&mut tracker, 0.1 * f64::from(frame), &[seen]).unwrap().is_empty(), "in frame {frame}");
    }
}

#[test]
fn all_is_told_in_the_first_frame_and_later_what_is_seen_twice() {
    let [first, later] = [[1.0, 20.0], [-4.0, 25.0]].map(|place| exact(&Car::new(place, [0.0, 0.0])));
    let mut tracker = Tracker::default();
    let mut ids = |frame: u32, seen: &[Detection]| -> Vec<u64> {
        let told = update(&mut tracker, 0.1 * f64::from(frame), seen).unwrap();
        // A place is no motion.
        assert!(frame > 1 || told.iter().all(|track| track.velocity.is_none() && track.closing.is_none()));
        told.iter().map(|track| track.id).collect()
    };
    assert_eq!(ids(0, std::slice::from_ref(&first)), [1]);
    assert_eq!(ids(1, &[first.clone(), later.clone()]), [1]);
    assert_eq!(ids(2, &[first, later]), [1, 2]);
}

#[test]
fn another_scene_has_other_tracks() {
    for (looks_cut, moved, expected) in [(true, 4.0, [4, 5, 6]), (false, 4.0, [1, 2, 3]), (true, 0.0, [1, 2, 3])] {
        let mut tracker = Tracker::default();
        let places = [[-4.0, 15.0], [0.0, 30.0], [4.0, 22.0]];
        let seen: Vec<Detection> = places.iter().map(|&place| exact(&Car::new(place, [0.0; 2]))).collect();
        for frame in 0..5 {
            update(&mut tracker, 0.1 * f64::from(frame), &seen).unwrap();
        }
        let seen: Vec<Detection> =
            places.iter().map(|&[x, z]| exact(&Car::new([x + moved * z / 15.0, z], [0.0; 2]))).collect();
        let frame =
            Frame { time_s: 0.5, image_size: IMAGE_SIZE, camera: &camera(), detections: &seen, ego: None, looks_cut };
        let told = tracker.update(&frame).unwrap();
        let ids: Vec<u64> = told.iter().map(|track| track.id).collect();
        assert_eq!(ids, expected, "cut {looks_cut}, moved {moved}: {told:?}");
    }
}

#[test]
fn an_image_of_another_size_ends_all_tracks() {
    let mut tracker = Tracker::default();
    let seen = [exact(&Car::new([0.0, 15.0], [0.0; 2]))];
    for frame in 0..5 {
        update(&mut tracker, 0.1 * f64::from(frame), &seen).unwrap();
    }
    let other = Frame {
        time_s: 0.5,
        image_size: [1920, 1080],
        camera: &camera(),
        detections: &seen,
        ego: None,
        looks_cut: false,
    };
    let told = tracker.update(&other).unwrap();
    assert_eq!(told.iter().map(|track| track.id).collect::<Vec<_>>(), [2]);
}

#[test]
fn what_cannot_be_taken_is_told_and_changes_nothing() {
    let car = Car::new([1.0, 20.0], [0.0, -1.0]);
    let mut tracker = Tracker::default();
    let mut other = Tracker::default();
    for frame in 0..5 {
        let time_s = 0.1 * f64::from(frame);
        update(&mut tracker, time_s, &[exact(&car.after(time_s))]).unwrap();
        update(&mut other, time_s, &[exact(&car.after(time_s))]).unwrap();
    }
    let mut nowhere = exact(&car);
    nowhere.box3d.location[2] = f64::NAN;
    let mut empty = exact(&car);
    empty.box2d.x2 = empty.box2d.x1;
    let table = [
        (0.4, vec![], "a frame at 0.4 s after one at 0.4 s; expected a later time"),
        (0.3, vec![], "a frame at 0.3 s after one at 0.4 s; expected a later time"),
        (f64::NAN, vec![], "a frame at NaN s; expected a finite number of seconds"),
        (0.5, vec![exact(&car), nowhere], "detection 1 has a depth of NaN; expected a positive number"),
        (0.5, vec![empty], "detection 0 has a width in the image of 0; expected a positive number"),
    ];
    for (time_s, seen, expected) in table {
        assert_eq!(update(&mut tracker, time_s, &seen).unwrap_err().to_string(), expected);
    }
    let seen = [exact(&car.after(0.5))];
    assert_eq!(update(&mut tracker, 0.5, &seen), update(&mut other, 0.5, &seen));
}

/// What is told of a random street: some cars are missed now and then.
fn told(seed: u64, start_s: f64, order: impl Fn(&mut Vec<Detection>, usize)) -> Vec<Vec<Track>> {
    let chance = &mut Chance::new(seed);
    let mut cars: Vec<Car> = (0..8)
        .map(|_| {
            let place = [chance.between(-12.0, 12.0), chance.between(8.0, 60.0)];
            Car::new(place, [chance.normal(), chance.between(-8.0, 3.0)])
        })
        .collect();
    let mut tracker = Tracker::default();
    let mut all = Vec::new();
    for frame in 0..25 {
        let mut seen = Vec::new();
        for car in &cars {
            let [factor, growth, score] = [0.03 * chance.normal(), 0.01 * chance.normal(), chance.between(0.2, 1.0)];
            if car.place[1] > 6.0 && chance.between(0.0, 1.0) > 0.1 {
                seen.push(Detection { score, ..car.seen(factor.exp(), 0.04, growth.exp()) });
            }
        }
        order(&mut seen, frame);
        // Sixteenths and small whole numbers are exact, so a shift changes no difference.
        all.push(update(&mut tracker, start_s + frame as f64 / 16.0, &seen).unwrap());
        cars = cars.iter().map(|car| car.after(1.0 / 16.0)).collect();
    }
    all
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_order_of_the_detections_does_not_matter(seed in 0_u64..10_000, turn in 1_usize..8) {
        let expected = told(seed, 0.0, |_, _| ());
        let turned = told(seed, 0.0, |seen, frame| {
            seen.reverse();
            let by = (turn + frame) % seen.len().max(1);
            seen.rotate_left(by);
        });
        prop_assert!(expected.iter().any(|tracks| tracks.len() > 3));
        prop_assert_eq!(expected, turned);
    }

    #[test]
    fn when_it_was_does_not_matter(seed in 0_u64..10_000, hours in -4_i32..4) {
        prop_assert_eq!(told(seed, 0.0, |_, _| ()), told(seed, f64::from(hours) * 3600.0, |_, _| ()));
    }

    #[test]
    fn a_mirrored_street_has_mirrored_tracks(seed in 0_u64..10_000) {
        let middle = camera().principal_point()[0];
        let found = told(seed, 0.0, |_, _| ());
        let mirrored = told(seed, 0.0, |seen, _| {
            for detection in seen {
                let flipped = detection.box2d;
                (detection.box2d.x1, detection.box2d.x2) = (2.0 * middle - flipped.x2, 2.0 * middle - flipped.x1);
                detection.box3d = detection.box3d.mirrored();
            }
        });
        for (tracks, others) in found.iter().zip(&mirrored) {
            prop_assert_eq!(tracks.len(), others.len());
            for (track, other) in tracks.iter().zip(others) {
                prop_assert!((track.box3d.location[0] + other.box3d.location[0]).abs() < 1e-6);
                prop_assert!((track.range_m() - other.range_m()).abs() < 1e-6);
            }
        }
    }
}
