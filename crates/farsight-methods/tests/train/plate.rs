//! Whole runs of a small plate reader, and the built-in engine's answers against libtorch's.

use std::fs;
use std::path::Path;

use farsight_core::{Box3d, Detection, Dimensions, Label, ObjectClass};
use farsight_data::annotations::{Annotations, FileFormat, Plate, Plates};
use farsight_data::kitti::write_labels;
use farsight_data::{AugmentationConfig, network_input, read_image};
use farsight_graph::init::initial_weights;
use farsight_graph::model::NetworkConfig;
use farsight_methods::plate_reader::PlateReader;
use farsight_methods::plate_reader::geometry::{ANSWER_CHANNELS, INPUT_CHANNELS, PlateCrop, mean_answer};
use farsight_methods::plate_reader::train::{PlateReaderRun, PlateReaderTask, PlateReaderTaskConfig};
use farsight_methods::plate_reader::{PlateReaderConfig, PlateReaderModel};
use farsight_methods::refiner::geometry::input_rules;
use farsight_methods::roi::runner::onnx;
use farsight_methods::roi::{ANSWER, RoiRunner};
use farsight_onnx::Target;
use farsight_runtime::RtenRunner;
use farsight_train::config::{DataConfig, TrainConfig, ValidateConfig};
use farsight_train::executor::{Mode, Network, Precision, values_from_tensor};
use farsight_train::metrics::StepSummary;
use farsight_train::training::{Callback, Job, Start, TrainError, fit};
use image::Rgb;
use tch::{Device, Tensor, no_grad};

use crate::tiny::{camera, data_set};

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
fn runner(model: &PlateReaderModel) -> PlateReader {
    let file = onnx(model, Target::Portable, Path::new("in memory")).unwrap();
    PlateReader::new(RoiRunner::new(Box::new(RtenRunner::new(file, Some(1)).unwrap())), model.config.clone())
}

fn small() -> PlateReaderConfig {
    PlateReaderConfig { side: 32, channels: [8, 16, 16], hidden: 32, ..PlateReaderConfig::default() }
}

fn trained(root: &Path, epochs: u64, out: &Path) -> Result<(Vec<u8>, Kept), TrainError> {
    let run = PlateReaderRun {
        method: "plate_reader".to_owned(),
        model: small(),
        data: DataConfig { root: Some(root.to_owned()), ..DataConfig::default() },
        augmentation: AugmentationConfig::none(),
        train: TrainConfig {
            epochs,
            batch_size: 8,
            learning_rate: 2e-3,
            weight_decay: 1e-5,
            warm_up_steps: 5,
            clip_norm: 10.0,
            checkpoint_steps: 500,
            log_steps: 1,
            threads: 1,
            ..TrainConfig::default()
        },
        task: PlateReaderTaskConfig { least_height_px: 5.0, ..PlateReaderTaskConfig::default() },
        validate: None,
    };
    let mut kept = Kept::default();
    let job = Job { run, out: out.to_owned(), resume: false };
    fit::<PlateReaderTask>(&job, &mut kept).map(|path| (fs::read(path).unwrap(), kept))
}

/// A car that is seen from behind.
fn car(frame: usize) -> Box3d {
    let dimensions = Dimensions { height: 1.5, width: 1.6, length: 3.9 };
    Box3d { dimensions, location: [(frame % 3) as f64 - 1.0, 1.6, 7.0 + 0.25 * frame as f64], yaw: -1.5 }
}

/// Left and right end of its plate.
fn ends(frame: usize) -> [[f64; 3]; 2] {
    let Box3d { location: [x, y, z], yaw, .. } = car(frame);
    let (sin, cos) = yaw.sin_cos();
    let (middle_x, middle_z) = (x - 1.95 * cos, z + 1.95 * sin);
    // To the left as the camera sees it, which stands behind the car.
    [-0.26, 0.26].map(|right_m| [middle_x - right_m * sin, y - 0.6, middle_z - right_m * cos])
}

/// Frames of noise in which nothing is plain but a bright plate on each car, with a list of those.
fn plates_set(frames: usize) -> tempfile::TempDir {
    let folder = data_set(frames);
    let training = folder.path().join("training");
    fs::create_dir(training.join("plates")).unwrap();
    for frame in 0..frames {
        let path = training.join(format!("image_2/{frame:06}.png"));
        let mut image = read_image(&path).unwrap();
        let [[left, row], [right, _]] = ends(frame).map(|end| camera().pixel_from_point(end).unwrap());
        for (x, y, pixel) in image.enumerate_pixels_mut() {
            let on_plate = (left..right).contains(&f64::from(x)) && (f64::from(y) - row).abs() < 2.0;
            *pixel = if on_plate { Rgb([250; 3]) } else { Rgb(pixel.0.map(|value| value / 8)) };
        }
        image.save(&path).unwrap();
        let box3d = car(frame);
        let box2d = box3d.projected(&camera()).unwrap().clamped(199.0, 63.0);
        let label =
            Label { class: ObjectClass::Car, truncation: 0.0, occlusion: 0, alpha: box3d.alpha(), box2d, box3d };
        write_labels(&training.join(format!("label_2/{frame:06}.txt")), &[label]).unwrap();
        let [left, right] = ends(frame);
        let mut annotations = Annotations::default();
        annotations.insert(Plates(vec![Plate { label: 0, ends: [right, left] }]));
        FileFormat::of::<Plates>().write(&training, &format!("{frame:06}"), &annotations).unwrap();
    }
    folder
}

