//! The answers of the built binary, word by word.

use std::path::Path;

use crate::program::farsight;
use farsight_graph::model::NetworkConfig;
use farsight_methods::smoke::SmokeModel;

/// Exit status, standard output and standard error of `farsight` with these arguments, run in `folder`.
fn farsight_in(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let output = farsight(folder, arguments);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// What is said first of a model that is not the shipped one.
const LEFT_OUT: &str = "note: m.safetensors: not the shipped weights, so without what is made for those: refiner, plate reader, road plane (--refiner, --plates and --above-road choose them)\n";

/// What follows [`LEFT_OUT`].
fn after_note(err: &str) -> &str {
    err.strip_prefix(LEFT_OUT).unwrap_or_else(|| panic!("{err}"))
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

Usage: farsight [OPTIONS] <COMMAND>

Commands:
  demo         Try it: the model that comes with the program on scenes that come with it
  range        Find vehicles in images and say how far away each is
  calibrate    Find out how a fixed camera stands over its road, from the traffic that it sees
  track        Follow vehicles through a video: identity, distance, speed and time to collision
  serve        Answer images over HTTP, with a page to try it
  eval         Judge result files as KITTI does, and their errors of distance
  eval-tracks  Judge tracks against labelled sequences: HOTA, and errors of distance, speed and time to collision
  synth        Render traffic scenes with exact labels
  train        Train a model
  fine-tune    Train a model on with your own labelled images, and fit its error bars
  import       Turn a checkpoint of SMOKE, mmdetection3d or ImageNet's DLA-34 into Farsight's format
  export       Write a model as an ONNX file, checked before it is kept
  parity       Compare an engine's answers with stored reference tensors
  engine       Manage the libraries of the optional engines
  doctor       Show what this machine has to run models with, and what would help
  bench        Time every stage, from the image file to the picture
  prune        Remove the channels of a model that matter least
  merge        Put the parts of a job together that --shard divided
  info         Show what a model is made of and what it costs
  measure      Measure a model on several data sets, and put the figures into documents
  robustness   Judge a model on images that are made worse step by step: noise, blur, light, compression, weather
  experiment   Train and judge several arms with several seeds, as a plan says
  completions  Print the script by which a shell completes commands and options
  man          Print a manual page
  help         Print this message or the help of the given subcommand(s)

Options:
  -q, --quiet              Print nothing about the results but what failed; the same as --log-level error
      --log-level <LEVEL>  What to print about the results: error, warn or info [default: info]
      --max-pixels <N>     Refuse images with more pixels, counted as they unpack: 16 bits and four channels count more [default: 100M]
  -h, --help               Print help
  -V, --version            Print version
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

Usage: farsight [OPTIONS] <COMMAND>

For more information, try '--help'.
";
    assert_eq!(refusal(&["rnage"]), expected);
}

#[test]
fn images_that_are_not_there() {
    let table = [
        (
            "http://host/a.jpg",
            "error: http://host/a.jpg: an address; expected a file: download it first (curl -O http://host/a.jpg)\n",
        ),
        ("b.png", "error: b.png: no such file or folder; expected an image, a folder of images or a pattern\n"),
        (
            "empty",
            "error: empty: no images in this folder; expected files of PNG, JPEG, WebP, BMP, TIFF, GIF, PPM or PGM\n",
        ),
        ("*.jpg", "error: *.jpg: matches no image; expected files of PNG, JPEG, WebP, BMP, TIFF, GIF, PPM or PGM\n"),
    ];
    for (input, problem) in table {
        let expected = format!("{problem}error: no image to look at\n");
        assert_eq!(refusal(&["range", input, "--hfov", "80", "--model", "model"]), expected);
    }
}

#[test]
fn no_camera() {
    let expected = "\
error: no camera: distances need its focal length; give one of --calib FILE, --fx PIXELS, --hfov DEGREES or --hfov auto (photos with EXIF data and images in KITTI's layout bring their own)
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
        (["--hfov", "wide"], "invalid value 'wide' for '--hfov <DEG>': expected a number or auto"),
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
fn one_dash_before_a_long_option() {
    let expected = "error: '-hfov' has one dash; expected '--hfov'\n\nUsage: farsight [OPTIONS] <COMMAND>\n\nFor more information, try '--help'.\n";
    assert_eq!(refusal(&["range", "a.png", "-hfov", "65"]), expected);
}

#[test]
fn an_image_as_a_calibration() {
    let folder = tempfile::tempdir().unwrap();
    image::RgbImage::new(9, 9).save(folder.path().join("plain.png")).unwrap();
    let (status, _, err) = farsight_in(folder.path(), &["range", "plain.png", "--calib", "plain.png"]);
    let expected = "error: plain.png: a PNG image; expected a calibration in KITTI's format, text with a row P2\n";
    assert_eq!((status, err.as_str()), (2, expected));
}

#[test]
fn inputs_that_fail_or_are_left_out_show_in_the_exit_status() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    small_model(folder);
    std::fs::create_dir(folder.join("frames")).unwrap();
    image::RgbImage::new(96, 64).save(folder.join("frames/a.webp")).unwrap();
    let range = |arguments: &[&str]| {
        let common = ["range", "--hfov", "80", "--model", "m.safetensors"];
        farsight_in(folder, &[&common[..], arguments].concat())
    };
    assert_eq!(range(&["frames"]).0, 0);
    // An input that is not there, beside one that is.
    let (status, out, err) = range(&["frames", "b.png"]);
    assert_eq!((status, out.lines().count() > 1), (1, true), "{err}");
    assert_eq!(range(&["frames", "b.png", "--strict"]).0, 1);
    // What a folder has and is not read.
    std::fs::write(folder.join("frames/b.heic"), "").unwrap();
    let (status, _, err) = range(&["frames"]);
    assert_eq!(status, 1);
    assert!(err.starts_with("error: frames: 1 file left out, b.heic is a HEIC picture; convert it to JPEG: "), "{err}");
    std::fs::remove_file(folder.join("frames/b.heic")).unwrap();
    // Nothing that can be looked at: no table either.
    std::fs::write(folder.join("video.mp4"), b"\0\0\0\x20ftypisom\0\0\x02\0isomiso2").unwrap();
    for arguments in [
        &["range", "video.mp4", "--model", "m.safetensors"][..],
        &["range", "video.mp4", "--hfov", "80", "--model", "m.safetensors"],
    ] {
        let (status, out, err) = farsight_in(folder, arguments);
        assert_eq!((status, out.as_str()), (2, ""), "{err}");
        assert!(
            after_note(&err)
                .starts_with("error: video.mp4: a video, which is not read here; take its frames out: ffmpeg "),
            "{err}"
        );
    }
    // An image that is larger than allowed.
    let (status, _, err) = range(&["frames", "--max-pixels", "6143"]);
    assert_eq!(status, 2);
    assert!(err.contains("a.webp: 96 x 64 pixels; expected at most 6143 pixels (--max-pixels)\n"), "{err}");
    assert_eq!(range(&["frames", "--max-pixels", "6144"]).0, 0);
    assert_eq!(range(&["frames", "--max-pixels", "1M"]).0, 0);
}

#[cfg(unix)]
#[test]
fn an_output_that_cannot_be_written_is_status_2_after_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    small_model(folder);
    for name in ["a.png", "b.png"] {
        image::RgbImage::new(96, 64).save(folder.join(name)).unwrap();
    }
    // A folder stands where the picture belongs.
    std::fs::create_dir_all(folder.join("out/a.png/in-the-way")).unwrap();
    let arguments =
        ["range", "a.png", "b.png", "--hfov", "80", "--model", "m.safetensors", "--out", "out", "--json", "all.json"];
    let (status, _, err) = farsight_in(folder, &arguments);
    assert_eq!(status, 2, "{err}");
    assert!(after_note(&err).starts_with("error: out/a.png: "), "{err}");
    assert!(err.ends_with("found in 2 images\nerror: 1 output could not be written\n"), "{err}");
    assert!(folder.join("out/b.png").is_file());
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join("all.json")).unwrap()).unwrap();
    assert_eq!(json.as_array().unwrap().len(), 2);
}

