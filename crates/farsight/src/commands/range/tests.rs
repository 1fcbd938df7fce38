//! The whole command but the engine, which answers with one car in the middle of the image.

use std::cell::RefCell;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use clap::Parser;
use farsight::{Box3d, Pipeline};
use farsight_methods::smoke::codec::{CHANNELS, STRIDE};
use farsight_methods::smoke::config::SmokeConfig;
use farsight_methods::smoke::{LOGITS, REGRESSION, SmokeDetector};
use farsight_onnx::{INPUT, TensorInfo};
use farsight_runtime::{EngineError, Runner, Tensor, TensorView};
use image::RgbImage;

use super::job::Job;
use super::{RangeArgs, RangeName};
use crate::inputs;
use crate::printer::Printer;

#[derive(Parser)]
struct TestCli {
    #[command(flatten)]
    args: RangeArgs,
}

/// One peak in the middle, all regression channels zero: a car of the reference size at the reference depth.
struct OneCar {
    inputs: [TensorInfo; 1],
    outputs: [TensorInfo; 2],
}

impl OneCar {
    fn new() -> Self {
        let named = |name: &str, channels| TensorInfo { name: name.to_owned(), channels: Some(channels) };
        Self { inputs: [named(INPUT, 3)], outputs: [named(LOGITS, 3), named(REGRESSION, CHANNELS)] }
    }
}

impl Runner for OneCar {
    fn engine(&self) -> &'static str {
        "one car"
    }

    fn inputs(&self) -> &[TensorInfo] {
        &self.inputs
    }

    fn outputs(&self) -> &[TensorInfo] {
        &self.outputs
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        let [height, width] = [2, 3].map(|axis| inputs[0].1.shape[axis] / STRIDE);
        let mut logits = vec![-9.0; 3 * width * height];
        logits[height / 2 * width + width / 2] = 2.0;
        let tensor = |channels, values| Tensor { shape: vec![1, channels, height, width], values };
        Ok(vec![tensor(3, logits), tensor(CHANNELS, vec![0.0; CHANNELS * width * height])])
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        Ok(Box::new(Self::new()))
    }
}

#[derive(Clone, Default)]
struct Page(Rc<RefCell<Vec<u8>>>);

impl Write for Page {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Page {
    fn text(&self) -> String {
        String::from_utf8(self.0.borrow().clone()).unwrap()
    }
}

struct Answer {
    result: anyhow::Result<usize>,
    out: String,
    err: String,
}

/// Runs `farsight range` with these arguments on the engine above.
fn range(arguments: &[&Path]) -> Answer {
    let (out, err) = (Page::default(), Page::default());
    let result = run(arguments, Printer::to(Box::new(out.clone()), Box::new(err.clone())));
    Answer { result, out: out.text(), err: err.text() }
}

fn run(arguments: &[&Path], mut printer: Printer) -> anyhow::Result<usize> {
    let words =
        [Path::new("range")].into_iter().chain(arguments.iter().copied()).map(|word| word.as_os_str().to_owned());
    let fixed = ["--hfov", "80", "--model", "none"].map(Into::into);
    let args = TestCli::try_parse_from(words.chain(fixed)).unwrap().args;
    let detector = SmokeDetector::new(Box::new(OneCar::new()), &SmokeConfig::default(), None);
    let pipeline = Pipeline::builder().open_with(Box::new(detector)).unwrap();
    let job = Job::new(&args, inputs::find(&args.inputs).images, &mut printer)?;
    job.run(&pipeline, &mut printer).map(|failed| failed.len())
}

fn image_file(path: PathBuf) -> PathBuf {
    RgbImage::new(1280, 384).save(&path).unwrap();
    path
}

const TABLE: &str = "\
image  class       score      distance         x  box (left top right bottom)
";

#[test]
fn a_good_and_two_bad_images() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let good = image_file(at("good.png"));
    fs::write(at("empty.png"), "").unwrap();
    let bytes = fs::read(&good).unwrap();
    fs::write(at("cut.png"), &bytes[..bytes.len() / 2]).unwrap();

    let answer = range(&[
        folder.path(),
        Path::new("--out"),
        &at("pictures"),
        Path::new("--kitti"),
        &at("rows"),
        Path::new("--json"),
        &at("all.json"),
    ]);
    assert_eq!(answer.result.unwrap(), 2);
    let row = "good   Car          0.88        28.0 m     0.0 m  618 168 662 216\n";
    assert_eq!(answer.out, format!("{TABLE}{row}"));
    let errors: Vec<&str> = answer.err.lines().collect();
    assert!(errors[0].contains("cut.png: damaged image"), "{errors:?}");
    assert!(errors[1].contains("empty.png: an empty file; expected an image ("), "{errors:?}");
    assert_eq!(errors[2], "1 object found in 1 image; 2 images failed");

