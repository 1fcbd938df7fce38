//! What an experiment with the paper's changes rests on: depths that zooms do not contradict, floors for every rule,
//! the annotated box, factors of classes, and a control of MSFE's cost.

use farsight_core::heatmap::HeatmapRule;
use farsight_core::{Box2d, Box3d, Camera, ClassReference, DepthReference, Dimensions, Label, ObjectClass};
use farsight_data::AugmentationConfig;
use farsight_graph::count::{count, total};
use farsight_graph::graph::Role;
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{Msfe, NeckKind, NormKind};
use farsight_graph::model::NetworkConfig;
use farsight_methods::smoke::targets::{HeatmapBox, TargetRules, Targets, feature_camera};
use farsight_methods::smoke::{Codec, SmokeConfig};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_pcg::Pcg64;

/// KITTI's focal length in an input 640 pixels wide.
const FOCAL_PX: f64 = 371.8;

fn car(location: [f64; 3], box2d: Box2d) -> Label {
    let box3d = Box3d { dimensions: Dimensions { height: 1.5, width: 1.6, length: 3.9 }, location, yaw: 0.3 };
    Label { class: ObjectClass::Car, truncation: 0.0, occlusion: 0, alpha: box3d.alpha(), box2d, box3d }
}

/// The height of a car in pixels of the input times the depth that the network is to answer for it, under a drawn
/// transform of the image.
fn height_times_target(codec: &Codec, z: f64, seed: u64) -> f64 {
    let size = [1242, 375];
    let camera = Camera::from_intrinsics(721.5377, 721.5377, 609.5593, 172.854).unwrap();
    let rules = SmokeConfig { input: [640, 192], ..SmokeConfig::default() }.input_rules();
    let every_image = AugmentationConfig { shift_scale_probability: 1.0, ..AugmentationConfig::default() };
    let seen = every_image.draw(&mut Pcg64::seed_from_u64(seed), size, &rules).camera(&camera, size[0]);
    let [top, bottom] = [0.0, 1.5].map(|y| seen.pixel_from_point([0.0, y, z]).unwrap()[1]);
    let label = car([0.0, 1.5, z], Box2d::new(0.0, 0.0, 10.0, 10.0));
    let encoded = codec.encode(&label.box3d, 0, &feature_camera(&seen)).unwrap();
    (bottom - top) * (encoded.regression.depth * codec.depth.std_m + codec.depth.mean_m)
}

proptest! {
    #[test]
    fn what_a_zoom_shows_is_what_its_target_says(z in 3.0..80.0, seed in any::<u64>()) {
        let depth = DepthReference { focal_px: Some(FOCAL_PX), ..DepthReference::KITTI };
        let codec = Codec { classes: ClassReference::smoke(), depth };
        let found = height_times_target(&codec, z, seed);
        // Half the height, twice the depth: whatever the window, as for any pinhole.
        prop_assert!((found - 1.5 * FOCAL_PX).abs() < 1e-6, "{}", found);
    }
}

#[test]
fn without_virtual_depth_zooms_contradict_each_other() {
    let codec = Codec { classes: ClassReference::smoke(), depth: DepthReference::KITTI };
    let found: Vec<f64> = (0..50).map(|seed| height_times_target(&codec, 20.0, seed)).collect();
    let largest = found.iter().copied().fold(0.0, f64::max);
    let smallest = found.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(largest > 1.5 * smallest, "{smallest} to {largest}");
}

#[test]
fn no_config_teaches_depths_that_contradict_each_other() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs");
    let mut detectors = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let Ok(text) = std::fs::read_to_string(&path) else { continue };
        let Ok(config) = text.parse::<toml::Table>() else { continue };
        let value = |table: &str, field: &str| config.get(table).and_then(|table| table.get(field)).cloned();
        let is_virtual = match config.get("method").and_then(toml::Value::as_str) {
            Some("smoke") => value("model", "depth").is_some_and(|depth| depth.get("focal_px").is_some()),
            Some("centernet3d" | "monodle") => value("model", "depth_focal_px").is_some(),
            _ => continue,
        };
        if !config.contains_key("model") {
            // A recipe for a network that is there already, with its own depth.
            continue;
        }
        detectors += 1;
        let probability =
            value("augmentation", "shift_scale_probability").or(value("augmentation", "window_probability"));
        let scales = probability.and_then(|value| value.as_float()) != Some(0.0);
        let is_masked = value("augmentation", "mask_scaled_regression") == Some(toml::Value::Boolean(true));
        assert!(is_virtual || is_masked || !scales, "{}: zooms without virtual depth or mask", path.display());
    }
    assert!(detectors >= 8, "{detectors}");
}

