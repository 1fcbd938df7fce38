//! Whole runs of a small refiner, and the built-in engine's answers against libtorch's.

use std::fs;
use std::path::{Path, PathBuf};

use farsight_core::{Box2d, Box3d, Camera, Detection, ObjectClass};
use farsight_data::kitti::write_results;
use farsight_data::{AugmentationConfig, network_input};
use farsight_graph::init::initial_weights;
use farsight_graph::model::NetworkConfig;
use farsight_graph::weights::{WeightTensor, Weights};
use farsight_methods::refiner::geometry::{
    Crop, INPUT_CHANNELS, NOTHING, OUTPUT_CHANNELS, Refinement, input_rules, kind_of,
};
use farsight_methods::refiner::train::{RefinerRun, RefinerTask, RefinerTaskConfig};
use farsight_methods::refiner::{Flip, Refiner};
use farsight_methods::refiner::{RefinerConfig, RefinerModel};
use farsight_methods::roi::runner::onnx;
use farsight_methods::roi::{ANSWER, RoiBackbone, RoiRunner};
use farsight_methods::training::{TAGS, train};
use farsight_onnx::Target;
use farsight_runtime::RtenRunner;
use farsight_train::config::{DataConfig, TrainConfig, ValidateConfig};
use farsight_train::executor::{Mode, Network, Precision, values_from_tensor};
use farsight_train::metrics::StepSummary;
use farsight_train::training::{Callback, FileOptions, Job, Start, TrainError, fit};
use image::{Rgb, RgbImage};
use tch::{Device, Tensor, no_grad};

use crate::tiny::{camera, car, data_set};

#[derive(Debug, Default)]
struct Kept {
    records: Vec<StepSummary>,
}

impl Callback for Kept {
    fn on_start(&mut self, _: Start) {}

    fn on_step(&mut self, record: &StepSummary) {
        self.records.push(record.clone());
    }

    fn validate(&mut self, _: u64, _: &Path, _: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }
}

/// A number of a record by its name.
fn metric(record: &StepSummary, name: &str) -> f64 {
    record.metrics.iter().find(|(known, _)| *known == name).unwrap().1
}

/// The network on the built-in engine.
fn runner(model: &RefinerModel) -> Refiner {
    let file = onnx(model, Target::Portable, Path::new("in memory")).unwrap();
    Refiner::new(RoiRunner::new(Box::new(RtenRunner::new(file, Some(1)).unwrap())), model.config.clone())
}

fn small() -> RefinerConfig {
    RefinerConfig { side: 32, channels: [8; 4], hidden: 16, ..RefinerConfig::default() }
}

fn run(data: &Path) -> RefinerRun {
    RefinerRun {
        method: "refiner".to_owned(),
        model: small(),
        data: DataConfig { root: Some(data.to_owned()), ..DataConfig::default() },
        augmentation: AugmentationConfig::none(),
        train: TrainConfig {
            epochs: 10,
            batch_size: 4,
            learning_rate: 2e-3,
            weight_decay: 1e-5,
            warm_up_steps: 5,
            clip_norm: 10.0,
            log_steps: 1,
            threads: 1,
            ..TrainConfig::default()
        },
        task: RefinerTaskConfig { least_height_px: 5.0, ..RefinerTaskConfig::default() },
        validate: None,
    }
}

fn detection(box2d: Box2d, box3d: Box3d) -> Detection {
    Detection { class: ObjectClass::Car, score: 0.5, box2d, box3d, range_sigma_m: None }
}

fn trained(run: &RefinerRun, out: &Path, resume: bool) -> Result<(Vec<u8>, Kept), TrainError> {
    let mut kept = Kept::default();
    let job = Job { run: run.clone(), out: out.to_owned(), resume };
    fit::<RefinerTask>(&job, &mut kept).map(|path| (fs::read(path).unwrap(), kept))
}

#[test]
fn a_small_refiner_learns_a_small_set() {
    let folder = data_set(4);
    let mut run = run(folder.path());
    run.train.epochs = 400;
    let (_, kept) = trained(&run, &folder.path().join("run"), false).unwrap();
    let mean =
        |records: &[StepSummary]| records.iter().map(|r| metric(r, "depth_error")).sum::<f64>() / records.len() as f64;
    let (first, last) = (mean(&kept.records[..3]), mean(&kept.records[kept.records.len() - 20..]));
    assert!(last < 0.3 * first, "depths off by {first} to {last}");
}

