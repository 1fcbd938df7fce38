//! The library and the program on it: what one says, the other says, digit for digit; and `eval` measures what `range`
//! shows.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::thread;

use crate::program::{done, root};
use farsight::json::{DetectionRecord, ImageRecord, SCHEMA_VERSION};
use farsight::{
    Camera, CameraSource, EngineKind, EngineOptions, Error, Exif, ModelSource, Pipeline, RangeKind, Road, StageSource,
    read_image,
};
use farsight_core::road::RoadPlane;
use farsight_data::kitti::Calibration;
use farsight_data::{Corruption, denoised};
use farsight_testing::asked;

/// Bytes that an image of farsight-n may ask for: lists of objects. A cut-out for the refiner would take 221,184 more.
const MOST_OF_AN_IMAGE: usize = 150_000;

fn scene(id: &str) -> PathBuf {
    root().join(format!("assets/scenes/image_2/{id}.jpg"))
}

/// What `pipeline` says of a shipped scene.
fn record(pipeline: &Pipeline, id: &str) -> ImageRecord {
    let path = scene(id);
    let image = read_image(&path).unwrap();
    let cameras = CameraSource::of_images(std::slice::from_ref(&path)).unwrap();
    let size = [image.width(), image.height()].map(|side| side as usize);
    let camera = cameras.camera(&path, size, &Exif::NONE).unwrap();
    let objects = pipeline.detect(&image, &camera).unwrap();
    ImageRecord::new(&path, &image, &camera, &objects, pipeline).with_camera_origin(cameras.origin(&path))
}

/// The file of `--json` for these records: reading numbers back may cost the last digit, so texts are compared.
fn text(records: &[ImageRecord]) -> String {
    serde_json::to_string_pretty(records).unwrap() + "\n"
}

#[test]
fn the_library_says_what_the_program_says() {
    let folder = tempfile::tempdir().unwrap();
    let paths = ["000000", "000001"].map(|id| scene(id).display().to_string());
    done(folder.path(), &["range", &paths[0], &paths[1], "--min-score", "0.05", "--json", "all.json"]);
    let pipeline = Pipeline::builder().min_score(0.05).open().unwrap();
    let told = ["000000", "000001"].map(|id| record(&pipeline, id));
    // Every number, every field.
    assert_eq!(fs::read_to_string(folder.path().join("all.json")).unwrap(), text(&told));
    assert!(told.iter().all(|record| record.schema_version == SCHEMA_VERSION && record.detections.len() > 3));

    let options = ["--refiner", "none", "--above-road", "none", "--max-overlap", "0.5", "--range", "nearest"];
    done(folder.path(), &[&["range", &paths[0], "--json", "some.json"], &options[..]].concat());
    let builder = Pipeline::builder().refiner(StageSource::Off).plates(StageSource::Off).road(Road::Ignored);
    let pipeline = builder.max_overlap(0.5).range(RangeKind::Nearest).open().unwrap();
    let told = record(&pipeline, "000000");
    assert_eq!(fs::read_to_string(folder.path().join("some.json")).unwrap(), text(&[told]));
}

#[test]
fn noisy_images_are_smoothed_and_others_are_not() {
    let image = read_image(scene("000000")).unwrap();
    let size = [image.width() as usize, image.height() as usize];
    let camera = Camera::from_hfov(81.0, size[0], size[1]).unwrap();
    let builder = Pipeline::builder().model(ModelSource::from_word("farsight-n")).min_score(0.05);
    let [smoothing, plain] = [true, false].map(|denoise| builder.clone().denoise(denoise).open().unwrap());
    assert_eq!(smoothing.detect(&image, &camera).unwrap(), plain.detect(&image, &camera).unwrap());
    let noisy = Corruption::GaussianNoise.applied(&image, 2, 5);
    let smoothed = smoothing.detect(&noisy, &camera).unwrap();
    assert_eq!(smoothed, plain.detect(&denoised(&noisy), &camera).unwrap());
    assert_ne!(smoothed, plain.detect(&noisy, &camera).unwrap());
}

