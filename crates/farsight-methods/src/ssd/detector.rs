//! From an image and its camera to detections.

use farsight_core::detection::DecodeOptions;
use farsight_core::{Camera, ClassReference, Detection, Pitch};
use farsight_data::network_input_into;
use farsight_graph::model::NetworkConfig;
use farsight_onnx::{INPUT, LocalHeadFile};
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, StageTimes, TensorView};
use image::RgbImage;

use super::SsdConfig;
use super::anchors::{LEVELS, STRIDES, cells, shapes};
use super::config::{LABELS, SsdView};
use super::decode::Boxes;
use super::network::{BOXES, CLASSES};
use super::views::{Window, pitch_tangent, window};
use crate::detector::{DetectError, Detector, UnfamiliarCamera};
use crate::input_spec::InputSpec;
use crate::method::{DetectorMethod, Method};
use crate::network_detector::output;

/// With a lower score nearly everything is nothing, whatever is asked for.
const MIN_SCORE: f64 = 0.1;

/// So many of the first view's detections say how far down the camera looks.
const MOST_SEEN: usize = 50;

/// The size for which multiply-accumulates are counted, pixels: that of its training, in whole cells.
const COUNTED_INPUT: [usize; 2] = [320, 320];

/// An SSD, ready to look at images.
pub struct SsdDetector {
    runner: Box<dyn Runner>,
    config: SsdConfig,
    /// The input, kept from call to call.
    input: Vec<f32>,
}

impl SsdDetector {
    /// The network of `config`, which `runner` runs.
    pub fn new(runner: Box<dyn Runner>, config: SsdConfig) -> Self {
        Self { runner, config, input: Vec::new() }
    }

    /// What the network sees in `window` of `image`, added to `boxes`.
    fn look(
        &mut self,
        image: &RgbImage,
        window: &Window,
        min_score: f64,
        boxes: &mut Boxes,
    ) -> Result<StageTimes, DetectError> {
        let image_size = size(image);
        let rules = SsdConfig::input_rules(window.size);
        let ((), warp) = timed(|| network_input_into(&mut self.input, image, &window.affine, &rules, None));
        let [width, height] = window.size;
        let shape = [1, 3, height, width];
        let view = TensorView { shape: &shape, values: &self.input };
        let (outputs, network) = timed(|| self.runner.run(&[(INPUT, view)]));
        let mut outputs = outputs?;
        let runner = &*self.runner;
        let mut used = Vec::with_capacity(2 * LEVELS);
        let [all_columns, all_rows] = window.size.map(cells);
        let (found, decode) = timed(|| {
            for level in 0..LEVELS {
                let anchors = shapes(level).len();
                let (columns, rows) = (all_columns[level], all_rows[level]);
                let mut map = |name: &str, channels: usize| {
                    output(runner, &mut outputs, name, [1, channels * anchors, rows, columns])
                };
                let (places, classes) = (map(BOXES[level], 4)?, map(CLASSES[level], LABELS.len())?);
                boxes.extend(level, &places.image(0), &classes.image(0), window, image_size, min_score)?;
                used.extend([places.values, classes.values]);
            }
            Ok(())
        });
        for values in used {
            self.runner.recycle(values);
        }
        found.map(|()| StageTimes { warp, network, decode, ..StageTimes::default() })
    }
}

/// The tangent of how far down an upright camera looks, by what the first view shows.
fn seen_tangent(found: &[Detection], camera: &Camera, image: &RgbImage) -> f64 {
    Pitch::of(found, camera, size(image)).worthwhile_rad().map_or(0.0, f64::tan)
}

fn size(image: &RgbImage) -> [usize; 2] {
    [image.width() as usize, image.height() as usize]
}

impl Detector for SsdDetector {
    fn method(&self) -> &'static str {
        SsdConfig::METHOD
    }

    fn engine(&self) -> &str {
        self.runner.engine()
    }

    fn classes(&self) -> &[ClassReference] {
        &self.config.classes
    }

    fn has_error_bars(&self) -> bool {
        true
    }

    /// What a refiner finds to be a lorry stands at a third of its distance here.
    fn measures_distances(&self) -> bool {
        false
    }

    fn input_size(&self, image_size: [usize; 2], camera: &Camera) -> [usize; 2] {
        let first = self.config.views.first().and_then(|view| window(view, image_size, camera, pitch_tangent(camera)));
        first.map_or([0, 0], |window| window.size)
    }

    fn unfamiliar(&self, image_size: [usize; 2], camera: &Camera) -> Option<UnfamiliarCamera> {
        let rules = SsdConfig::input_rules([STRIDES[LEVELS - 1]; 2]);
        let absurd = InputSpec { rules, camera_3x3: false, focal_range_px: None }.unfamiliar(image_size, camera);
        absurd.or_else(|| {
            let hfov_deg = 2.0 * (image_size[0] as f64 / 2.0 / camera.focal_x()).atan().to_degrees();
            let range_deg @ [low, high] = self.config.hfov_range_deg;
            (hfov_deg < low || hfov_deg > high).then_some(UnfamiliarCamera::Wide { hfov_deg, range_deg })
        })
    }

    fn detect_batch(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        options: &DecodeOptions,
    ) -> Result<(Vec<Vec<Detection>>, StageTimes), DetectError> {
        let min_score = options.min_score(&self.config.classes).max(MIN_SCORE);
        let mut answers = Vec::with_capacity(images.len());
        let mut times = StageTimes::default();
        for (image, camera) in images {
            let (width, height) = image.dimensions();
            if width == 0 || height == 0 {
                return Err(DetectError::Empty { width, height });
            }
            let mut boxes = Boxes::default();
            let mut tangent = pitch_tangent(camera);
            for (place, view) in self.config.views.clone().into_iter().enumerate() {
                if place == 1 && !options.is_level && camera.is_upright() {
                    let found = boxes.clone().detections(&self.config, camera, MOST_SEEN);
                    tangent = seen_tangent(&found, camera, image);
                }
                if let Some(window) = window(&view, size(image), camera, tangent) {
                    times = times.plus(&self.look(image, &window, min_score, &mut boxes)?);
                }
            }
            let (found, decode) = timed(|| boxes.detections(&self.config, camera, options.max_detections));
            times.decode += decode;
            answers.push(found);
        }
        Ok((answers, times))
    }

    fn share(&self) -> Result<Box<dyn Detector>, EngineError> {
        Ok(Box::new(Self::new(self.runner.share()?, self.config.clone())))
    }
}

impl DetectorMethod for SsdConfig {
    const NOT_PRUNED: Option<&'static str> = Some("it is not trained here");

    fn detector(
        self,
        runner: Box<dyn Runner>,
        _: Vec<Box<dyn Runner>>,
        _: Option<&LocalHeadFile>,
    ) -> Option<Box<dyn Detector>> {
        Some(Box::new(SsdDetector::new(runner, self)))
    }
}

impl Method for SsdConfig {
    fn counted_input(&self) -> [usize; 2] {
        COUNTED_INPUT
    }

    fn facts(&self) -> Vec<(&'static str, String)> {
        let classes: Vec<&str> = self.classes.iter().map(|class| class.class.name()).collect();
        let views = self.views.iter().map(|SsdView { focal_px, rows }| match rows {
            Some([above, below]) => format!("{focal_px} px, rows from {above} above to {below} below the axis"),
            None => format!("{focal_px} px"),
        });
        vec![
            ("boxes", "in the image (SSD); distances by similar triangles".to_owned()),
            ("classes", classes.join(", ")),
            ("views, by focal length", views.collect::<Vec<_>>().join("; ")),
        ]
    }
}