#[test]
fn false_positives_are_the_background_class() {
    let folder = data_set(4);
    let mut run = run(folder.path());
    run.train.epochs = 300;
    let results = folder.path().join("results");
    fs::create_dir(&results).unwrap();
    let image_path = |frame: usize| folder.path().join(format!("training/image_2/{frame:06}.png"));
    // In each frame the car itself, which is no false alarm, and something in the dark to the right of it.
    let mut found = Vec::new();
    for frame in 0..4 {
        let mut image = image::open(image_path(frame)).unwrap().into_rgb8();
        image.enumerate_pixels_mut().filter(|(x, _, _)| *x > 125).for_each(|(_, _, pixel)| *pixel = Rgb([0; 3]));
        image.save(image_path(frame)).unwrap();
        let car = car(frame);
        let mut nothing = car.box3d;
        nothing.location[0] += 6.0;
        let box2d = nothing.projected(&camera()).unwrap().clamped(199.0, 63.0);
        found = vec![detection(car.box2d, car.box3d), detection(box2d, nothing)];
        write_results(&results.join(format!("{frame:06}.txt")), &found).unwrap();
    }
    run.task.detections = Some(results.clone());
    let out = folder.path().join("run");
    let (_, kept) = trained(&run, &out, false).unwrap();
    let mistaken: f64 = kept.records.iter().rev().take(20).map(|record| metric(record, "kind_error")).sum();
    assert!(mistaken < 20.0 * 0.1, "{mistaken} of 20 cut-outs mistaken");
    assert!(metric(&kept.records[0], "kind_error") > 0.3, "nothing was to be learnt");

    let model = RefinerModel::read(&out.join("refiner.safetensors")).unwrap();
    let image = image::open(image_path(3)).unwrap().into_rgb8();
    let second = runner(&model).refinements(&image, &camera(), &found, 0.0).unwrap();
    let likeliest = |look: &Option<Refinement>| {
        let kinds = look.as_ref().unwrap().kinds;
        (0..kinds.len()).max_by(|&a, &b| kinds[a].total_cmp(&kinds[b])).unwrap()
    };
    assert_eq!(second.iter().map(likeliest).collect::<Vec<_>>(), [kind_of(&ObjectClass::Car).unwrap(), NOTHING]);

    // A frame without its file is told, with the file.
    fs::remove_file(results.join("000002.txt")).unwrap();
    let missing = trained(&run, &folder.path().join("missing"), false).unwrap_err().to_string();
    assert!(missing.contains("results") && missing.contains("000002.txt"), "{missing}");
}

/// A detector that sees the left half of each car only: from its boxes alone the refiner learns where the whole is.
#[test]
fn objects_are_learnt_where_the_detector_has_them() {
    let folder = data_set(4);
    let mut run = run(folder.path());
    run.train.epochs = 400;
    let results = folder.path().join("results");
    fs::create_dir(&results).unwrap();
    let half = |frame: usize| {
        let car = car(frame);
        let x2 = f64::midpoint(car.box2d.x1, car.box2d.x2);
        detection(Box2d { x2, ..car.box2d }, car.box3d)
    };
    for frame in 0..4 {
        write_results(&results.join(format!("{frame:06}.txt")), &[half(frame)]).unwrap();
    }
    run.task.detections = Some(results);
    run.task.detected_share = 1.0;
    let out = folder.path().join("run");
    trained(&run, &out, false).unwrap();
    let model = RefinerModel::read(&out.join("refiner.safetensors")).unwrap();
    let frame = 2;
    let image = image::open(folder.path().join(format!("training/image_2/{frame:06}.png"))).unwrap().into_rgb8();
    let found = runner(&model).refine_boxes(&image, &camera(), &[half(frame).box2d], Flip::Off).unwrap();
    let center = |box3d: &Box3d| camera().pixel_from_point(box3d.center()).unwrap()[0];
    let (seen, truth) = (center(&found[0].unwrap().box3d), center(&car(frame).box3d));
    let cut = f64::midpoint(half(frame).box2d.x1, half(frame).box2d.x2);
    assert!(
        (seen - truth).abs() < 0.5 * (cut - truth).abs(),
        "at {seen}, the car at {truth}, what was cut out at {cut}"
    );
}

#[test]
fn a_run_starts_from_another_refiner() {
    let folder = data_set(4);
    let mut run = run(folder.path());
    run.train.epochs = 200;
    trained(&run, &folder.path().join("first"), false).unwrap();
    let started = |start: Option<PathBuf>, out: &str| {
        let mut run = run.clone();
        (run.train.epochs, run.train.learning_rate, run.train.start_from) = (1, 1e-6, start);
        trained(&run, &folder.path().join(out), false).map(|(_, kept)| kept.records[0].loss)
    };
    let fresh = started(None, "fresh").unwrap();
    let going_on = started(Some(folder.path().join("first/refiner.safetensors")), "second").unwrap();
    assert!(going_on < 0.5 * fresh, "{going_on}, and {fresh} from nothing");
    let missing = started(Some("nowhere.safetensors".into()), "third").unwrap_err().to_string();
    assert!(missing.contains("nowhere.safetensors"), "{missing}");
    // A file of another kind of network would leave everything random.
    let other = folder.path().join("other.safetensors");
    let tensor = WeightTensor { shape: vec![1], values: vec![0.5] };
    Weights { tensors: [("elsewhere".to_owned(), tensor)].into(), ..Weights::default() }.write(&other).unwrap();
    let nothing_fits = started(Some(other), "fourth").unwrap_err().to_string();
    assert!(nothing_fits.contains("other.safetensors: train.start_from: none of its tensors"), "{nothing_fits}");
}

