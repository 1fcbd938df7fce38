//! Images that a lens has distorted: the same metres as a pinhole's, boxes where the image shows the objects.

use std::fs;
use std::path::Path;

use crate::program::{done, farsight, root};
use farsight::json::{DetectionRecord, FrameRecord, ImageRecord};
use farsight::{Camera, Lens, RgbImage, RoadPlane, read_image};
use farsight_data::kitti::Calibration;
use image::Rgb;

const LENS: &str = "brown:-0.22,0.05,0.001,-0.0005,0";

/// The scene as a camera with this lens would have taken it: each pixel shows what the pinhole shows where its ray
/// goes.
fn distorted(pinhole: &RgbImage, camera: &Camera, lens: Lens) -> RgbImage {
    let (width, height) = pinhole.dimensions();
    RgbImage::from_fn(width, height, |column, row| {
        let shown = [f64::from(column), f64::from(row)];
        let mut pixel = shown;
        // Fixed-point iteration: another way than the one under test.
        for _ in 0..30 {
            let there = lens.distorted_pixel(camera, pixel);
            pixel = [0, 1].map(|axis| pixel[axis] + shown[axis] - there[axis]);
        }
        let inside =
            |value: f64, side: u32| (value >= 0.0 && value <= f64::from(side - 1)).then(|| value.round() as u32);
        match (inside(pixel[0], width), inside(pixel[1], height)) {
            (Some(x), Some(y)) => *pinhole.get_pixel(x, y),
            _ => Rgb([0; 3]),
        }
    })
}

fn records(path: &Path) -> Vec<ImageRecord> {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn a_lens_changes_the_picture_and_not_the_metres() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let scene = root().join("assets/scenes/image_2/000000.jpg");
    let pinhole = read_image(&scene).unwrap();
    let camera = Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap();
    let lens: Lens = LENS.parse().unwrap();
    distorted(&pinhole, &camera, lens).save(folder.join("bent.png")).unwrap();
    pinhole.save(folder.join("straight.png")).unwrap();
    let known = ["--fx", "721.5", "--cx", "609.6", "--cy", "172.9"];
    done(folder, &[&["range", "straight.png", "--json", "straight.json"], &known[..]].concat());
    let seen = ["range", "bent.png", "--lens", LENS, "--json", "bent.json", "--out", "drawn"];
    done(folder, &[&seen, &known[..]].concat());
    let (straight, bent) = (records(&folder.join("straight.json")), records(&folder.join("bent.json")));
    assert_eq!(bent[0].camera.as_ref().unwrap().lens.as_deref(), Some(LENS));
    assert_eq!(straight[0].camera.as_ref().unwrap().lens, None);
    let mut found = 0;
    for one in straight[0].detections.iter().filter(|one| one.range_m < 40.0 && one.score > 0.7) {
        let nearest = |other: &&farsight::json::DetectionRecord| {
            let apart = |axis: usize| other.location[axis] - one.location[axis];
            (apart(0).hypot(apart(2)) * 1e6) as u64
        };
        let Some(other) = bent[0].detections.iter().min_by_key(nearest) else { continue };
        if (other.range_m / one.range_m - 1.0).abs() < 0.1 {
            found += 1;
            // The box lies where the lens shows the middle of the other one.
            let middle = |b: [f64; 4]| [f64::midpoint(b[0], b[2]), f64::midpoint(b[1], b[3])];
            let (here, there) = (middle(other.box2d), lens.distorted_pixel(&camera, middle(one.box2d)));
            assert!((here[0] - there[0]).hypot(here[1] - there[1]) < 12.0, "{here:?}, {there:?}");
        }
    }
    assert!(found >= 2, "{straight:?}\n{bent:?}");
    assert!(folder.join("drawn/bent.png").is_file());
}

/// The object that stands where another one does.
fn nearest(found: &[DetectionRecord], location: [f64; 3]) -> &DetectionRecord {
    let apart = |one: &&DetectionRecord| {
        let [x, _, z] = one.location;
        ((x - location[0]).hypot(z - location[2]) * 1e6) as u64
    };
    found.iter().min_by_key(apart).unwrap()
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn a_film_is_followed_through_the_lens_and_over_the_road_of_its_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let pinhole = read_image(root().join("assets/scenes/image_2/000000.jpg")).unwrap();
    let camera = Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap();
    fs::create_dir(folder.join("frames")).unwrap();
    let bent = distorted(&pinhole, &camera, LENS.parse().unwrap());
    (0..4).for_each(|frame| bent.save(folder.join(format!("frames/{frame}.png"))).unwrap());
    // A road that is nearer than the one in the picture: what stands on it is nearer, too.
    let road = RoadPlane { slope: 0.0, tilt: 0.0, height_m: 1.25, sigmas: [0.002, 0.002, 0.01] };
    Calibration { road: Some(road), ..Calibration::from_camera(&camera) }.write(&folder.join("low.txt")).unwrap();
    Calibration::from_camera(&camera).write(&folder.join("plain.txt")).unwrap();
    let found = |calib: &str| {
        let view = ["--calib", calib, "--lens", LENS];
        let json = done(folder, &[&["range", "frames/0.png", "--json", "-"], &view[..]].concat());
        let seen: Vec<ImageRecord> = serde_json::from_str(&json).unwrap();
        let json = done(folder, &[&["track", "frames", "--fps", "10", "--json", "-"], &view[..]].concat());
        let last: FrameRecord = serde_json::from_str(json.lines().next_back().unwrap()).unwrap();
        (seen[0].detections.clone(), last)
    };
    let ((low, low_tracks), (plain, _)) = (found("low.txt"), found("plain.txt"));
    let near: Vec<_> = low.iter().filter(|one| one.range_m < 40.0 && one.score > 0.7).collect();
    assert!(near.len() >= 2, "{low:?}");
    for one in near {
        let [x, _, z] = one.location;
        let without = nearest(&plain, [x * 1.1, 0.0, z * 1.1]);
        assert!(one.range_m < 0.95 * without.range_m, "{one:?}, {without:?} without the road");
        let is_it = |track: &&farsight::json::TrackRecord| (track.range_m / one.range_m - 1.0).abs() < 0.03;
        let track = low_tracks.tracks.iter().find(is_it).unwrap_or_else(|| panic!("no track of {one:?}"));
        let off = track.box2d.iter().zip(one.box2d).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 2.0, "{track:?}, {one:?}");
    }
}

#[test]
fn lenses_that_cannot_be_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    RgbImage::new(640, 360).save(folder.join("a.png")).unwrap();
    let table = [
        ("brown:-0.9,0,0,0", "a.png: the lens brown:-0.9,0,0,0,0 folds the image at column"),
        ("fisheye:1,2", "is no lens; expected brown:k1,k2,p1,p2,k3 or kb4:k1,k2,k3,k4"),
    ];
    for (lens, told) in table {
        for command in [&["range"][..], &["track", "--fps", "10"], &["calibrate"]] {
            let output = farsight(folder, &[command, &["a.png", "--hfov", "80", "--lens", lens]].concat());
            let text = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.code() == Some(2) && text.contains(told), "{command:?}: {text}");
        }
    }
}
