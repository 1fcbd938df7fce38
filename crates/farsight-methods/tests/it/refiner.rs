//! The shipped refiner on a shipped scene.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use farsight_core::{Box2d, Box3d, Camera, Detection, Dimensions, ObjectClass};
use farsight_data::kitti::Calibration;
use farsight_data::read_image;
use farsight_methods::refiner::RefinerModel;
use farsight_methods::refiner::geometry::Refinement;
use farsight_methods::refiner::{Effort, Flip, Refiner};
use farsight_methods::roi::{RoiRunner, runner::onnx};
use farsight_onnx::{Target, TensorInfo};
use farsight_runtime::{EngineError, RtenRunner, Runner, Tensor, TensorView};
use image::RgbImage;

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(name)
}

fn scene() -> (RgbImage, Camera) {
    let calibration = Calibration::read(&file("assets/scenes/calib/000000.txt")).unwrap();
    (read_image(&file("assets/scenes/image_2/000000.jpg")).unwrap(), calibration.camera())
}

fn refiner() -> Refiner {
    let model = RefinerModel::read(&file("models/farsight-refiner.safetensors")).unwrap();
    let file = onnx(&model, Target::Portable, Path::new("refiner")).unwrap();
    Refiner::new(RoiRunner::new(Box::new(RtenRunner::new(file, Some(1)).unwrap())), model.config)
}

/// Three cars of the scene, and about how far away they are, metres.
const CARS: [([f64; 4], f64); 3] =
    [([232.0, 186.0, 463.0, 353.0], 8.4), ([679.0, 176.0, 741.0, 223.0], 24.7), ([700.0, 155.0, 802.0, 242.0], 17.2)];

/// Detections of a car that are off by this share of its width and height to each of the four sides.
fn detections(car: [f64; 4], depth_m: f64, camera: &Camera, share: f64) -> Vec<Detection> {
    let [x1, y1, x2, y2] = car;
    let (dx, dy) = (share * (x2 - x1), share * (y2 - y1));
    let at = |[dx, dy]: [f64; 2]| {
        let box2d = Box2d::new(x1 + dx, y1 + dy, x2 + dx, y2 + dy);
        let height = depth_m * (y2 - y1) / camera.focal_y();
        let dimensions = Dimensions { height, width: 1.6, length: 3.9 };
        let [x, y, z] = camera.point_from_pixel([f64::midpoint(x1, x2) + dx, f64::midpoint(y1, y2) + dy], depth_m);
        let box3d = Box3d { dimensions, location: [x, y + height / 2.0, z], yaw: 0.0 };
        Detection { class: ObjectClass::Car, score: 0.9, box2d, box3d, range_sigma_m: Some(0.06 * depth_m) }
    };
    [[dx, 0.0], [-dx, 0.0], [0.0, dy], [0.0, -dy]].map(at).to_vec()
}

/// By how much, in all, answers on one object differ from each other: in depth, relative, and in where its centre is
/// seen, tangents.
fn spread(refinements: &[Option<Refinement>]) -> [f64; 2] {
    let boxes: Vec<Box3d> = refinements.iter().map(|one| one.as_ref().unwrap().box3d).collect();
    let range = |value: &dyn Fn(&Box3d) -> f64| {
        let values = boxes.iter().map(value);
        values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
    };
    let across = |object: &Box3d| object.center()[0] / object.center()[2];
    [range(&|object| object.depth_m().ln()), range(&across)]
}

#[test]
fn several_looks_forget_where_the_first_one_was() {
    let (image, camera) = scene();
    let mut refiner = refiner();
    let (mut once, mut often) = ([0.0; 2], [0.0; 2]);
    for (car, depth_m) in CARS {
        let first = detections(car, depth_m, &camera, 0.08);
        let boxes: Vec<Box2d> = first.iter().map(|detection| detection.box2d).collect();
        let one = spread(&refiner.refine_boxes(&image, &camera, &boxes, Flip::Averaged).unwrap());
        let all = spread(&refiner.refinements(&image, &camera, &first, 0.0).unwrap());
        for part in 0..2 {
            once[part] += one[part];
            often[part] += all[part];
        }
    }
    assert!(often[0] < 0.8 * once[0] && often[1] < 0.8 * once[1], "one look {once:?}, several {often:?}");
}

/// A runner that counts what it is shown.
struct Counting {
    runner: Box<dyn Runner>,
    shown: Arc<AtomicUsize>,
}

impl Runner for Counting {
    fn engine(&self) -> &str {
        self.runner.engine()
    }

    fn inputs(&self) -> &[TensorInfo] {
        self.runner.inputs()
    }

    fn outputs(&self) -> &[TensorInfo] {
        self.runner.outputs()
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        self.shown.fetch_add(inputs[0].1.shape[0], Ordering::Relaxed);
        self.runner.run(inputs)
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        Ok(Box::new(Self { runner: self.runner.share()?, shown: self.shown.clone() }))
    }
}

#[test]
fn less_effort_is_fewer_looks_and_nearly_the_same_answers() {
    let (image, camera) = scene();
    let model = RefinerModel::read(&file("models/farsight-refiner.safetensors")).unwrap();
    let file = onnx(&model, Target::Portable, Path::new("refiner")).unwrap();
    let found: Vec<Detection> =
        CARS.into_iter().flat_map(|(car, depth_m)| detections(car, depth_m, &camera, 0.03)).collect();
    let looked = |effort: Effort, score: f64, sought: f64| {
        let found: Vec<Detection> = found.iter().map(|one| Detection { score, ..one.clone() }).collect();
        let shown = Arc::new(AtomicUsize::new(0));
        let runner = Box::new(RtenRunner::new(file.clone(), Some(1)).unwrap());
        let counting = Counting { runner, shown: shown.clone() };
        let refiner = Refiner::new(RoiRunner::new(Box::new(counting)), model.config.clone()).with_effort(effort);
        let answers = refiner.share().unwrap().refinements(&image, &camera, &found, sought).unwrap();
        (answers, shown.load(Ordering::Relaxed))
    };
    let [(fast, in_fast), (normal, in_normal), (best, in_best)] = Effort::ALL.map(|effort| looked(effort, 0.9, 0.0));
    assert_eq!([in_normal, in_best], [4 * found.len(); 2], "three looks, and a mirror image");
    assert!(normal == best, "what is promising is seen alike");
    assert!((found.len()..=2 * found.len()).contains(&in_fast), "{in_fast}");
    assert!(in_fast < 2 * found.len(), "nothing was settled");
    // The error bar says how much it may be.
    for (less, most) in fast.iter().zip(&best) {
        let (less, most) = (less.unwrap(), most.unwrap());
        let off = (less.box3d.depth_m() / most.box3d.depth_m()).ln().abs();
        assert!(off < most.depth_sigma, "{off} of {}", most.depth_sigma);
    }
    // What cannot reach the score that is sought gets no looks, but for the best effort.
    let [in_fast, in_normal, in_best] = Effort::ALL.map(|effort| looked(effort, 0.02, 0.5).1);
    assert_eq!([in_fast, in_normal, in_best], [0, 0, 4 * found.len()]);
}
