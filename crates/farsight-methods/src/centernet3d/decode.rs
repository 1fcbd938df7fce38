//! From maps to detections.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::peaks::Peak;
use farsight_core::{ClassReference, Detection};
use farsight_runtime::TensorView;

use super::CenterNet3dConfig;
use super::codec::{Codec, Encoded, HeadingBin};
use super::network::REGRESSION_HEADS;
use crate::center_map::{
    CenterMethod, Features, at_peaks, depth_from_raw, feature_camera, image_box, peak_score, value_at,
};
use crate::input_spec::InputSpec;

impl CenterMethod for CenterNet3dConfig {
    const KEYPOINTS: &'static str = "centres of 2D boxes (CenterNet)";

    fn features(&self) -> Features {
        let Self { input, width, backbone, head_channels, stem, norm, neck, .. } = *self;
        Features { input, width, backbone, head_channels, stem, norm, neck }
    }

    fn classes(&self) -> &[ClassReference] {
        &self.classes
    }

    fn has_error_bars(&self) -> bool {
        self.error.is_some()
    }

    fn input_spec(&self) -> InputSpec {
        self.input_spec()
    }

    fn output_channels(&self) -> Vec<usize> {
        [self.classes.len()].into_iter().chain(REGRESSION_HEADS.map(|(_, channels)| channels)).collect()
    }

    /// Boxes that do not come out finite or lie behind the camera are left out.
    fn detections(&self, maps: &[TensorView<'_>], view: &View, options: &DecodeOptions) -> Vec<Detection> {
        let [heatmap, regression @ ..] = maps else { return Vec::new() };
        at_peaks(heatmap, &self.classes, options, |peak| detection(self, peak, &encoded(regression, peak.cell), view))
    }
}

/// What stands at `cell` of the maps beside the heatmap, activations applied.
fn encoded(maps: &[TensorView<'_>], cell: [usize; 2]) -> Encoded {
    let at = |map: usize, channel: usize| maps.get(map).map_or(f64::NAN, |map| value_at(map, channel, cell));
    let [depth, rotation, dimensions, size, offset] = [0, 1, 2, 3, 4];
    let bin = |first: usize| HeadingBin {
        score: at(rotation, first + 1) - at(rotation, first),
        sin_cos: [at(rotation, first + 2), at(rotation, first + 3)],
    };
    Encoded {
        cell,
        depth_m: depth_from_raw(at(depth, 0)),
        bins: [bin(0), bin(4)],
        dimensions_hwl: [0, 1, 2].map(|channel| at(dimensions, channel)),
        size: [0, 1].map(|channel| at(size, channel)),
        offset: [0, 1].map(|channel| at(offset, channel)),
    }
}

/// The detection that stands at `peak`.
fn detection(config: &CenterNet3dConfig, peak: &Peak, encoded: &Encoded, view: &View) -> Option<Detection> {
    let box3d = config.codec().decode(encoded, &feature_camera(&view.input_camera));
    let numbers = box3d.location.iter().chain([&box3d.yaw]).chain(&encoded.dimensions_hwl);
    let is_there = numbers.into_iter().all(|number| number.is_finite()) && box3d.depth_m() > 0.0;
    if !(is_there && encoded.dimensions_hwl.iter().all(|side| *side > 0.0)) {
        return None;
    }
    let [width, height] = view.image_size.map(|side| side as f64);
    let box2d = image_box(&Codec::box2d(encoded), view).clamped(width, height);
    let class = &config.classes[peak.class];
    let score = peak_score(peak, class, &box2d, view);
    let scale = config.depth_focal_px.map_or(1.0, |focal_px| view.input_camera.focal_y() / focal_px);
    let depth_m = box3d.depth_m();
    let sigma_m = config.error.map(|error| error.sigma_m(depth_m / scale, score, view.cuts(&box2d)) * scale);
    let range_sigma_m = sigma_m.filter(|sigma_m| sigma_m.is_finite());
    Some(Detection { class: class.class.clone(), score, box2d, box3d, range_sigma_m })
}