/// A photo with these EXIF entries (tag, value) of the type "short" in the camera's directory, and its orientation.
fn photo(path: &Path, orientation: u16, entries: &[(u16, u16)]) {
    image::RgbImage::new(96, 64).save(path).unwrap();
    let bytes = std::fs::read(path).unwrap();
    let entry = |tag: u16, kind: u16, value: u32| {
        [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &1_u32.to_le_bytes(), &value.to_le_bytes()].concat()
    };
    let first = [entry(0x0112, 3, u32::from(orientation)), entry(0x8769, 4, 38)].concat();
    let camera: Vec<u8> = entries.iter().flat_map(|&(tag, value)| entry(tag, 3, u32::from(value))).collect();
    let count = (entries.len() as u16).to_le_bytes();
    let tiff = [&b"II\x2a\0\x08\0\0\0\x02\0"[..], &first, &[0; 4], &count, &camera, &[0; 4]].concat();
    let length = (8 + tiff.len() as u16).to_be_bytes();
    std::fs::write(path, [&bytes[..2], &[0xFF, 0xE1], &length, b"Exif\0\0", &tiff, &bytes[2..]].concat()).unwrap();
}

#[test]
fn a_photo_brings_its_focal_length() {
    const EQUIVALENT: u16 = 0xA405;
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    small_model(folder);
    photo(&folder.join("wide.jpg"), 1, &[(EQUIVALENT, 26)]);
    photo(&folder.join("upright.jpg"), 6, &[(EQUIVALENT, 26)]);
    let answer = |image: &str, camera: &[&str]| {
        let range = ["range", image, "--model", "m.safetensors", "--min-score", "0.01", "--json", "all.json"];
        let (status, _, err) = farsight_in(folder, &[&range[..], camera].concat());
        assert_eq!(status, 0, "{err}");
        (std::fs::read_to_string(folder.join("all.json")).unwrap(), err)
    };
    // 96x64 pixels are 3:2: the width is 36 mm, and 24 mm when the camera is held upright.
    for (image, degrees, shown) in
        [("wide.jpg", 2.0 * (18.0_f64 / 26.0).atan(), 69.4), ("upright.jpg", 2.0 * (12.0_f64 / 26.0).atan(), 49.6)]
    {
        let (json, err) = answer(image, &[]);
        assert!(
            after_note(&err).starts_with(&format!(
                "note: {image}: camera from EXIF data (35 mm equivalent of 26 mm): --hfov {shown}\n"
            )),
            "{err}"
        );
        let (told, err) = answer(image, &["--hfov", &degrees.to_degrees().to_string()]);
        assert!(!err.contains("EXIF"), "{err}");
        let depth = |json: &str| {
            let json: serde_json::Value = serde_json::from_str(json).unwrap();
            json[0]["detections"][0]["location"][2].as_f64().unwrap()
        };
        assert!((depth(&json) / depth(&told) - 1.0).abs() < 1e-6, "{json} {told}");
    }
    photo(&folder.join("zero.jpg"), 1, &[(EQUIVALENT, 0)]);
    photo(&folder.join("absurd.jpg"), 1, &[(EQUIVALENT, 60_000)]);
    let told = |image: &str| farsight_in(folder, &["range", image, "--model", "m.safetensors"]);
    let (status, _, err) = told("zero.jpg");
    assert_eq!(status, 2);
    assert!(err.starts_with("error: no camera: distances need its focal length; give one of "), "{err}");
    let expected = "error: absurd.jpg: no camera: its EXIF data are not to be believed: 35 mm equivalent of 60000 mm; give one of \
                    --calib FILE, --fx PIXELS, --hfov DEGREES or --hfov auto\n";
    let (status, _, err) = told("absurd.jpg");
    assert_eq!((status, err.as_str()), (2, expected));
    // One photo without makes the others no worse.
    let both = ["range", "zero.jpg", "wide.jpg", "--model", "m.safetensors"];
    let (status, out, err) = farsight_in(folder, &both);
    assert_eq!((status, out.contains("wide")), (1, true), "{err}");
    assert!(err.contains("error: zero.jpg: no camera: no focal length in its EXIF data; give one of "), "{err}");
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
    assert_eq!(refusal(&["fine-tune", "--data", "mine", "--out", "mine.safetensors"]), expected);
}

