//! Images that a lens has distorted: the same metres as a pinhole's, boxes where the image shows the objects.
#![allow(clippy::unwrap_used, reason = "the helpers of a test may panic")]

#[allow(dead_code, reason = "each test program uses a part")]
mod program;

use std::fs;
use std::path::Path;

use farsight::json::ImageRecord;
use farsight::{Camera, Lens, RgbImage, read_image};
use image::Rgb;
use program::{done, farsight, root};

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

#[test]
fn lenses_that_cannot_be_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    RgbImage::new(640, 360).save(folder.join("a.png")).unwrap();
    let told = |lens: &str| {
        let output = farsight(folder, &["range", "a.png", "--hfov", "80", "--lens", lens]);
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (status, text) = told("brown:-0.9,0,0,0");
    assert!(
        status == Some(2) && text.contains("a.png: the lens brown:-0.9,0,0,0,0 folds the image at column"),
        "{text}"
    );
    let (status, text) = told("fisheye:1,2");
    assert!(
        status == Some(2) && text.contains("is no lens; expected brown:k1,k2,p1,p2,k3 or kb4:k1,k2,k3,k4"),
        "{text}"
    );
}