/// As weights of ImageNet begin a refiner: its backbone comes from a file that has nothing else, and stays as it is.
#[test]
fn a_backbone_that_has_seen_photographs_begins_a_refiner() {
    const BODY: &str = "backbone.body.";
    let folder = data_set(4);
    let mut run = run(folder.path());
    run.model = RefinerConfig { backbone: RoiBackbone::MobilenetV2, ..small() };
    let mut weights = initial_weights(&run.model.graph(), 7);
    weights.tensors.retain(|name, _| name.starts_with(BODY));
    let start = folder.path().join("backbone.safetensors");
    weights.write(&start).unwrap();
    run.train.epochs = 150;
    run.train.start_from = Some(start);
    run.train.start_without =
        Some(["fine8.", "fine16.", "whole.", "hidden.", "answer.", "kinds."].map(Into::into).into());
    run.train.freeze = vec![BODY.to_owned()];
    let out = folder.path().join("run");
    let (_, kept) = trained(&run, &out, false).unwrap();
    let model = RefinerModel::read(&out.join("refiner.safetensors")).unwrap();
    for (name, tensor) in &weights.tensors {
        assert_eq!(&model.weights.tensors[name], tensor, "{name}");
    }
    let loss = |records: &[StepSummary]| records.iter().map(|record| record.loss).sum::<f64>() / records.len() as f64;
    let (first, last) = (loss(&kept.records[..3]), loss(&kept.records[kept.records.len() - 5..]));
    assert!(last < 0.6 * first, "a loss of {first} became {last}");
}

#[test]
fn a_run_that_goes_on_ends_in_the_same_bytes_for_any_number_of_workers() {
    let folder = data_set(6);
    let mut run = run(folder.path());
    run.augmentation = AugmentationConfig::default();
    (run.train.epochs, run.train.batch_size, run.train.checkpoint_steps) = (3, 2, 4);
    run.train.ema_decay = Some(0.8);
    let (whole, _) = trained(&run, &folder.path().join("whole"), false).unwrap();
    // As if it had been killed after the checkpoint at step 4 of 9: the refiner is not there, the checkpoint is.
    let out = folder.path().join("parts");
    let mut stopper = Stopper { after: 5, seen: 0 };
    run.data.workers = 3;
    let job = Job { run: run.clone(), out: out.clone(), resume: false };
    let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| fit::<RefinerTask>(&job, &mut stopper)));
    assert!(stopped.is_err() && !out.join("refiner.safetensors").exists());
    let (parts, kept) = trained(&run, &out, true).unwrap();
    assert!(whole == parts, "the refiners differ");
    assert_eq!(kept.records[0].step, 5);
    let again = trained(&run, &out, false).unwrap_err().to_string();
    assert!(again.contains("there is a run here already"), "{again}");
    run.train.seed += 1;
    let other = trained(&run, &out, true).unwrap_err().to_string();
    assert!(other.contains("another config"), "{other}");
}

/// Stands for a process that is killed.
struct Stopper {
    after: usize,
    seen: usize,
}

impl Callback for Stopper {
    fn on_start(&mut self, _: Start) {}

    fn on_step(&mut self, _: &StepSummary) {
        self.seen += 1;
        assert!(self.seen < self.after, "stopped");
    }

    fn validate(&mut self, _: u64, _: &Path, _: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }
}

