//! The answers of the built binary, word by word.
#![allow(clippy::unwrap_used, reason = "the helpers of a test may panic")]

use std::path::Path;
use std::process::Command;

/// Exit status, standard output and standard error of `farsight` with these arguments, run in `folder`.
fn farsight_in(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_farsight")).args(arguments).current_dir(folder).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// What `farsight` says on standard error when it cannot run.
fn refusal(arguments: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("empty")).unwrap();
    std::fs::write(folder.path().join("a.png"), "").unwrap();
    std::fs::write(folder.path().join("model"), "no model").unwrap();
    let (status, out, err) = farsight_in(folder.path(), arguments);
    assert_eq!((status, out.as_str()), (2, ""), "{arguments:?}: {err}");
    err
}

#[test]
fn no_arguments() {
    let expected = "\
Finds vehicles in images of one camera and says how far away each is

Usage: farsight <COMMAND>

Commands:
  demo     Try it: the model that comes with the program on scenes that come with it
  range    Find vehicles in images and say how far away each is
  eval     Judge result files as KITTI does, and their errors of distance
  synth    Render traffic scenes with exact labels
  train    Train a model
  import   Turn a checkpoint of SMOKE, mmdetection3d or ImageNet's DLA-34 into Farsight's format
  export   Write a model as an ONNX file, checked before it is kept
  parity   Compare an engine's answers with stored reference tensors
  engine   Manage the libraries of the optional engines
  doctor   Show what this machine has to run models with, and what would help
  bench    Time every stage, from the image file to the picture
  prune    Remove the channels of a model that matter least
  info     Show what a model is made of and what it costs
  measure  Measure a model on several data sets, and put the figures into documents
  help     Print this message or the help of the given subcommand(s)

Options:
  -h, --help     Print help
  -V, --version  Print version
";
    assert_eq!(refusal(&[]), expected);
    let (status, out, err) = farsight_in(Path::new("."), &["--help"]);
    assert_eq!((status, out.as_str(), err.as_str()), (0, expected, ""));
}

#[test]
fn a_typo() {
    let expected = "\
error: unrecognized subcommand 'rnage'

  tip: some similar subcommands exist: 'engine', 'range'

Usage: farsight <COMMAND>

For more information, try '--help'.
";
    assert_eq!(refusal(&["rnage"]), expected);
}

#[test]
fn images_that_are_not_there() {
    let table = [
        ("b.png", "error: b.png: no such file or folder; expected an image, a folder of images or a pattern\n"),
        ("empty", "error: empty: no images in this folder; expected files ending in .png, .jpg or .jpeg\n"),
        ("*.jpg", "error: *.jpg: matches no image; expected files ending in .png, .jpg or .jpeg\n"),
    ];
    for (input, problem) in table {
        let expected = format!("{problem}error: no image to look at\n");
        assert_eq!(refusal(&["range", input, "--hfov", "80", "--model", "model"]), expected);
    }
}

#[test]
fn no_camera() {
    let expected = "\
error: no camera: distances need its focal length; give one of --calib FILE, --fx PIXELS or --hfov DEGREES (images in KITTI's layout bring their own)
";
    assert_eq!(refusal(&["range", "a.png", "--model", "model"]), expected);
}

#[test]
fn numbers_that_no_camera_has() {
    let table = [
        (
            ["--hfov", "200"],
            "invalid value '200' for '--hfov <DEG>': horizontal field of view is 200 degrees; expected more than 0 and less than 180",
        ),
        (["--hfov", "wide"], "invalid value 'wide' for '--hfov <DEG>': expected a number"),
        (["--fx", "-700"], "invalid value '-700' for '--fx <F>': expected a positive number of pixels"),
        (["--min-score", "1.5"], "invalid value '1.5' for '--min-score <SCORE>': expected at least 0 and less than 1"),
        (
            ["--above-road", "0"],
            "invalid value '0' for '--above-road <METRES|any|none>': expected metres, from 0.2 to 50, any or none",
        ),
        (
            ["--above-road", "roof"],
            "invalid value 'roof' for '--above-road <METRES|any|none>': expected metres, from 0.2 to 50, any or none",
        ),
    ];
    for ([option, value], problem) in table {
        let expected = format!("error: {problem}\n\nFor more information, try '--help'.\n");
        assert_eq!(refusal(&["range", "a.png", "--model", "model", option, value]), expected);
    }
}

