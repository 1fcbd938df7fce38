//! A detector whose engine answers with a known scene must find that scene.
#![allow(clippy::unwrap_used, reason = "the helpers of a test may panic")]

use farsight_methods::smoke::codec::{CHANNELS, STRIDE};
use farsight_core::detection::DecodeOptions;
use farsight_methods::smoke::targets::feature_camera;
use farsight_core::{Box3d, Camera, Dimensions, HeadMaps, ObjectClass};
use farsight_infer::{DetectError, Detector, DetectorSpec, Engine, EngineError};
use farsight_methods::smoke::config::SmokeConfig;
use image::RgbImage;

/// Head maps are single precision: a part in ten million of a depth of 60 m, magnified by the exponentials.
const TOLERANCE_M: f64 = 1e-4;

const SCORE: f64 = 0.8;

/// Answers with the head maps of one box, whatever it sees.
struct Painter {
    object: Box3d,
    class: usize,
    spec: DetectorSpec,
    image_size: [usize; 2],
    camera: Camera,
}

impl Engine for Painter {
    fn name(&self) -> &'static str {
        "painter"
    }

    fn batch_head_maps(&mut self, input: &[f32], input_size: [usize; 2]) -> Result<Vec<HeadMaps>, EngineError> {
        let rules = self.spec.input_for(self.image_size, &self.camera);
        assert_eq!(input_size, rules.size);
        assert_eq!(input.len(), 3 * input_size[0] * input_size[1]);
        let model_camera = self.spec.quirks.camera(&self.camera);
        let camera = feature_camera(&model_camera.transformed(&rules.whole_image(self.image_size)));
        let map_size @ [width, height] = input_size.map(|side| side / STRIDE);
        let area = width * height;

        let encoded = self.spec.codec.encode(&self.object, self.class, &camera).unwrap();
        let at = encoded.cell[1] * width + encoded.cell[0];
        let mut logits = vec![-9.0; self.spec.codec.classes.len() * area];
        logits[self.class * area + at] = (SCORE / (1.0 - SCORE)).ln() as f32;
        let mut regression = vec![0.0; CHANNELS * area];
        for (channel, value) in raw(&encoded.regression).into_iter().enumerate() {
            regression[channel * area + at] = value as f32;
        }
        Ok(vec![HeadMaps { logits, regression, map_size }])
    }
}

/// The channels before their activations: sigmoid(x) - 1/2 = y has x = ln((1/2 + y) / (1/2 - y)).
fn raw(regression: &farsight_methods::smoke::codec::Regression<f64>) -> [f64; CHANNELS] {
    let [l, h, w] = regression.log_dimensions_lhw.map(|y| ((0.5 + y) / (0.5 - y)).ln());
    let [dx, dy] = regression.offset;
    let [s, c] = regression.direction;
    [regression.depth, dx, dy, l, h, w, s, c]
}

fn spec(config: &SmokeConfig) -> DetectorSpec {
    DetectorSpec::new(config, DecodeOptions::default())
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
        let spec = spec(&config);
        let engine = Painter { object, class: 0, spec: spec.clone(), image_size, camera };
        let image = RgbImage::new(image_size[0] as u32, image_size[1] as u32);
        let found = Detector::new(Box::new(engine), spec).detect(&image, &camera).unwrap();
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

/// Answers with maps of the wrong size.
struct Wrong;

impl Engine for Wrong {
    fn name(&self) -> &'static str {
        "wrong"
    }

    fn batch_head_maps(&mut self, _: &[f32], input_size: [usize; 2]) -> Result<Vec<HeadMaps>, EngineError> {
        let map_size = input_size.map(|side| side / STRIDE);
        let logits = vec![0.0; 3 * map_size[0] * map_size[1]];
        Ok(vec![HeadMaps { logits, regression: vec![0.0; 7], map_size }])
    }
}

#[test]
fn maps_that_do_not_fit_are_an_error() {
    let mut detector = Detector::new(Box::new(Wrong), spec(&SmokeConfig::default()));
    let error = detector.detect(&RgbImage::new(1242, 375), &kitti()).unwrap_err();
    let expected = "the engine wrong gave 7 values of the regression map; expected 245760 for 320 x 96 cells";
    assert_eq!(error.to_string(), expected);
    let error = detector.detect(&RgbImage::new(0, 375), &kitti()).unwrap_err();
    assert!(matches!(error, DetectError::Empty { width: 0, height: 375 }));
}

#[test]
fn images_of_a_batch_need_inputs_of_one_size() {
    let mut detector = Detector::new(Box::new(Wrong), spec(&SmokeConfig::default()));
    let (wide, high) = (RgbImage::new(1242, 375), RgbImage::new(640, 480));
    let error = detector.detect_batch_timed(&[(&wide, &kitti()), (&high, &kitti())]).unwrap_err();
    let expected = "image 1 of the batch needs an input of [1280, 960] pixels; the first one needs [1280, 384]";
    assert_eq!(error.to_string(), expected);
    assert!(detector.detect_batch_timed(&[]).unwrap().0.is_empty());
    let error = detector.detect_batch_timed(&[(&wide, &kitti()), (&wide, &kitti())]).unwrap_err();
    assert!(matches!(error, DetectError::Maps { found: 7, .. }), "{error}");
}