    assert!(image::open(at("pictures/good.png")).unwrap().height() > 384);
    assert!(fs::read_to_string(at("rows/good.txt")).unwrap().starts_with("Car -1 -1 "));
    assert_eq!(fs::read_dir(at("pictures")).unwrap().count(), 1);
    let json: serde_json::Value = serde_json::from_slice(&fs::read(at("all.json")).unwrap()).unwrap();
    assert_eq!(json.as_array().unwrap().len(), 1);
    assert_eq!(json[0]["image"], good.to_str().unwrap());
    assert_eq!([&json[0]["width"], &json[0]["height"]], [1280, 384]);
    let car = json[0]["detections"][0].as_object().unwrap();
    let keys: Vec<&str> = car.keys().map(String::as_str).collect();
    let measured = "alpha box2d class dimensions_hwl location";
    let ranged = "range_interval_50_m range_interval_68_m range_interval_m range_m range_sigma_m rotation_y score";
    assert_eq!(keys.join(" "), format!("{measured} {ranged}"));
    assert!(car["range_interval_m"].is_null());
    assert!(car["range_sigma_m"].is_null());
    assert!((car["range_m"].as_f64().unwrap() - 28.01).abs() < 1e-9);
}

#[test]
fn images_of_the_same_name_get_pictures_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["left", "right"] {
        fs::create_dir(at(name)).unwrap();
        image_file(at(name).join("1.png"));
    }
    let answer = range(&[&at("left"), &at("right"), Path::new("--out"), &at("out")]);
    assert_eq!(answer.result.unwrap(), 0);
    assert!(at("out/1.png").exists() && at("out/1-2.png").exists());
    let note = format!("note: {}: called 1-2 here, another image has its name", at("right/1.png").display());
    assert_eq!(answer.err.lines().next(), Some(note.as_str()));
}

#[test]
fn an_image_is_not_replaced_by_its_picture() {
    let folder = tempfile::tempdir().unwrap();
    let image = image_file(folder.path().join("1.png"));
    let before = fs::read(&image).unwrap();
    let answer = range(&[&image, Path::new("--out"), folder.path()]);
    let expected = format!("{}: would be replaced by its picture; give another --out", image.display());
    assert_eq!(answer.result.unwrap_err().to_string(), expected);
    assert_eq!(fs::read(&image).unwrap(), before);
}

#[test]
fn an_image_that_fails_has_no_outputs_of_an_earlier_run() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let images = ["bad.png", "good.png"].map(|name| image_file(at(name)));
    let run = || range(&[&images[0], &images[1], Path::new("--out"), &at("drawn"), Path::new("--kitti"), &at("rows")]);
    assert_eq!(run().result.unwrap(), 0);
    let outputs = || ["drawn/bad.png", "rows/bad.txt", "drawn/good.png", "rows/good.txt"].map(|path| at(path).exists());
    assert_eq!(outputs(), [true; 4]);
    fs::write(&images[0], "no image any more").unwrap();
    let answer = run();
    assert_eq!((answer.result.unwrap(), outputs()), (1, [false, false, true, true]));
    assert!(answer.err.contains("bad.txt: removed, as its image failed"), "{}", answer.err);
}

#[test]
fn results_go_nowhere_where_labels_images_or_calibrations_lie() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["image_2", "label_2", "calib", "rows"] {
        fs::create_dir(at(name)).unwrap();
    }
    let label = "Car 0.00 0 1.50 600.00 170.00 700.00 230.00 1.50 1.60 4.00 1.00 1.70 20.00 1.60\n";
    for name in ["label_2/1.txt", "rows/1.txt"] {
        fs::write(at(name), label).unwrap();
    }
    let image = image_file(at("image_2/1.png"));
    for (option, target, expected) in [
        ("--kitti", "label_2", "inputs come from this folder"),
        ("--kitti", "calib", "inputs come from this folder"),
        ("--out", "image_2", "inputs come from this folder"),
        ("--kitti", "rows", "1.txt: there already and no result file"),
        ("--json", "label_2/1.txt", "there already and no JSON"),
        ("--json", "image_2/1.png", "an input"),
        ("--json", "nowhere/all.json", "expected one that is there"),
    ] {
        let told = range(&[&image, Path::new(option), &at(target)]).result.unwrap_err().to_string();
        assert!(told.contains(expected), "{option} {target}: {told}");
    }
    assert!(["label_2/1.txt", "rows/1.txt"].iter().all(|name| fs::read_to_string(at(name)).unwrap() == label));
    // Beside photos that lie in no layout there is room.
    let photo = image_file(at("photo.png"));
    for _ in 0..2 {
        assert_eq!(range(&[&photo, Path::new("--kitti"), folder.path()]).result.unwrap(), 0);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_name_that_is_no_text_costs_no_results() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().unwrap();
    let image = image_file(folder.path().join("plain.png"));
    let named = folder.path().join(std::ffi::OsStr::from_bytes(b"caf\xe9.png"));
    if fs::rename(image, &named).is_err() {
        // Not every file system has such names.
        return;
    }
    let json = folder.path().join("all.json");
    assert_eq!(range(&[&named, Path::new("--json"), &json]).result.unwrap(), 0);
    let json: serde_json::Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    assert!(json[0]["image"].as_str().unwrap().ends_with("caf\u{fffd}.png"), "{json}");
}