#[test]
fn a_calibration_that_is_none() {
    let expected = "error: a.png: no row \"P2:\"; expected the 3x4 projection of the left colour camera\n";
    assert_eq!(refusal(&["range", "a.png", "--model", "model", "--calib", "a.png"]), expected);
}

#[test]
fn no_model() {
    let expected = "error: m.safetensors: no such file; expected a model that `farsight train`, `farsight import` or `farsight export` wrote\n";
    assert_eq!(refusal(&["range", "a.png", "--hfov", "80", "--model", "m.safetensors"]), expected);
}

#[test]
fn a_bench_of_nothing_is_refused() {
    let expected = "expected width and height in multiples of 32, at most 8192: 1280x384";
    assert!(refusal(&["bench", "--input", "64x33"]).contains(expected));
    assert!(refusal(&["bench", "--input", "0x32"]).contains(expected));
    assert_eq!(refusal(&["bench", "--batch", "0"]), "error: --batch is 0; expected 1 to 256\n");
}

#[cfg(not(feature = "train"))]
#[test]
fn what_needs_libtorch_says_so() {
    let expected = "\
error: this farsight was built without libtorch; `cargo xtask libtorch` fetches it, `cargo xtask run range ...` builds and runs with it
";
    assert_eq!(refusal(&["range", "a.png", "--hfov", "80", "--model", "model", "--engine", "libtorch"]), expected);
    let expected = "\
error: this farsight was built without training, which needs libtorch; `cargo xtask libtorch` fetches it, `cargo xtask run train ...` builds and trains with it
";
    assert_eq!(refusal(&["train", "--config", "run.toml"]), expected);
}

#[test]
fn info_reads_the_model_part_of_a_config() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("run.toml"), "[model]\ninput = [640, 192]\n[train]\nepochs = 1\n").unwrap();
    let (status, out, err) = farsight_in(folder.path(), &["info", "run.toml"]);
    assert_eq!((status, err.as_str()), (0, ""));
    assert!(out.starts_with("input           640 x 192 pixels\nclasses         Car, Cyclist, Pedestrian\n"), "{out}");
    assert!(out.lines().last().unwrap().starts_with("total "), "{out}");

    std::fs::write(folder.path().join("run.toml"), "[model]\ninput = [640, 191]\n").unwrap();
    let (status, _, err) = farsight_in(folder.path(), &["info", "run.toml"]);
    let expected = "error: run.toml: model.input is 640x191; expected multiples of 32 pixels\n";
    assert_eq!((status, err.as_str()), (2, expected));
}

/// Writes a small model with fresh weights to `folder` and returns its path.
fn small_model(folder: &Path) -> std::path::PathBuf {
    let config = farsight_methods::smoke::config::SmokeConfig {
        input: [96, 64],
        width: 0.25,
        norm: farsight_methods::smoke::config::NormKind::Batch,
        msfe: farsight_methods::smoke::config::Msfe::A,
        ..farsight_methods::smoke::config::SmokeConfig::default()
    };
    let weights = farsight_graph::init::initial_weights(&farsight_graph::layers::network(&config), 1);
    let path = folder.join("m.safetensors");
    farsight_graph::model::Model::new(config, weights).unwrap().write(&path).unwrap();
    path
}

