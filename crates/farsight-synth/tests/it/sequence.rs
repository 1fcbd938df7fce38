//! Laws of rendered sequences: the truth that comes with them fits itself, and the bytes follow from the seed.

use std::collections::BTreeMap;

use farsight_core::ObjectClass;
use farsight_synth::{CameraRanges, SceneConfig, SequenceFrame, SequenceStream, TrackTruth};

/// Small pictures, so that a test renders many.
fn stream(seed: u64, frames: usize, fps: f64) -> SequenceStream {
    let camera = CameraRanges { image_sizes: vec![[416, 128]], ..CameraRanges::kitti() };
    SequenceStream { config: SceneConfig { cameras: vec![camera], ..SceneConfig::default() }, seed, frames, fps }
}

fn by_id(frame: &SequenceFrame) -> BTreeMap<u32, &TrackTruth> {
    frame.tracks.iter().map(|track| (track.id, track)).collect()
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_does_not() {
    let [a, b, c] = [4, 4, 5].map(|seed| stream(seed, 3, 10.0).sequence(0).frame(2));
    assert_eq!(a, b);
    assert_ne!(a.image, c.image);
}

#[test]
fn places_change_as_velocities_say() {
    // So short a time apart that nobody's speed changes much.
    let fps = 120.0;
    let (mut checked, mut moving) = (0, 0);
    for index in 0..4 {
        let sequence = stream(7, 40, fps).sequence(index);
        let frames = [30, 31, 32].map(|number| sequence.frame(number));
        let [before, now, after] = [0, 1, 2].map(|place| by_id(&frames[place]));
        for (id, track) in &now {
            let (Some(before), Some(after)) = (before.get(id), after.get(id)) else { continue };
            let place = |track: &TrackTruth| track.label.box3d.location;
            let [old, new] = [place(before), place(after)];
            // Places nod with the camera; that is a few centimetres of height, and hardly any of the others.
            for axis in [0, 2] {
                let mps = (new[axis] - old[axis]) * fps / 2.0;
                let told = track.velocity_mps[axis];
                assert!((mps - told).abs() < 0.25 + 0.02 * told.abs(), "sequence {index}, {id}, {axis}: {mps}, {told}");
            }
            checked += 1;
            moving += usize::from(track.speed_mps > 0.5);
        }
        let turned = farsight_core::wrapped_angle(frames[2].ego.yaw_rad - frames[0].ego.yaw_rad) * fps / 2.0;
        assert!((turned - frames[1].ego.yaw_rate).abs() < 0.02, "{turned} {}", frames[1].ego.yaw_rate);
        let moved = [0, 1].map(|axis| frames[2].ego.position_m[axis] - frames[0].ego.position_m[axis]);
        let mps = moved[0].hypot(moved[1]) * fps / 2.0;
        assert!((mps - frames[1].ego.speed_mps).abs() < 0.05 + 0.01 * mps, "{mps} {}", frames[1].ego.speed_mps);
    }
    assert!(checked >= 12 && moving >= 3, "{checked} {moving}");
}

#[test]
fn what_is_parked_has_no_speed_and_who_moves_keeps_size_and_class() {
    let sequence = stream(11, 12, 10.0).sequence(1);
    let frames: Vec<SequenceFrame> = (0..sequence.len()).map(|number| sequence.frame(number)).collect();
    let mut first: BTreeMap<u32, TrackTruth> = BTreeMap::new();
    for track in frames.iter().flat_map(|frame| &frame.tracks) {
        let known = first.entry(track.id).or_insert_with(|| track.clone());
        assert_eq!(known.label.class, track.label.class);
        assert_eq!(known.label.box3d.dimensions, track.label.box3d.dimensions);
        assert!(track.speed_mps < 45.0 && track.label.class != ObjectClass::DontCare, "{track:?}");
        assert!(track.velocity_mps[1] == 0.0, "{track:?}");
    }
    assert!(first.len() >= 3, "{}", first.len());
    assert!(frames.iter().all(|frame| frame.camera == frames[0].camera));
}
