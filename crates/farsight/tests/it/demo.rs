//! A newcomer's first commands: the demo, a photo of another camera, rendered data, and a model judged on it.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::program;

fn farsight(arguments: &[&str], folder: &Path) -> Output {
    let output = program::farsight(folder, arguments);
    assert!(output.status.success(), "{arguments:?}\n{}", String::from_utf8_lossy(&output.stderr));
    output
}

fn text(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).unwrap()
}

#[test]
fn the_demo_leaves_pictures_and_says_where() {
    let folder = tempfile::tempdir().unwrap();
    let output = farsight(&["demo", "--out", "here"], folder.path());
    let answer = text(output.stdout);
    assert!(answer.lines().last().unwrap().contains("here"), "{answer}");
    let here = folder.path().join("here");
    let json: serde_json::Value = serde_json::from_slice(&fs::read(here.join("detections.json")).unwrap()).unwrap();
    let images = json.as_array().unwrap();
    assert_eq!(images.len(), 4);
    let found: usize = images.iter().map(|image| image["detections"].as_array().unwrap().len()).sum();
    assert!(found >= 4, "the shipped model finds {found} objects in its own scenes");
    for id in ["000000", "000001", "000002", "000003"] {
        let (width, _) = image::image_dimensions(here.join(format!("{id}.png"))).unwrap();
        assert!(width >= 1242, "{id}");
    }
}

#[test]
fn another_camera_needs_only_its_field_of_view() {
    let folder = tempfile::tempdir().unwrap();
    image::RgbImage::from_pixel(640, 480, image::Rgb([90, 100, 110])).save(folder.path().join("photo.png")).unwrap();
    let familiar = farsight(&["range", "photo.png", "--hfov", "65"], folder.path());
    assert!(!text(familiar.stderr).contains("trained"));
    let unfamiliar = text(farsight(&["range", "photo.png", "--hfov", "165"], folder.path()).stderr);
    assert!(unfamiliar.contains("the model was trained with"), "{unfamiliar}");
    let elsewhere = text(farsight(&["range", "photo.png", "--fx", "500", "--cx", "4000"], folder.path()).stderr);
    assert!(
        elsewhere.contains("principal point (4000, 240) lies outside the image of 640 x 480 pixels"),
        "{elsewhere}"
    );
}

#[test]
fn rendered_frames_can_be_evaluated_at_once() {
    let folder = tempfile::tempdir().unwrap();
    farsight(&["synth", "--out", "data", "--frames", "2", "--seed", "3"], folder.path());
    let first = fs::read(folder.path().join("data/training/image_2/000001.png")).unwrap();
    farsight(&["synth", "--out", "again", "--frames", "2", "--seed", "3"], folder.path());
    assert_eq!(first, fs::read(folder.path().join("again/training/image_2/000001.png")).unwrap());

    let evaluated = farsight(
        &["eval", "--data", "data", "--results", "kept", "--geometric-baselines", "--resamples", "0"],
        folder.path(),
    );
    assert!(text(evaluated.stdout).starts_with("2 frames"));
    assert!(folder.path().join("kept/000001.txt").is_file());
}

#[test]
fn a_twin_has_the_boxes_of_its_labels() {
    let folder = tempfile::tempdir().unwrap();
    farsight(&["synth", "--out", "data", "--frames", "1", "--seed", "8", "--jpeg", "90"], folder.path());
    let layout = ["--layout", "data/training/label_2", "--calib-dir", "data/training/calib"];
    farsight(&[&["synth", "--out", "twin"], layout.as_slice()].concat(), folder.path());
    let boxes = |root: &str| -> Vec<String> {
        let rows = fs::read_to_string(folder.path().join(root).join("training/label_2/000000.txt")).unwrap();
        let known = rows.lines().filter(|row| !row.starts_with("DontCare"));
        // Class and 3D box: the other fields are the picture's.
        known
            .map(|row| {
                format!("{} {}", row.split(' ').next().unwrap(), row.split(' ').skip(8).collect::<Vec<_>>().join(" "))
            })
            .collect()
    };
    let (original, twin) = (boxes("data"), boxes("twin"));
    let shared = twin.iter().filter(|row| original.contains(row)).count();
    assert_eq!(shared, twin.len(), "every labelled object of the twin is one of the original");
    assert!(shared * 2 >= original.len(), "{shared} of {} objects are seen in the twin", original.len());
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn benchmarks_tell_every_stage() {
    let folder = tempfile::tempdir().unwrap();
    let answer = text(farsight(&["bench", "--runs", "1", "--json", "bench.json"], folder.path()).stdout);
    for stage in ["load", "warp", "network", "decode", "draw"] {
        assert!(answer.contains(stage), "{stage} is missing:\n{answer}");
    }
    assert!(folder.path().join("bench.json").is_file());

    // A network that nobody has trained, several images at once, another size, the head everywhere.
    let small = "method = \"smoke\"\n[model]\nwidth = 0.25\nnorm = \"batch\"\nneck = \"plain\"\n";
    std::fs::write(folder.path().join("run.toml"), small).unwrap();
    let words = ["bench", "--model", "run.toml", "--runs", "1", "--input", "64x32", "--batch", "3", "--dense-head"];
    let answer = text(farsight(&words, folder.path()).stdout);
    assert!(
        answer.starts_with("run.toml on rten: image 1242x375, input 64x32, batch 3, 1 run, milliseconds\n"),
        "{answer}"
    );

    // Of other methods too, with one network or two.
    for (method, model) in
        [("centernet3d", "width = 0.25\nneck = \"plain\"\n"), ("oftnet", "width = 0.125\ninput = [320, 96]\n")]
    {
        let config = format!("method = \"{method}\"\n[model]\n{model}");
        std::fs::write(folder.path().join("other.toml"), config).unwrap();
        let words = ["bench", "--model", "other.toml", "--runs", "1", "--images", "0", "--input", "320x96"];
        let answer = text(farsight(&words, folder.path()).stdout);
        assert!(answer.starts_with("other.toml on rten: image 1242x375, input 320x96, batch 1, 1 run"), "{answer}");
    }
    // An SSD's inputs follow from the camera.
    let mut sized = Command::new(env!("CARGO_BIN_EXE_farsight"));
    let refused = sized.args(["bench", "--input", "64x32"]).current_dir(folder.path()).output().unwrap();
    let told = text(refused.stderr);
    assert!(!refused.status.success() && told.contains("farsight-w: a model that gives its inputs sizes"), "{told}");
}

/// A pruned model that nobody has trained on finds nothing, which is told.
#[test]
fn a_benchmark_that_finds_nothing_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let pruned = ["prune", "--model", "farsight-s", "--keep", "0.25", "--out", "p.safetensors"];
    assert!(farsight(&pruned, folder.path()).status.success());
    let words = ["bench", "--model", "p.safetensors", "--runs", "1", "--images", "0", "--json", "b.json"];
    let output = farsight(&words, folder.path());
    let (answer, told) = (text(output.stdout), text(output.stderr));
    let figures = std::fs::read_to_string(folder.path().join("b.json")).unwrap();
    let figures: serde_json::Value = serde_json::from_str(&figures).unwrap();
    assert_eq!(figures["objects"], 0, "{answer}");
    assert!(told.contains("nothing was found, as by a model with random weights or one that was pruned"), "{told}");
    assert!(!text(farsight(&["bench", "--runs", "1", "--images", "0"], folder.path()).stderr).contains("nothing was"));
}