fn detection(box3d: Box3d) -> Detection {
    let box2d = box3d.projected(&camera()).unwrap().clamped(199.0, 63.0);
    Detection { class: ObjectClass::Car, score: 0.9, box2d, box3d, range_sigma_m: Some(0.06 * box3d.depth_m()) }
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn a_small_reader_learns_to_measure_with_plates() {
    let folder = plates_set(8);
    let out = folder.path().join("run");
    let (_, kept) = trained(folder.path(), 2000, &out).unwrap();
    let mean = |records: &[StepSummary]| {
        records.iter().map(|record| metric(record, "width_error")).sum::<f64>() / records.len() as f64
    };
    let (first, last) = (mean(&kept.records[..10]), mean(&kept.records[kept.records.len() - 30..]));
    assert!(last < 0.4 * first, "widths off by {first} to {last}");

    // Cars that are thought to be nearer or farther than they are come to their places.
    let model = PlateReaderModel::read(&out.join("plates.safetensors")).unwrap();
    let mut reader = runner(&model);
    let (mut known_off, mut read_off, mut found_off) = (0.0, 0.0, 0.0);
    for frame in 0..8 {
        let image = read_image(&folder.path().join(format!("training/image_2/{frame:06}.png"))).unwrap();
        for factor in [0.92, 1.08] {
            let known = detection(car(frame).scaled(factor));
            let off = |depth_m: f64| (depth_m / car(frame).depth_m()).ln().abs();
            let reading = reader.read_plates(&image, &camera(), std::slice::from_ref(&known)).unwrap()[0].unwrap();
            let found = reader.measured(&image, &camera(), vec![known.clone()]).unwrap().remove(0);
            assert!(
                found.range_sigma_m.unwrap() / found.box3d.depth_m() < 0.06,
                "less is known than before: {found:?}"
            );
            known_off += off(known.box3d.depth_m());
            read_off += off(reading.depth_m);
            found_off += off(found.box3d.depth_m());
        }
    }
    assert!(read_off < 0.5 * known_off, "known within {known_off}, read within {read_off}");
    assert!(found_off < 0.8 * known_off, "known within {known_off}, found within {found_off}");
}

#[test]
fn a_data_set_without_plates_is_told() {
    let folder = data_set(2);
    let error = trained(folder.path(), 1, &folder.path().join("run")).unwrap_err();
    assert!(matches!(error, TrainError::NoPlates), "{error:?}");
}

#[test]
fn the_built_in_engine_answers_as_libtorch_does() {
    let config = small();
    let model = PlateReaderModel::new(config.clone(), initial_weights(&config.graph(), 3)).unwrap();
    let folder = plates_set(2);
    let image = read_image(&folder.path().join("training/image_2/000001.png")).unwrap();
    let known = detection(car(1));
    let sideways = detection(Box3d { yaw: 0.1, ..car(1) });
    let person = Detection { class: ObjectClass::Pedestrian, ..known.clone() };
    let mut reader = runner(&model);
    let found = reader.read_plates(&image, &camera(), &[sideways, known, person]).unwrap();
    assert!(found[0].is_none() && found[2].is_none(), "{found:?}");

    let graph = config.graph();
    let tap = graph.tap(ANSWER).unwrap();
    let network = Network::new(graph, &model.weights, Device::Cpu, Precision::F32).unwrap();
    let crop = PlateCrop::of(&car(1), &camera(), [200, 64], config.side).unwrap();
    let mut pixels = network_input(&image, &crop.window, &input_rules(config.side), None);
    let mut answer = || -> [f64; ANSWER_CHANNELS] {
        let input =
            Tensor::from_slice(&pixels).view([1, INPUT_CHANNELS, config.side, config.side].map(|side| side as i64));
        pixels.chunks_mut(config.side).for_each(<[f32]>::reverse);
        let values = values_from_tensor(&no_grad(|| network.forward(&input, Mode::Evaluate, &[tap]))[0]);
        assert_eq!(values.len(), ANSWER_CHANNELS);
        std::array::from_fn(|channel| f64::from(values[channel]))
    };
    let [plain, mirrored] = [answer(), answer()];
    let expected = crop.decode(mean_answer(plain, mirrored, config.side));
    let found = found[1].unwrap();
    assert!((found.depth_m / expected.depth_m - 1.0).abs() < 1e-4, "{found:?}, expected {expected:?}");
    assert!((found.log_sigma / expected.log_sigma - 1.0).abs() < 1e-4, "{found:?}, expected {expected:?}");
}