/// What has a low score is told beside the rest, changes nothing of that, and is not looked at more closely.
#[test]
fn low_scores_come_beside_what_is_told_without_them() {
    let builder = || Pipeline::builder().model(ModelSource::from_word("farsight-n"));
    let [usual, low, lower] =
        [builder(), builder().low_score(0.15), builder().min_score(0.15)].map(|it| it.open().unwrap());
    let told = |pipeline: &Pipeline| {
        ["000000", "000001", "000002", "000003"].map(|id| record(pipeline, id).detections).concat()
    };
    let (usual, low, lower) = (told(&usual), told(&low), told(&lower));
    let sure: Vec<DetectionRecord> = low.iter().filter(|found| found.score > 0.5).cloned().collect();
    assert_eq!(sure, usual);
    assert!(low.len() > usual.len() && low.iter().all(|found| found.score > 0.15));
    // Where the low score is what is sought, they are looked at, and have other scores.
    let unsure = |told: &[DetectionRecord]| -> Vec<f64> {
        told.iter().map(|found| found.score).filter(|score| *score <= 0.5).collect()
    };
    assert_ne!(unsure(&low), unsure(&lower));
}

#[test]
fn eval_measures_what_range_shows() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    done(folder, &["synth", "--out", "data", "--frames", "3", "--seed", "7"]);
    let rows = |name: &str| {
        ["000000", "000001", "000002"]
            .map(|id| fs::read_to_string(folder.join(name).join(format!("{id}.txt"))).unwrap())
    };
    // The smallest model, for time.
    let eval = ["eval", "--model", "farsight-n", "--data", "data", "--resamples", "0", "--results"];
    let range = ["range", "--model", "farsight-n", "data/training/image_2", "--kitti"];
    done(folder, &[&eval[..], &["evaluated"]].concat());
    done(folder, &[&range[..], &["shown", "--min-score", "0.05"]].concat());
    assert_eq!(rows("evaluated"), rows("shown"));
    // Its threshold is that of the pipeline, too.
    done(folder, &[&eval[..], &["sure", "--min-score", "0.5", "--max-overlap", "1"]].concat());
    done(folder, &[&range[..], &["sure-shown", "--min-score", "0.5", "--max-overlap", "1"]].concat());
    assert_eq!(rows("sure"), rows("sure-shown"));
    assert!(rows("sure").concat().lines().count() < rows("evaluated").concat().lines().count());
    // So is the road that the calibration files tell (`farsight calibrate`), unless another one is named.
    for id in ["000000", "000001", "000002"] {
        let file = folder.join(format!("data/training/calib/{id}.txt"));
        let mut calibration = Calibration::read(&file).unwrap();
        // Not the rendered camera's height, so that what stands on this road has moved.
        calibration.road = Some(RoadPlane { slope: 0.0, tilt: 0.0, height_m: 2.4, sigmas: [0.002, 0.002, 0.02] });
        calibration.write(&file).unwrap();
    }
    done(folder, &[&eval[..], &["over-road"]].concat());
    done(folder, &[&range[..], &["over-road-shown", "--min-score", "0.05"]].concat());
    assert_eq!(rows("over-road"), rows("over-road-shown"));
    assert_ne!(rows("over-road"), rows("evaluated"));
    done(folder, &[&eval[..], &["named-road", "--above-road", "none"]].concat());
    done(folder, &[&range[..], &["named-road-shown", "--min-score", "0.05", "--above-road", "none"]].concat());
    assert_eq!(rows("named-road"), rows("named-road-shown"));
    assert_ne!(rows("named-road"), rows("over-road"));
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn images_side_by_side_give_the_bytes_of_one_after_the_other() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let images: Vec<String> =
        ["000000", "000001", "000002", "000003"].map(|id| scene(id).display().to_string()).to_vec();
    let range = |name: &str, options: &[&str]| {
        let (json, pictures) = (format!("{name}.json"), format!("{name}-pictures"));
        let mut arguments: Vec<&str> = vec!["range", "--json", &json, "--out", &pictures, "--kitti", name];
        arguments.extend(options);
        arguments.extend(images.iter().map(String::as_str));
        let table = done(folder, &arguments);
        let read = |file: String| fs::read(folder.join(file)).unwrap();
        let files = (0..4).flat_map(|id| {
            let extension = if options.contains(&"jpg") { "jpg" } else { "png" };
            [read(format!("{pictures}/00000{id}.{extension}")), read(format!("{name}/00000{id}.txt"))]
        });
        (table, read(json.clone()), files.collect::<Vec<_>>())
    };
    // Where each network has as many threads as there are cores, it is one image after the other.
    let alone = range("alone", &["--threads", "1000"]);
    assert!(range("side-by-side", &["--threads", "1"]) == alone);
    // Pictures as JPEG are smaller, and the answers the same.
    let smaller = range("smaller", &["--picture-format", "jpg"]);
    assert!(smaller.0 == alone.0 && smaller.1 == alone.1);
    assert!(smaller.2.iter().step_by(2).zip(alone.2.iter().step_by(2)).all(|(jpg, png)| 2 * jpg.len() < png.len()));
}