#[test]
fn info_reads_the_model_part_of_a_config() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("run.toml"),
        "method = \"smoke\"\n[model]\ninput = [640, 192]\n[train]\nepochs = 1\n",
    )
    .unwrap();
    let (status, out, err) = farsight_in(folder.path(), &["info", "run.toml"]);
    assert_eq!((status, err.as_str()), (0, ""));
    assert!(out.starts_with("input           640 x 192 pixels\nclasses         Car, Cyclist, Pedestrian\n"), "{out}");
    assert!(out.lines().last().unwrap().starts_with("total "), "{out}");

    std::fs::write(folder.path().join("run.toml"), "method = \"smoke\"\n[model]\ninput = [640, 191]\n").unwrap();
    let (status, _, err) = farsight_in(folder.path(), &["info", "run.toml"]);
    let expected = "error: run.toml: model.input is 640x191; expected multiples of 32 pixels\n";
    assert_eq!((status, err.as_str()), (2, expected));
}

/// Writes a small model with fresh weights to `folder` and returns its path.
fn small_model(folder: &Path) -> std::path::PathBuf {
    let config = farsight_methods::smoke::config::SmokeConfig {
        input: [96, 64],
        width: 0.25,
        norm: farsight_graph::layers::NormKind::Batch,
        msfe: farsight_graph::layers::Msfe::A,
        ..farsight_methods::smoke::config::SmokeConfig::default()
    };
    let weights = farsight_graph::init::initial_weights(&config.graph(), 1);
    let path = folder.join("m.safetensors");
    SmokeModel::new(config, weights).unwrap().write(&path).unwrap();
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
fn large_images_are_drawn_at_a_scale_that_is_told() {
    let folder = tempfile::tempdir().unwrap();
    small_model(folder.path());
    image::RgbImage::new(4000, 3000).save(folder.path().join("large.png")).unwrap();
    image::RgbImage::new(96, 64).save(folder.path().join("small.png")).unwrap();
    let told = |arguments: &[&str], image: &str| {
        let common = ["--hfov", "80", "--model", "m.safetensors", image];
        let (status, _, err) = farsight_in(folder.path(), &[arguments, &common].concat());
        assert_eq!(status, 0, "{err}");
        err
    };
    let (range, track) = (["range", "--out", "out"], ["track", "--fps", "10", "--out", "film"]);
    for (command, note) in [
        (&range[..], "large.png: a large image, drawn at 1/2 of its size\n"),
        (&track, "note: large frames, drawn at 1/2 of their size\n"),
    ] {
        let err = told(command, "large.png");
        assert_eq!(err.matches(note).count(), 1, "{err}");
        assert!(!told(command, "small.png").contains("drawn at"));
    }
    for picture in ["out/large.png", "film/000000.png"] {
        assert!(folder.path().join(picture).is_file(), "{picture}");
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
    assert_eq!(from_file.replace("m.onnx", "m.safetensors"), answer("m.safetensors"));
}