#[test]
fn every_rule_has_a_floor_and_works_without() {
    let rules = |min_radius: f64| {
        [
            HeatmapRule::Fixed { radius: 0.0, min_radius },
            HeatmapRule::CornerNet { min_overlap: 0.7, min_radius },
            HeatmapRule::CornerNetOriginal { min_overlap: 0.7, min_radius },
            HeatmapRule::Dynamic { alpha: 0.12, min_radius, max_radius: 16.0 },
            HeatmapRule::DynamicInteger { alpha: 0.12, min_radius, max_radius: 16.0 },
        ]
    };
    for (rule, with_floor) in rules(0.0).into_iter().zip(rules(1.5)) {
        assert!(rule.problem().is_none() && with_floor.problem().is_none());
        // A car of two cells by one, and none at all.
        for (width, height) in [(2.0, 1.0), (0.0, 0.0)] {
            assert!(rule.gaussian(width, height, 1.0).radius < 0.9, "{rule:?}");
            assert!((with_floor.gaussian(width, height, 1.0).radius - 1.5).abs() < 1e-12, "{with_floor:?}");
        }
        let large = |rule: HeatmapRule| rule.gaussian(60.0, 60.0, 1.0).radius;
        let is_fixed = matches!(rule, HeatmapRule::Fixed { .. });
        assert!(is_fixed || (large(rule) - large(with_floor)).abs() < 1e-12, "{rule:?}");
    }
}

#[test]
fn a_floor_of_zero_is_not_written_and_one_above_comes_back() {
    let written = |rule: &HeatmapRule| toml::to_string(rule).unwrap();
    assert_eq!(written(&HeatmapRule::SMOKE), "rule = \"corner_net\"\nmin_overlap = 0.7\n");
    let rule = HeatmapRule::Fixed { radius: 1.0, min_radius: 0.5 };
    assert_eq!(toml::from_str::<HeatmapRule>(&written(&rule)).unwrap(), rule);
}

fn targets(heatmap_box: HeatmapBox, heatmap: HeatmapRule, factor: f64, labels: &[Label]) -> Targets {
    let mut classes = ClassReference::smoke();
    classes[0].heatmap_factor = factor;
    let rules = TargetRules { codec: Codec { classes, depth: DepthReference::KITTI }, heatmap, heatmap_box };
    rules.targets(labels, &Camera::from_intrinsics(372.0, 372.0, 320.0, 96.0).unwrap(), [640, 192])
}

/// The value one cell beside the peak, and from it the radius of the rule.
fn radius_of(targets: &Targets) -> f64 {
    let [column, row] = targets.objects[0].cell;
    let beside = f64::from(targets.heatmap[row * targets.map_size[0] + column + 1]);
    let sigma = (-0.5 / beside.ln()).sqrt();
    (6.0 * sigma - 1.0) / 2.0
}

#[test]
fn the_annotated_box_decides_where_it_is_asked_for_and_a_factor_scales_alpha() {
    // 160 x 90 pixels are 40 x 22.5 cells: sqrt(wh) is 30.
    let label = car([0.0, 1.6, 20.0], Box2d::new(240.0, 50.0, 400.0, 140.0));
    let rule = HeatmapRule::Dynamic { alpha: 0.1, min_radius: 0.0, max_radius: 16.0 };
    let radius =
        |heatmap_box, rule, factor| radius_of(&targets(heatmap_box, rule, factor, std::slice::from_ref(&label)));
    assert!((radius(HeatmapBox::Annotated, rule, 1.0) - 3.0).abs() < 1e-4);
    assert!((radius(HeatmapBox::Annotated, rule, 0.5) - 1.5).abs() < 1e-4);
    let projected = label.box3d.projected(&Camera::from_intrinsics(93.0, 93.0, 80.0, 24.0).unwrap()).unwrap();
    let expected = 0.1 * (projected.width() * projected.height()).sqrt();
    assert!((radius(HeatmapBox::Projected, rule, 1.0) - expected).abs() < 1e-4);
    let corner_net = HeatmapRule::CornerNet { min_overlap: 0.7, min_radius: 1.0 };
    let [once, twice] = [1.0, 2.0].map(|factor| radius(HeatmapBox::Annotated, corner_net, factor));
    assert!((once - twice).abs() < 1e-9, "factors are of DGH");
}

fn half_width(msfe: Msfe) -> SmokeConfig {
    SmokeConfig {
        msfe,
        input: [640, 192],
        width: 0.5,
        norm: NormKind::Batch,
        neck: NeckKind::Plain,
        ..SmokeConfig::default()
    }
}

#[test]
fn the_control_costs_what_design_a_costs_and_begins_as_silent() {
    let costs = |msfe: Msfe| {
        let graph = half_width(msfe).graph();
        let learnt = graph.parameters.iter().filter(|parameter| parameter.role == Role::Learnt);
        let parameters: usize = learnt.map(farsight_graph::graph::Parameter::len).sum();
        [parameters as f64, total(&count(&graph, 640, 192).unwrap()).macs as f64]
    };
    let [none, a, control] = [Msfe::None, Msfe::A, Msfe::Control].map(costs);
    for i in 0..2 {
        let share = (control[i] - none[i]) / (a[i] - none[i]);
        assert!((0.95..=1.0).contains(&share), "{share} of what MSFE adds");
    }
    let graph = half_width(Msfe::Control).graph();
    let weights = initial_weights(&graph, 1);
    for i in 3..=5 {
        let closing = &weights.tensors[&format!("backbone.body.msfe.p{i}.back_norm.weight")];
        assert!(closing.values.iter().all(|value| *value == 0.0));
    }
}