#[test]
fn only_virtual_depths_let_the_input_change_its_size() {
    let folder = tempfile::tempdir().unwrap();
    small_model(folder.path());
    let smaller = |model: &str| {
        let arguments = ["export", "--half", "--input", "64x32", "--model", model, "--out", "smaller.safetensors"];
        farsight_in(folder.path(), &arguments)
    };
    let (status, _, err) = smaller("m.safetensors");
    let expected = "\
error: m.safetensors: --input: the depths of this model hold at the size it was trained at, 96x64; expected a model with virtual depth (model.depth.focal_px)
";
    assert_eq!((status, err.as_str()), (2, expected));

    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/farsight-s.safetensors");
    let (status, _, err) = smaller(&shipped.display().to_string());
    assert_eq!(status, 0, "{err}");
    assert!(err.starts_with("warning: scores and error bars were fitted at "), "{err}");
    let (_, out, _) = farsight_in(folder.path(), &["info", "smaller.safetensors"]);
    assert!(out.starts_with("input           64 x 32 pixels\n"), "{out}");
}

#[test]
fn one_road_and_plates_need_error_bars() {
    let folder = tempfile::tempdir().unwrap();
    small_model(folder.path());
    image::RgbImage::new(96, 64).save(folder.path().join("a.png")).unwrap();
    let range = |option: &str, value: &str| {
        let arguments = ["range", "a.png", "--hfov", "80", "--model", "m.safetensors", option, value];
        farsight_in(folder.path(), &arguments)
    };
    let plates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/farsight-plates.safetensors");
    for (option, value) in
        [("--above-road", "1.3"), ("--above-road", "any"), ("--plates", &plates.display().to_string())]
    {
        let (status, _, err) = range(option, value);
        let expected = format!("error: m.safetensors: a model without error bars, which {option} goes by");
        assert!(status == 2 && err.starts_with(&expected), "{err}");
        assert_eq!(range(option, "none").0, 0);
    }
}

#[test]
fn a_model_that_is_none() {
    let expected =
        "error: model: no \"farsight.model\" in its metadata; expected a file written by `farsight export`\n";
    let message = refusal(&["range", "a.png", "--hfov", "80", "--model", "model"]);
    assert!(message == expected || message.starts_with("error: model: not a whole ONNX file: byte "), "{message}");
}

#[test]
fn export_and_range_with_the_model_and_with_the_file() {
    let folder = tempfile::tempdir().unwrap();
    small_model(folder.path());
    let run = |arguments: &[&str]| farsight_in(folder.path(), arguments);
    let (status, out, err) = run(&[
        "export",
        "--model",
        "m.safetensors",
        "--out",
        "m.onnx",
        "--training-data",
        "noise",
        "--training-data-licence",
        "CC0",
    ]);
    assert_eq!(status, 0, "{err}");
    let names: Vec<&str> = out.lines().map(|line| line.split_whitespace().next().unwrap()).collect();
    assert_eq!(names, ["cls_logits", "reg_raw", "m.onnx:"], "{out}");

    let (status, out, err) = run(&["info", "m.onnx"]);
    assert_eq!(status, 0, "{err}");
    for fact in ["trained on      noise", "its licence     CC0", "weights SHA-256 "] {
        assert!(out.contains(fact), "{fact} is not in {out}");
    }

    image::RgbImage::from_fn(96, 64, |x, y| image::Rgb([x as u8, y as u8, 90]))
        .save(folder.path().join("a.png"))
        .unwrap();
    let answer = |model: &str| {
        let json = format!("{model}.json");
        let arguments = ["range", "a.png", "--hfov", "80", "--min-score", "0.01", "--model", model, "--json", &json];
        let (status, _, err) = run(&arguments);
        assert_eq!(status, 0, "{err}");
        std::fs::read_to_string(folder.path().join(json)).unwrap()
    };
    let from_file = answer("m.onnx");
    assert!(from_file.contains("range_m"));
    assert_eq!(from_file, answer("m.safetensors"));
}