#[test]
fn threads_share_a_pipeline_and_get_the_same_answers() {
    let pipeline = Pipeline::builder().threads(1).open().unwrap();
    let alone = record(&pipeline, "000002");
    let together: Vec<ImageRecord> = thread::scope(|scope| {
        let started: Vec<_> = (0..3)
            .map(|_| {
                let pipeline = pipeline.clone();
                scope.spawn(move || record(&pipeline, "000002"))
            })
            .collect();
        started.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert!(together.iter().all(|record| *record == alone));
}

#[test]
fn records_survive_being_read_and_old_ones_are_read() {
    let pipeline = Pipeline::shipped().unwrap();
    let record = record(&pipeline, "000003");
    let text = serde_json::to_string(&record).unwrap();
    let again: ImageRecord = serde_json::from_str(&text).unwrap();
    assert_eq!(
        (again.image, again.model, again.detections.len()),
        (record.image, record.model, record.detections.len())
    );
    for (one, other) in record.detections.iter().zip(&again.detections) {
        assert!((one.range_m - other.range_m).abs() <= f64::EPSILON * one.range_m && one.class == other.class);
    }
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let names: BTreeSet<&str> = value.as_object().unwrap().keys().map(String::as_str).collect();
    let expected = ["camera", "detections", "height", "image", "model", "program_version", "schema_version", "width"];
    assert_eq!(names.into_iter().collect::<Vec<_>>(), expected);
    assert_eq!(value["camera"]["origin"], "calibration");
    assert_eq!(value["model"]["weights_sha256"].as_str().map(str::len), Some(64));

    let old = r#"{"image": "a.png", "width": 2, "height": 1, "detections": [{"class": "Car", "score": 0.5,
        "box2d": [0, 0, 1, 1], "dimensions_hwl": [1, 2, 3], "location": [0, 0, 9], "rotation_y": 0, "alpha": 0,
        "range_m": 9, "range_sigma_m": null}]}"#;
    let old: ImageRecord = serde_json::from_str(old).unwrap();
    let DetectionRecord { range_m, range_sigma_m, .. } = &old.detections[0];
    assert_eq!((old.schema_version, old.camera, *range_m, *range_sigma_m), (0, None, 9.0, None));
}

