//! A recording, opened by the official readers of MCAP, Foxglove and ROS 2 (Python), and by our own eyes' rules.
//!
//! Needs a `python3` with `mcap`, `mcap-protobuf-support` and `mcap-ros2-support`; says so where it is not there.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "the helpers of a test may panic and print")]

use std::io::Cursor;
use std::process::Command;

use farsight_core::{Box2d, Box3d, Camera, Detection, Dimensions, ObjectClass};
use farsight_recordings::{McapRecording, RecordedFrame, RecordedObject};
use image::{Rgb, RgbImage};
use serde_json::Value;

/// Prints every message as JSON.
const READER: &str = include_str!("support/mcap_reader.py");

/// KITTI's left colour camera, which stands 6 cm beside the frame of the boxes.
const PROJECTION: [[f64; 4]; 3] =
    [[721.5377, 0.0, 609.5593, 44.85728], [0.0, 721.5377, 172.854, 0.216_379_1], [0.0, 0.0, 1.0, 0.002_745_884]];

fn car() -> Detection {
    Detection {
        class: ObjectClass::Car,
        score: 0.75,
        box2d: Box2d::new(100.0, 90.0, 220.0, 160.0),
        box3d: Box3d {
            dimensions: Dimensions { height: 1.5, width: 1.6, length: 4.0 },
            location: [-6.0, 1.75, 20.0],
            yaw: 0.5,
        },
        range_sigma_m: Some(2.0),
    }
}

fn recording() -> Vec<u8> {
    let image = RgbImage::from_pixel(320, 96, Rgb([200, 30, 30]));
    let camera = Camera::from_projection(PROJECTION).unwrap();
    let found = RecordedObject::from_detections(&[car()]);
    let mut recording = McapRecording::new(Cursor::new(Vec::new())).unwrap();
    recording.add(&RecordedFrame { time_s: 0.0, image: &image, camera: &camera, found: &found }).unwrap();
    recording.add(&RecordedFrame { time_s: 1.25, image: &image, camera: &camera, found: &[] }).unwrap();
    let early = RecordedFrame { time_s: -0.1, image: &image, camera: &camera, found: &[] };
    assert!(recording.add(&early).unwrap_err().to_string().contains("time of -0.1 seconds"));
    recording.finish().unwrap().into_inner()
}

#[test]
fn the_same_frames_give_the_same_bytes() {
    assert!(recording() == recording());
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// `x`, `y`, `z` and perhaps `w` of a message; protobuf leaves out zeros.
fn parts<const N: usize>(value: &Value) -> [f64; N] {
    let names = ["x", "y", "z", "w"];
    std::array::from_fn(|i| value.get(names[i]).and_then(Value::as_f64).unwrap_or(0.0))
}

fn assert_close(found: &[f64], expected: &[f64]) {
    assert!(found.len() == expected.len(), "{found:?}");
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}, expected {expected:?}");
}

#[test]
fn official_readers_find_what_was_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.mcap");
    std::fs::write(&file, recording()).unwrap();
    let modules = "import mcap_protobuf.decoder, mcap_ros2.decoder";
    if !Command::new("python3").args(["-c", modules]).output().is_ok_and(|output| output.status.success()) {
        println!("skipped: no python3 with mcap-protobuf-support and mcap-ros2-support");
        return;
    }
    let output = Command::new("python3").args(["-c", READER]).arg(&file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let messages: Vec<Value> =
        serde_json::Deserializer::from_slice(&output.stdout).into_iter().map(Result::unwrap).collect();
    // Two transforms and four others at each time.
    assert_eq!(
        messages.iter().map(|m| m["time_ns"].as_u64().unwrap()).collect::<Vec<_>>(),
        [[0; 6], [1_250_000_000; 6]].concat()
    );
    let of = |topic: &str| messages.iter().filter(|m| m["topic"] == topic).map(|m| &m["message"]).collect::<Vec<_>>();

    let detections = of("/detections");
    assert_eq!(detections[1]["detections"], Value::Array(Vec::new()));
    assert_eq!(
        (&detections[1]["header"]["stamp"]["sec"], &detections[1]["header"]["stamp"]["nanosec"]),
        (&1.into(), &250_000_000.into())
    );
    let found = &detections[0]["detections"][0];
    assert_eq!((&found["id"], &found["header"]["frame_id"]), (&"0".into(), &"camera".into()));
    let result = &found["results"][0];
    assert_eq!((&result["hypothesis"]["class_id"], &result["hypothesis"]["score"]), (&"Car".into(), &0.75.into()));
    // The middle of the box is half a height above its bottom; y points down.
    for pose in [&result["pose"]["pose"], &found["bbox"]["center"]] {
        assert_close(&parts::<3>(&pose["position"]), &[-6.0, 1.0, 20.0]);
    }
    assert_close(&parts::<3>(&found["bbox"]["size"]), &[4.0, 1.6, 1.5]);
    // A quarter turn about x sets the box upright, then 0.5 rad about the axis that points down.
    let ((sin, cos), half) = (0.25_f64.sin_cos(), 0.5_f64.sqrt());
    assert_close(
        &parts::<4>(&found["bbox"]["center"]["orientation"]),
        &[half * cos, half * sin, -half * sin, half * cos],
    );
    let covariance = numbers(&result["pose"]["covariance"]);
    let mut expected = [0.0; 36];
    for (i, a) in [-0.3, 0.05, 1.0].into_iter().enumerate() {
        for (j, b) in [-0.3, 0.05, 1.0].into_iter().enumerate() {
            expected[6 * i + j] = 4.0 * a * b;
        }
    }
    assert_close(&covariance, &expected);

    let scene = of("/scene")[0];
    assert_eq!(scene["deletions"][0]["type"], "ALL");
    let entity = &scene["entities"][0];
    assert_eq!((&entity["frame_id"], &entity["texts"][0]["text"]), (&"camera".into(), &"Car 20.0 ±2.0 m".into()));
    assert_close(&parts::<3>(&entity["cubes"][0]["pose"]["position"]), &[-6.0, 1.0, 20.0]);
    assert_close(&parts::<3>(&entity["cubes"][0]["size"]), &[4.0, 1.6, 1.5]);

    let calibration = of("/camera/calibration")[0];
    assert_eq!((&calibration["frame_id"], &calibration["width"]), (&"camera_optical".into(), &320.into()));
    assert_close(&numbers(&calibration["K"]), &[721.5377, 0.0, 609.5593, 0.0, 721.5377, 172.854, 0.0, 0.0, 1.0]);
    let transforms = of("/tf");
    let origin = Camera::from_projection(PROJECTION).unwrap().origin().unwrap();
    assert_eq!(transforms[1]["parent_frame_id"], "camera");
    assert_close(&parts::<3>(&transforms[1]["translation"]), &origin);
    assert!((0.05..0.07).contains(&-origin[0]));

    let image = of("/camera/image")[0];
    assert_eq!((&image["format"], &image["data"]), (&"jpeg".into(), &"ffd8".into()));
}
