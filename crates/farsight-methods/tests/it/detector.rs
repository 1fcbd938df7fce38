//! A detector whose engine answers with a known scene must find that scene.

use farsight_core::detection::DecodeOptions;
use farsight_core::{Box3d, Camera, Detection, Dimensions, ObjectClass};
use farsight_methods::smoke::codec::{CHANNELS, STRIDE};
use farsight_methods::smoke::targets::feature_camera;
use farsight_methods::smoke::{LOGITS, REGRESSION, SmokeConfig, SmokeDetector};
use farsight_methods::{DetectError, Detector};
use farsight_onnx::TensorInfo;
use farsight_runtime::{EngineError, Runner, Tensor, TensorView};
use image::RgbImage;

/// Head maps are single precision: a part in ten million of a depth of 60 m, magnified by the exponentials.
const TOLERANCE_M: f64 = 1e-4;

const SCORE: f64 = 0.8;

/// Answers with the head maps of one box, whatever it sees.
struct Painter {
    object: Box3d,
    class: usize,
    config: SmokeConfig,
    image_size: [usize; 2],
    camera: Camera,
    outputs: Vec<TensorInfo>,
}

/// Outputs of a SMOKE network.
fn outputs() -> Vec<TensorInfo> {
    [LOGITS, REGRESSION].map(|name| TensorInfo { name: name.to_owned(), channels: None }).into()
}

impl Runner for Painter {
    fn engine(&self) -> &'static str {
        "painter"
    }

    fn inputs(&self) -> &[TensorInfo] {
        &[]
    }

    fn outputs(&self) -> &[TensorInfo] {
        &self.outputs
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        let [(_, TensorView { shape: &[1, 3, input_height, input_width], values })] = *inputs else {
            panic!("one image")
        };
        let input_size = [input_width, input_height];
        let rules = self.config.input_spec().input_for(self.image_size, &self.camera);
        assert_eq!(input_size, rules.size);
        assert_eq!(values.len(), 3 * input_size[0] * input_size[1]);
        let model_camera = self.config.quirks.camera(&self.camera);
        let camera = feature_camera(&model_camera.transformed(&rules.whole_image(self.image_size)));
        let [width, height] = input_size.map(|side| side / STRIDE);
        let area = width * height;

        let classes = self.config.classes.len();
        let encoded = self.config.codec().encode(&self.object, self.class, &camera).unwrap();
        let at = encoded.cell[1] * width + encoded.cell[0];
        let mut logits = vec![-9.0; classes * area];
        logits[self.class * area + at] = (SCORE / (1.0 - SCORE)).ln() as f32;
        let mut regression = vec![0.0; CHANNELS * area];
        for (channel, value) in raw(&encoded.regression).into_iter().enumerate() {
            regression[channel * area + at] = value as f32;
        }
        let tensor = |channels, values| Tensor { shape: vec![1, channels, height, width], values };
        Ok(vec![tensor(classes, logits), tensor(CHANNELS, regression)])
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        Err(EngineError::new("painter", "there is one"))
    }
}

/// The channels before their activations: sigmoid(x) - 1/2 = y has x = ln((1/2 + y) / (1/2 - y)).
fn raw(regression: &farsight_methods::smoke::codec::Regression<f64>) -> [f64; CHANNELS] {
    let [l, h, w] = regression.log_dimensions_lhw.map(|y| ((0.5 + y) / (0.5 - y)).ln());
    let [dx, dy] = regression.offset;
    let [s, c] = regression.direction;
    [regression.depth, dx, dy, l, h, w, s, c]
}

fn car(location: [f64; 3], yaw: f64) -> Box3d {
    Box3d { dimensions: Dimensions { height: 1.5, width: 1.6, length: 4.2 }, location, yaw }
}

/// KITTI's left colour camera, fourth column included.
fn kitti() -> Camera {
    Camera::from_projection([
        [721.5377, 0.0, 609.5593, 44.85728],
        [0.0, 721.5377, 172.854, 0.216_379_1],
        [0.0, 0.0, 1.0, 0.002_745_884],
    ])
    .unwrap()
}