#[test]
fn nobody_is_waited_for_who_reads_no_more() {
    struct Gone;
    impl Write for Gone {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(io::ErrorKind::BrokenPipe.into())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let folder = tempfile::tempdir().unwrap();
    for name in ["1.png", "2.png"] {
        image_file(folder.path().join(name));
    }
    let told = |more: &[&Path]| {
        let err = Page::default();
        let printer = Printer::to(Box::new(Gone), Box::new(err.clone()));
        run(&[&[folder.path()], more].concat(), printer).unwrap();
        err.text()
    };
    assert_eq!(told(&[]), "1 object found in 1 image\n");
    // Files are still wanted.
    assert_eq!(told(&[Path::new("--out"), &folder.path().join("drawn")]), "2 objects found in 2 images\n");
}

#[test]
fn lines_are_handed_on_image_by_image() {
    /// What there was each time that it was to be handed on.
    #[derive(Clone, Default)]
    struct FlushRecorder(Page, Rc<RefCell<Vec<String>>>);
    impl Write for FlushRecorder {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.write(bytes)
        }
        fn flush(&mut self) -> io::Result<()> {
            self.1.borrow_mut().push(self.0.text());
            Ok(())
        }
    }
    let folder = tempfile::tempdir().unwrap();
    for name in ["1.png", "2.png"] {
        image_file(folder.path().join(name));
    }
    let out = FlushRecorder::default();
    let printer = Printer::to(Box::new(out.clone()), Box::new(Page::default()));
    run(&[folder.path(), Path::new("--format"), Path::new("jsonl")], printer).unwrap();
    let seen: Vec<usize> = out.1.borrow().iter().map(|text| text.matches('\n').count()).collect();
    assert_eq!(seen, [1, 2]);
    assert!(out.0.text().lines().all(|line| line.starts_with("{\"image\":")), "{}", out.0.text());
}

#[test]
fn a_recording_appears_when_it_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let image = image_file(at("1.png"));
    assert_eq!(range(&[&image, Path::new("--mcap"), &at("a.mcap")]).result.unwrap(), 0);
    let bytes = fs::read(at("a.mcap")).unwrap();
    // The format's mark at both ends.
    assert!(bytes.starts_with(b"\x89MCAP0\r\n") && bytes.ends_with(b"\x89MCAP0\r\n"));
    let answer = range(&[&image, Path::new("--mcap"), &image]);
    assert!(answer.result.unwrap_err().to_string().contains("1.png: an input; expected another file"));
    if cfg!(not(feature = "rerun")) {
        let told = format!("{:#}", range(&[&image, Path::new("--rerun"), &at("a.rrd")]).result.unwrap_err());
        assert!(told.contains("a.rrd: cannot be written: this build has no rerun; expected one with it"), "{told}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn nothing_done_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("notes.txt");
    fs::write(&image, "no image").unwrap();
    let answer = range(&[&image]);
    assert_eq!(answer.result.unwrap_err().to_string(), "nothing was done: 1 image failed");
}

#[test]
fn kinds_of_range_order_as_they_must() {
    let object = Box3d {
        dimensions: farsight_core::Dimensions { height: 1.5, width: 1.6, length: 4.0 },
        location: [5.0, 1.6, 20.0],
        yaw: 0.4,
    };
    let [depth, euclidean, nearest] =
        [RangeName::Depth, RangeName::Euclidean, RangeName::Nearest].map(|range| range.kind().measure()(&object));
    assert!(nearest < depth && depth < euclidean, "{nearest} {depth} {euclidean}");
}
