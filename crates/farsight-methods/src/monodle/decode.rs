//! From maps to detections.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::peaks::Peak;
use farsight_core::{ClassReference, Detection};
use farsight_runtime::TensorView;

use super::MonoDleConfig;
use super::codec::{Codec, Encoded};
use super::network::REGRESSION_HEADS;
use crate::center_map::{
    CenterMethod, Features, Heading, at_peaks, depth_from_raw, depth_scale, feature_camera, image_box, peak_score,
    value_at,
};
use crate::input_spec::InputSpec;

impl CenterMethod for MonoDleConfig {
    const KEYPOINTS: &'static str = "projected centres of 3D boxes (MonoDLE)";

    fn features(&self) -> Features {
        let Self { input, width, backbone, head_channels, stem, norm, neck, .. } = *self;
        Features { input, width, backbone, head_channels, stem, norm, neck }
    }

    fn classes(&self) -> &[ClassReference] {
        &self.classes
    }

    fn has_error_bars(&self) -> bool {
        true
    }

    fn input_spec(&self) -> InputSpec {
        self.input_spec()
    }

    fn output_channels(&self) -> Vec<usize> {
        [self.classes.len()].into_iter().chain(REGRESSION_HEADS.map(|(_, channels)| channels)).collect()
    }

    /// Boxes that do not come out finite, have no size or lie behind the camera are left out.
    fn detections(&self, maps: &[TensorView<'_>], view: &View, options: &DecodeOptions) -> Vec<Detection> {
        let [heatmap, regression @ ..] = maps else { return Vec::new() };
        at_peaks(heatmap, &self.classes, options, |peak| {
            let (encoded, sigma_m) = encoded(regression, peak.cell);
            detection(self, peak, &encoded, sigma_m, view)
        })
    }
}

/// What stands at `cell` of the maps beside the heatmap, activations applied, and the standard deviation of its depth,
/// metres, virtual as the depth is.
fn encoded(maps: &[TensorView<'_>], cell: [usize; 2]) -> (Encoded, f64) {
    let at = |map: usize, channel: usize| maps.get(map).map_or(f64::NAN, |map| value_at(map, channel, cell));
    let [box_offset, box_size, depth, center_offset, dimensions, heading] = [0, 1, 2, 3, 4, 5];
    let pair = |map: usize| [at(map, 0), at(map, 1)];
    let encoded = Encoded {
        cell,
        depth_m: depth_from_raw(at(depth, 0)),
        heading: Heading::from_channels(|channel| at(heading, channel)),
        dimensions_hwl: [0, 1, 2].map(|channel| at(dimensions, channel)),
        center_offset: pair(center_offset),
        box_offset: pair(box_offset),
        box_size: pair(box_size),
    };
    (encoded, (at(depth, 1) / 2.0).exp())
}

/// The detection that stands at `peak`.
fn detection(config: &MonoDleConfig, peak: &Peak, encoded: &Encoded, sigma_m: f64, view: &View) -> Option<Detection> {
    let camera = feature_camera(&view.input_camera);
    let box3d = config.codec().decode(encoded, &camera);
    let numbers = box3d.location.iter().chain([&box3d.yaw]).chain(&encoded.dimensions_hwl);
    let is_there = numbers.into_iter().all(|number| number.is_finite()) && box3d.depth_m() > 0.0;
    if !(is_there && encoded.dimensions_hwl.iter().all(|side| *side > 0.0)) {
        return None;
    }
    let [width, height] = view.image_size.map(|side| side as f64);
    let box2d = image_box(&Codec::box2d(encoded), view).clamped(width, height);
    let class = &config.classes[peak.class];
    let sigma_m = sigma_m * depth_scale(config.depth_focal_px, &camera);
    let range_sigma_m = Some(sigma_m).filter(|sigma_m| sigma_m.is_finite() && *sigma_m > 0.0);
    let score = peak_score(peak, class, &box2d, view);
    let mut found = Detection { class: class.class.clone(), score, box2d, box3d, range_sigma_m };
    if config.certainty_in_score {
        found.score = found.place_score()?;
    }
    Some(found)
}