#[test]
fn what_cannot_be_opened_is_told_by_kind() {
    let folder = tempfile::tempdir().unwrap();
    let photo = folder.path().join("photo.png");
    image::RgbImage::new(4, 4).save(&photo).unwrap();
    assert!(matches!(Pipeline::open(&photo), Err(Error::Kind { .. })));
    let other_library = Pipeline::builder().engine_library(folder.path());
    assert!(matches!(other_library.open(), Err(Error::Option { engine: EngineKind::Rten, .. })));
    let engine = Pipeline::builder().engine(EngineKind::OnnxRuntime).engine_library(folder.path());
    assert!(matches!(engine.open(), Err(Error::Library(_))));
    let refiner = Pipeline::builder().refiner(StageSource::File(root().join("models/farsight-plates.safetensors")));
    assert!(matches!(refiner.open(), Err(Error::Model(_))));
    let named = Pipeline::builder().model(ModelSource::from_word("shipped")).open().unwrap();
    assert_eq!(named.info(), Pipeline::shipped().unwrap().info());
    let empty = named.detect(&image::RgbImage::new(0, 0), &Camera::from_hfov(60.0, 1, 1).unwrap());
    assert!(empty.unwrap_err().to_string().contains("expected at least one pixel"));
}

/// The example as somebody runs it: its JSON is what the library says.
#[test]
fn the_quickstart_prints_what_is_in_an_image() {
    let program = PathBuf::from(env!("CARGO_BIN_EXE_farsight"));
    let example = program.with_file_name("examples").join(format!("quickstart{}", std::env::consts::EXE_SUFFIX));
    if !example.is_file() {
        // A test that is run alone does not build the examples.
        let mut cargo = Command::new(env!("CARGO"));
        cargo.args(["build", "--quiet", "--package", "farsight", "--example", "quickstart"]);
        if cfg!(feature = "train") {
            cargo.args(["--features", "train"]);
        }
        assert!(cargo.current_dir(root()).status().unwrap().success());
    }
    let path = scene("000001");
    let output = Command::new(&example).arg(&path).args(["--hfov", "81.4"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told: ImageRecord = serde_json::from_slice(&output.stdout).unwrap();
    let image = read_image(&path).unwrap();
    let camera = Camera::from_hfov(81.4, image.width(), image.height()).unwrap();
    let pipeline = Pipeline::shipped().unwrap();
    let expected = ImageRecord::new(&path, &image, &camera, &pipeline.detect(&image, &camera).unwrap(), &pipeline);
    assert_eq!(String::from_utf8(output.stdout).unwrap(), serde_json::to_string_pretty(&expected).unwrap() + "\n");
    assert!(told.detections.len() > 2 && told.schema_version == SCHEMA_VERSION, "{told:?}");

    let refused = Command::new(&example).arg(&path).output().unwrap();
    let told = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && told.contains("expected IMAGE --hfov DEGREES"), "{told}");
}

/// From the second image on, what this thread asks for is the same each time, and little. Engines are libraries in C++
/// here, whose own memory does not count.
#[test]
fn later_images_ask_for_little_memory() {
    let path = scene("000000");
    let image = read_image(&path).unwrap();
    let cameras = CameraSource::of_images(std::slice::from_ref(&path)).unwrap();
    let size = [image.width(), image.height()].map(|side| side as usize);
    let camera = cameras.camera(&path, size, &Exif::NONE).unwrap();
    for kind in [EngineKind::OnnxRuntime, EngineKind::OpenVino] {
        let options = EngineOptions { kind, threads: Some(1), ..EngineOptions::default() };
        let Ok(pipeline) =
            Pipeline::builder().model(ModelSource::from_word("farsight-n")).engine_options(options).open()
        else {
            println!("skipped: no {kind}");
            continue;
        };
        let bytes: Vec<usize> = (0..5).map(|_| asked(|| pipeline.detect(&image, &camera).unwrap()).0).collect();
        println!("{kind}: {bytes:?} bytes an image");
        assert_eq!(bytes[3], bytes[4], "{kind}: {bytes:?}");
        assert!(bytes[4] < MOST_OF_AN_IMAGE, "{kind}: {bytes:?}");
    }
}
