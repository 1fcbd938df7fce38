//! A recording of rerun, opened by rerun's own reader (Python package `rerun-sdk` of the same version).
#![cfg(feature = "rerun")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "the helpers of a test may panic and print")]

use std::process::Command;

use farsight_core::{Box2d, Box3d, Camera, Detection, Dimensions, ObjectClass};
use farsight_recordings::{RecordedFrame, RecordedObject, RerunRecording};
use image::{Rgb, RgbImage};
use serde_json::{Value, json};

const READER: &str = include_str!("support/rerun_reader.py");

#[test]
fn the_official_reader_finds_what_was_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.rrd");
    let image = RgbImage::from_pixel(320, 96, Rgb([200, 30, 30]));
    let camera = Camera::from_intrinsics(700.0, 650.0, 160.0, 48.0).unwrap();
    let car = Detection {
        class: ObjectClass::Car,
        score: 0.75,
        box2d: Box2d::new(100.0, 90.0, 220.0, 160.0),
        box3d: Box3d {
            dimensions: Dimensions { height: 1.5, width: 2.0, length: 4.0 },
            location: [-6.0, 1.75, 20.0],
            yaw: 0.0,
        },
        range_sigma_m: Some(2.0),
    };
    let found = RecordedObject::from_detections(&[car]);
    let mut recording = RerunRecording::create(&file).unwrap();
    recording.add(&RecordedFrame { time_s: 1.25, image: &image, camera: &camera, found: &found }).unwrap();
    recording.finish().unwrap();
    if !Command::new("python3").args(["-c", "import rerun.experimental"]).output().is_ok_and(|it| it.status.success()) {
        println!("skipped: no python3 with rerun-sdk");
        return;
    }
    let output = Command::new("python3").args(["-c", READER]).arg(&file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let rows: Vec<Value> =
        serde_json::Deserializer::from_slice(&output.stdout).into_iter().map(Result::unwrap).collect();
    let value = |entity: &str, name: &str| {
        let found = rows.iter().find(|row| row["entity"] == entity && !row[name].is_null());
        found.map_or(Value::Null, |row| row[name].clone())
    };
    // The middle of the box, and half its length, width and height.
    assert_eq!(value("/world/objects", "Boxes3D:centers"), json!([[-6.0, 1.0, 20.0]]));
    assert_eq!(value("/world/objects", "Boxes3D:half_sizes"), json!([[2.0, 1.0, 0.75]]));
    assert_eq!(value("/world/objects", "Boxes3D:labels"), json!(["Car 20.0 ±2.0 m"]));
    assert_eq!(value("/world/objects", "time"), json!(1.25));
    let columns = json!([[700.0, 0.0, 0.0, 0.0, 650.0, 0.0, 160.0, 48.0, 1.0]]);
    assert_eq!(value("/world/camera", "Pinhole:image_from_camera"), columns);
    assert_eq!(value("/world/camera", "Pinhole:resolution"), json!([[320.0, 96.0]]));
    assert_eq!(value("/world/camera/image", "EncodedImage:blob"), json!([[0xff, 0xd8]]));
}