#[test]
fn a_known_box_comes_back() {
    let hd = Camera::from_hfov(90.0, 1920, 1080).unwrap();
    let mut official = SmokeConfig::default();
    official.quirks.camera_3x3 = true;
    let table = [
        ("KITTI", SmokeConfig::default(), kitti(), [1242, 375], car([-3.2, 1.7, 18.4], -1.4)),
        ("KITTI, near and aside", SmokeConfig::default(), kitti(), [1242, 375], car([3.0, 1.6, 7.0], 2.9)),
        ("KITTI, official camera", official, kitti(), [1242, 375], car([-3.2, 1.7, 18.4], -1.4)),
        ("full HD", SmokeConfig::default(), hd, [1920, 1080], car([12.0, 2.0, 31.0], 0.3)),
        ("full HD, at the lower border", SmokeConfig::default(), hd, [1920, 1080], car([0.5, 3.6, 6.0], 0.3)),
    ];
    for (name, config, camera, image_size, object) in table {
        let engine = Painter { object, class: 0, config: config.clone(), image_size, camera, outputs: outputs() };
        let image = RgbImage::new(image_size[0] as u32, image_size[1] as u32);
        let found =
            detect(&mut SmokeDetector::new(Box::new(engine), &config, None), &[(&image, &camera)]).unwrap().remove(0);
        assert_eq!(found.len(), 1, "{name}");
        let detection = &found[0];
        assert_eq!(detection.class, ObjectClass::Car);
        assert!((detection.score - SCORE).abs() < 1e-6, "{name}: score {}", detection.score);
        for (got, put) in detection.box3d.corners().iter().flatten().zip(object.corners().iter().flatten()) {
            assert!((got - put).abs() < TOLERANCE_M, "{name}: {:?} is not {object:?}", detection.box3d);
        }
        let [max_x, max_y] = image_size.map(|side| side as f64);
        let outline = object.projected(&camera).unwrap().clamped(max_x, max_y);
        assert!((detection.box2d.x1 - outline.x1).abs() < 0.1, "{name}: {:?} is not {outline:?}", detection.box2d);
        assert!((detection.box2d.y2 - outline.y2).abs() < 0.1, "{name}: {:?} is not {outline:?}", detection.box2d);
    }
}

fn detect(detector: &mut SmokeDetector, images: &[(&RgbImage, &Camera)]) -> Result<Vec<Vec<Detection>>, DetectError> {
    detector.detect_batch(images, &DecodeOptions::default()).map(|(found, _)| found)
}

/// Answers with a regression map of the wrong size.
struct Wrong(Vec<TensorInfo>);

impl Runner for Wrong {
    fn engine(&self) -> &'static str {
        "wrong"
    }

    fn inputs(&self) -> &[TensorInfo] {
        &[]
    }

    fn outputs(&self) -> &[TensorInfo] {
        &self.0
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        let shape = inputs[0].1.shape;
        let logits = vec![shape[0], 3, shape[2] / STRIDE, shape[3] / STRIDE];
        let values = vec![0.0; logits.iter().product()];
        Ok(vec![Tensor { shape: logits, values }, Tensor { shape: vec![1, 7, 1, 1], values: vec![0.0; 7] }])
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        Ok(Box::new(Self(self.0.clone())))
    }
}

fn wrong() -> SmokeDetector {
    SmokeDetector::new(Box::new(Wrong(outputs())), &SmokeConfig::default(), None)
}

#[test]
fn maps_that_do_not_fit_are_an_error() {
    let error = detect(&mut wrong(), &[(&RgbImage::new(1242, 375), &kitti())]).unwrap_err();
    let expected = "the engine wrong gave \"reg_raw\" of the shape [1, 7, 1, 1]; expected [1, 8, 96, 320]";
    assert_eq!(error.to_string(), expected);
    let error = detect(&mut wrong(), &[(&RgbImage::new(0, 375), &kitti())]).unwrap_err();
    assert!(matches!(error, DetectError::Empty { width: 0, height: 375 }));
}

#[test]
fn images_of_a_batch_need_inputs_of_one_size() {
    let (wide, high) = (RgbImage::new(1242, 375), RgbImage::new(640, 480));
    let error = detect(&mut wrong(), &[(&wide, &kitti()), (&high, &kitti())]).unwrap_err();
    let expected = "image 1 of the batch needs an input of [1280, 960] pixels; the first one needs [1280, 384]";
    assert_eq!(error.to_string(), expected);
    assert!(detect(&mut wrong(), &[]).unwrap().is_empty());
    let error = detect(&mut wrong(), &[(&wide, &kitti()), (&wide, &kitti())]).unwrap_err();
    assert!(matches!(error, DetectError::Maps { .. }), "{error}");
}
