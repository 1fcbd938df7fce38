//! `farsight calibrate`: rendered traffic under a camera on a mast, whose pitch and height are known exactly.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::program::{done, farsight, one_camera};
use crate::rtsp;
use farsight::RgbImage;
use farsight_data::kitti::Calibration;
use serde_json::Value;

/// The world of the mast: 5.2 m up, 12 degrees down.
fn mast() -> String {
    one_camera([0.9, 1.2], 0.9, 5.2, 12.0)
}

/// Value and error bar of the line that starts with `name`.
fn told(text: &str, name: &str) -> [f64; 2] {
    let line = text.lines().find(|line| line.starts_with(name)).unwrap();
    let words: Vec<&str> = line.split_whitespace().collect();
    [words[1].parse().unwrap(), words[2].trim_start_matches('±').parse().unwrap()]
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn a_camera_on_a_mast_is_found_and_its_file_gives_distances() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("world.toml"), mast()).unwrap();
    done(folder, &["synth", "--scene-config", "world.toml", "--out", "data", "--frames", "10", "--seed", "77"]);
    let images = "data/training/image_2";
    let text = done(folder, &["calibrate", images, "--fx", "864", "--out", "mast.txt"]);
    for (name, truth) in [("pitch", 12.0), ("roll", 0.0), ("height", 5.2)] {
        let [value, sigma] = told(&text, name);
        assert!((value - truth).abs() < 3.0 * sigma.max(0.1) && sigma < 0.1 * truth.max(10.0), "{truth}: {text}");
    }
    let file = Calibration::read(&folder.join("mast.txt")).unwrap();
    assert!((file.road.unwrap().height_m - told(&text, "height")[0]).abs() < 0.006);

    // Without the calibration each image tells its pitch; distances are along the camera's axis then.
    let judged = |results: &str, camera: &[&str]| {
        done(folder, &[&["range", images, "--kitti", results], camera].concat());
        let out = format!("{results}.json");
        let labels = ["eval", "--labels", "data/training/label_2", "--results", results, "--json", &out];
        done(folder, &labels);
        let report: Value = serde_json::from_str(&fs::read_to_string(folder.join(&out)).unwrap()).unwrap();
        let cars = &report["ranging"]["car"]["all"];
        (cars["found"].as_u64().unwrap(), cars["abs_rel_z"].as_f64().unwrap())
    };
    let (known, unknown) = (judged("known", &["--calib", "mast.txt"]), judged("unknown", &["--fx", "864"]));
    println!("cars found and their relative error: {known:?} with the calibration, {unknown:?} without");
    for (found, error) in [known, unknown] {
        assert!(found >= 75 && error < 0.08, "{known:?}, {unknown:?} without");
    }
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn frames_of_a_film_tell_what_images_do() {
    if !rtsp::has_ffmpeg() {
        return eprintln!("skipped: there is no ffmpeg, so no film was looked at");
    }
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("world.toml"), mast()).unwrap();
    done(folder, &["synth", "--scene-config", "world.toml", "--out", "data", "--frames", "4", "--seed", "78"]);
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-loglevel", "error", "-framerate", "2", "-i", "data/training/image_2/%06d.png"]);
    assert!(ffmpeg.args(["-crf", "1", "film.mp4"]).current_dir(folder).status().unwrap().success());
    let of_images = done(folder, &["calibrate", "data/training/image_2", "--fx", "864"]);
    let of_film = done(folder, &["calibrate", "film.mp4", "--fx", "864"]);
    for name in ["pitch", "height"] {
        let ([image, sigma], [film, _]) = (told(&of_images, name), told(&of_film, name));
        assert!((image - film).abs() < sigma, "{of_images} {of_film}");
    }
    let fewer = done(folder, &["calibrate", "film.mp4", "--fx", "864", "--frames", "2"]);
    assert_ne!(fewer, of_film);
    let beside = farsight(folder, &["calibrate", "film.mp4", "data", "--fx", "864"]);
    let text = String::from_utf8_lossy(&beside.stderr).into_owned();
    assert!(text.contains("film.mp4: a video beside other inputs; expected it alone"), "{text}");
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn the_speed_of_a_camera_tells_its_height() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("world.toml"), one_camera([0.9, 1.2], 0.9, 2.2, 0.0)).unwrap();
    let sequence = ["--sequence", "1", "--frames", "20", "--fps", "10", "--seed", "5"];
    done(folder, &[&["synth", "--scene-config", "world.toml", "--out", "data"], &sequence[..]].concat());
    let film = ["calibrate", "data/training/image_02/0000", "--fps", "10", "--fx", "864"];
    let by_speed = done(folder, &[&film[..], &["--ego", "data/training/oxts/0000.txt"]].concat());
    let ([height, sigma], [_, sigma_by_traffic]) = (told(&by_speed, "height"), told(&done(folder, &film), "height"));
    assert!((height - 2.2).abs() < 2.0 * sigma && sigma < sigma_by_traffic, "{by_speed}");
}

#[test]
fn a_speed_needs_a_film_that_drives() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    RgbImage::new(64, 36).save(folder.join("a.png")).unwrap();
    fs::write(folder.join("speeds.csv"), "time_s,speed_mps,yaw_rate\n0,9,0\n").unwrap();
    let refused = |rest: &[&str]| {
        let output = farsight(folder, &[&["calibrate", "a.png", "--hfov", "70", "--ego", "speeds.csv"], rest].concat());
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(refused(&[]).contains("--ego is for films; expected a video, or --fps N"), "{}", refused(&[]));
    let text = refused(&["--fps", "10"]);
    assert!(text.contains("0 of 1 frame tell the height; expected ten that show the road"), "{text}");
    assert!(refused(&["--fps", "10", "--above-road", "1.5"]).contains("cannot be used with"));
}

#[test]
fn no_traffic_is_not_enough_to_tell() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (name, side) in [("a.png", 640), ("b.png", 640), ("c.png", 320)] {
        RgbImage::new(side, 360).save(folder.join(name)).unwrap();
    }
    let refused = |images: &[&str], rest: &[&str]| {
        let output = farsight(folder, &[&["calibrate"], images, &["--hfov", "70"], rest].concat());
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let text = refused(&["a.png", "b.png"], &["--out", "mast.txt"]);
    assert!(text.contains("0 objects at places of their own in 2 images: not enough to tell"), "{text}");
    assert!(!Path::new(&folder.join("mast.txt")).exists());
    assert!(refused(&["a.png", "c.png"], &[]).contains("c.png: another camera or size than the images before"));
    assert!(refused(&["a.png"], &["--above-road", "none"]).contains("expected metres, or any"));
}