#[test]
fn mistakes_in_a_config_are_told_with_file_and_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("refiner.toml");
    let error = |text: &str| {
        fs::write(&path, text).unwrap();
        let options = FileOptions { out: folder.path().join("run"), ..FileOptions::default() };
        train(&path, &options, &mut Kept::default()).unwrap_err().to_string()
    };
    for (text, expected) in [
        ("method = \"refiner\"\n[model]\nside = 90", "model.side is 90; expected a multiple of 16"),
        ("method = \"refiner\"\n[train]\nepochs = 0", "train.epochs is 0; expected a positive number"),
        ("method = \"refiner\"\n[train]\nlearning_rate = -1", "train.learning_rate is -1"),
        ("method = \"refiner\"\n[train]\nema_decay = 1.0", "train.ema_decay is 1; expected a number between 0 and 1"),
        ("method = \"refiner\"\n[task]\ndetected_share = 1.5", "detected_share is 1.5; expected 0 to 1"),
        ("method = \"refiner\"\n[task]\ndetected_share = 0.5", "detected_share needs detections"),
        ("method = \"refiner\"\n[task]\nmost_truncated = 2", "most_truncated is 2; expected 0 to 1"),
        ("method = \"refiner\"\n[augmentation]\nflip_probability = 2", "augmentation.flip_probability is 2"),
        ("method = \"refiner\"\n[model]\nsides = 96", "unknown field `sides`"),
        ("method = \"refiner\"\n[data.rendered]\n[task]\ndetections = \"x\"", "task.detections needs data.root"),
        ("method = \"refiner\"\n[task]\nimage_weight = 1", "unknown field `image_weight`"),
        (
            "method = \"refiner\"\n[validate]\nroot = \"x\"\nsplit = \"val\"\nevery_steps = 0",
            "validate.every_steps is 0",
        ),
        ("method = \"plate_reader\"\n[model]\nside = 70", "model.side is 70; expected a multiple of 8"),
        ("method = \"plate_reader\"\n[task]\ndetections = \"x\"", "unknown field `detections`"),
        ("method = \"refiner\nepochs = 1", "TOML parse error at line 1"),
        ("method = \"yolo\"", &format!("method is \"yolo\"; expected one of {}", TAGS.join(", "))),
        ("[model]\nside = 96", &format!("method is missing; expected one of {}", TAGS.join(", "))),
    ] {
        let error = error(text);
        assert!(error.contains(expected) && error.contains("refiner.toml"), "{error}");
    }
}

#[test]
fn the_built_in_engine_answers_as_libtorch_does() {
    let config = small();
    let model = RefinerModel::new(config.clone(), initial_weights(&config.graph(), 3)).unwrap();
    let camera = Camera::from_intrinsics(210.0, 210.0, 100.0, 60.0).unwrap();
    let image =
        RgbImage::from_fn(200, 120, |x, y| Rgb([(x * 7 % 251) as u8, (y * 13 % 241) as u8, (x * y % 239) as u8]));
    let boxes =
        [Box2d::new(20.0, 30.0, 90.0, 80.0), Box2d::new(150.0, 10.0, 199.0, 119.0), Box2d::new(5.0, 5.0, 6.0, 6.0)];
    let mut refiner = runner(&model);
    let found = [Flip::Off, Flip::Averaged].map(|flip| refiner.refine_boxes(&image, &camera, &boxes, flip).unwrap());
    assert!(found.iter().all(|refinements| refinements[2].is_none()), "a box of one pixel shows nothing");

    let graph = config.graph();
    let tap = graph.tap(ANSWER).unwrap();
    let network = Network::new(graph, &model.weights, Device::Cpu, Precision::F32).unwrap();
    let rules = input_rules(config.side);
    for (place, box2d) in boxes.iter().enumerate().take(2) {
        let crop = Crop::from_box(box2d, &camera, config.side).unwrap();
        let mut pixels = network_input(&image, &crop.window, &rules, None);
        let mut answer = |crop: &Crop| -> [f64; OUTPUT_CHANNELS] {
            let shape = [1, INPUT_CHANNELS, config.side, config.side].map(|side| side as i64);
            let input = Tensor::from_slice(&[&pixels[..], &crop.rays()].concat()).view(shape);
            pixels.chunks_mut(config.side).for_each(<[f32]>::reverse);
            let answer = no_grad(|| network.forward(&input, Mode::Evaluate, &[tap]));
            let values = values_from_tensor(&answer[0]);
            assert_eq!(values.len(), OUTPUT_CHANNELS);
            std::array::from_fn(|channel| f64::from(values[channel]))
        };
        let [plain, mirrored] = [answer(&crop), answer(&crop.mirrored())];
        for (refinements, expected) in found.iter().zip([plain, crop.mean_answer(&plain, &mirrored)]) {
            let (found, expected) = (refinements[place].as_ref().unwrap(), crop.decode(&expected).unwrap());
            let off = (found.box3d.depth_m() / expected.box3d.depth_m() - 1.0).abs();
            assert!(off < 1e-4, "{found:?}, expected {expected:?}");
            assert!((found.depth_sigma / expected.depth_sigma - 1.0).abs() < 1e-4);
            assert!((found.box3d.yaw - expected.box3d.yaw).abs() < 1e-3);
            assert!(found.kinds.iter().zip(expected.kinds).all(|(a, b)| (a - b).abs() < 1e-3));
        }
    }
}
