//! The switches of a model are independent of each other, and a wrong one says what is wrong.

use farsight_core::heatmap::HeatmapRule;
use farsight_core::input::Sampling;
use farsight_core::{ClassReference, DepthReference};
use farsight_core::{ObjectClass, RangeError, ScoreCalibration};
use farsight_graph::count::{count, total};
use farsight_graph::graph::Role;
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{Msfe, NeckKind, NormKind, Stem};
use farsight_graph::model::NetworkConfig;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::network::Backbone;
use farsight_methods::smoke::{LOGITS, REGRESSION};
use farsight_methods::smoke::{Quirks, SmokeConfig};

#[test]
fn every_combination_is_a_network_with_heads_at_stride_four() {
    for msfe in [Msfe::None, Msfe::A, Msfe::B, Msfe::C, Msfe::Control] {
        for norm in [NormKind::Group, NormKind::Batch] {
            for neck in [NeckKind::Deformable, NeckKind::Plain] {
                for (width, input) in [(1.0, [1280, 384]), (0.5, [640, 192]), (0.25, [96, 32])] {
                    let config = SmokeConfig { msfe, norm, neck, width, input, ..SmokeConfig::default() };
                    config.validate().unwrap();
                    let graph = config.graph();
                    let shapes = graph.shapes(input[0], input[1]).unwrap();
                    let shape = |name: &str| shapes[graph.tap(name).unwrap()];
                    assert_eq!(shape(LOGITS), [3, input[1] / 4, input[0] / 4]);
                    assert_eq!(shape(REGRESSION), [8, input[1] / 4, input[0] / 4]);
                }
            }
        }
    }
}

/// A feature pyramid on `MobileNetV2`.
fn mobile(config: SmokeConfig) -> SmokeConfig {
    on(Backbone::MobilenetV2, config)
}

fn on(backbone: Backbone, config: SmokeConfig) -> SmokeConfig {
    SmokeConfig { backbone, norm: NormKind::Batch, ..config }
}

#[test]
fn another_backbone_goes_with_every_neck_and_msfe() {
    for msfe in [Msfe::None, Msfe::A, Msfe::B, Msfe::C, Msfe::Control] {
        for neck in [NeckKind::Deformable, NeckKind::Plain] {
            for (width, input) in [(1.0, [640, 192]), (0.35, [96, 32])] {
                let config = mobile(SmokeConfig { msfe, neck, width, input, ..SmokeConfig::default() });
                config.validate().unwrap();
                let graph = config.graph();
                let shapes = graph.shapes(input[0], input[1]).unwrap();
                let shape = |name: &str| shapes[graph.tap(name).unwrap()];
                assert_eq!(shape(LOGITS), [3, input[1] / 4, input[0] / 4]);
                assert_eq!(shape(REGRESSION), [8, input[1] / 4, input[0] / 4]);
                let sides = [1, 2, 3, 4, 5].map(|level| input[0] / shape(&format!("level{level}"))[2]);
                assert_eq!(sides, [2, 4, 8, 16, 32]);
            }
        }
    }
}

#[test]
fn backbones_have_as_many_parameters_as_those_of_others() {
    // Of the whole network (torchvision; the table of EfficientNet-Lite's authors), and of the last map.
    let rows = [
        (Backbone::MobilenetV2, 3_504_872, 320),
        (Backbone::EfficientnetLite0, 4_652_008, 320),
        (Backbone::EfficientnetLite1, 5_416_680, 320),
        (Backbone::EfficientnetLite2, 6_092_072, 352),
    ];
    for (backbone, whole, last) in rows {
        let graph = on(backbone, SmokeConfig::default()).graph();
        let body = graph.parameters.iter().filter(|p| p.name.starts_with("backbone.body.") && p.role == Role::Learnt);
        let (classifier, last_convolution) = (1_281_000, last * 1280 + 2 * 1280);
        let expected = whole - classifier - last_convolution;
        assert_eq!(body.map(farsight_graph::graph::Parameter::len).sum::<usize>(), expected, "{backbone:?}");
    }
}

#[test]
fn a_config_of_dla34_is_written_as_before_there_were_others() {
    let text = serde_json::to_string(&SmokeConfig::default()).unwrap();
    let later = ["backbone", "neck_channels", "antialias", "min_radius"];
    assert!(later.iter().all(|field| !text.contains(field)), "{text}");
    let text = serde_json::to_string(&mobile(SmokeConfig::default())).unwrap();
    assert!(text.contains("\"backbone\":\"mobilenet_v2\""), "{text}");
}

#[test]
fn multiply_accumulates_are_those_of_the_specification() {
    let gmacs = |config: &SmokeConfig| {
        let stages = count(&config.graph(), 1280, 384).unwrap();
        let of = |name: &str| stages.iter().filter(|s| s.stage == name).map(|s| s.macs as f64 / 1e9).sum::<f64>();
        [
            of("base"),
            of("dla_up"),
            of("ida_up"),
            of("class_head") + of("regression_head"),
            of("msfe"),
            total(&stages).macs as f64 / 1e9,
        ]
    };
    let expect = |found: [f64; 6], expected: [f64; 6]| {
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 0.006, "{found:?} instead of {expected:?}");
        }
    };
    // The specification's 30.10 for the base, and 56.96 in all, count 0.126 for the two projections that are never
    // computed.
    expect(gmacs(&SmokeConfig::default()), [29.97, 13.27, 4.44, 9.15, 0.0, 56.83]);
    for (msfe, added) in [(Msfe::A, 1.864), (Msfe::B, 2.926), (Msfe::C, 1.124)] {
        let config = SmokeConfig { msfe, ..SmokeConfig::default() };
        expect(gmacs(&config), [29.97, 13.27, 4.44, 9.15, added, 56.83 + added]);
    }
}

#[test]
fn classes_are_free() {
    let tram =
        ClassReference { class: ObjectClass::Tram, dimensions_lhw: [16.0, 3.5, 2.5], heatmap_factor: 1.0, score: None };
    let config = SmokeConfig { classes: vec![tram], width: 0.25, ..SmokeConfig::default() };
    let graph = config.graph();
    assert_eq!(graph.nodes[graph.tap(LOGITS).unwrap()].channels, 1);
}

#[test]
fn wrong_values_say_what_was_found_and_what_was_expected() {
    let base = SmokeConfig::default;
    let class = base().classes[0].clone();
    let heights_px = [20.0, 10.0];
    let score = ScoreCalibration { peak: 1.0, height: 0.0, height_squared: 0.0, bias: 0.0, heights_px };
    let named = |name: &str| vec![ClassReference { class: ObjectClass::from_name(name), ..class.clone() }];
    let upside_down = ClassReference { score: Some(score), ..class.clone() };
    let no_fit = RangeError { bias: f64::INFINITY, depth: 1.0, score: 0.0, cut: 0.0 };
    let table = [
        (SmokeConfig { input: [1280, 380], ..base() }, "model.input is 1280x380; expected multiples of 32 pixels"),
        (SmokeConfig { width: 0.0, ..base() }, "model.width is 0; expected a factor above 0 and at most 8"),
        (SmokeConfig { neck_channels: Some(64), ..base() }, "model.neck_channels is for other backbones than dla34"),
        (
            SmokeConfig { norm: NormKind::Group, ..mobile(base()) },
            "model.norm is group; expected batch with this backbone",
        ),
        (
            SmokeConfig { level_channels: Some([16; 6]), ..mobile(base()) },
            "model.level_channels is for the backbone dla34; expected none",
        ),
        (SmokeConfig { stem: Stem::Half, ..mobile(base()) }, "model.stem is for the backbone dla34; expected none"),
        (
            SmokeConfig { head_channels: Some(20), ..base() },
            "model.head_channels is 20; expected one of the multiples of 16 from 16 to 4096",
        ),
        (
            SmokeConfig { level_channels: Some([16, 16, 16, 1 << 40, 16, 16]), ..base() },
            "model.level_channels is [16, 16, 16, 1099511627776, 16, 16]; expected six multiples of 16 from 16 to 4096",
        ),
        (SmokeConfig { classes: vec![], ..base() }, "model.classes is empty; expected at least one class"),
        (SmokeConfig { classes: vec![class.clone(), class.clone()], ..base() }, "model.classes names Car twice"),
        (
            SmokeConfig { classes: named("Carr"), ..base() },
            "model.classes names Carr; expected Car, as KITTI writes it",
        ),
        (SmokeConfig { classes: named("car"), ..base() }, "model.classes names car; expected Car, as KITTI writes it"),
        (SmokeConfig { classes: named("bus stop"), ..base() }, "model.classes names \"bus stop\"; expected one word"),
        (SmokeConfig { classes: named(""), ..base() }, "model.classes names \"\"; expected one word"),
        (
            SmokeConfig { classes: vec![upside_down], ..base() },
            "model.classes has Car with a score that no fit gives; expected finite numbers and heights_px with 0 < smallest <= largest",
        ),
        (
            SmokeConfig { depth: DepthReference { std_m: 0.0, ..base().depth }, ..base() },
            "model.depth has a mean of 28.01 m and a deviation of 0 m; expected a positive deviation and at most 10000 m of each",
        ),
        (
            SmokeConfig { depth: DepthReference { error: Some(no_fit), ..base().depth }, ..base() },
            "model.depth.error has bias inf, depth 1, score 0 and cut 0; expected the numbers of a fit",
        ),
        (
            SmokeConfig { heatmap: HeatmapRule::Dynamic { alpha: -1.0, min_radius: 1.0, max_radius: 2.0 }, ..base() },
            "model.heatmap heatmap alpha is -1; expected a positive number",
        ),
        (
            SmokeConfig { heatmap: HeatmapRule::Fixed { radius: 1e5, min_radius: 0.0 }, ..base() },
            "model.heatmap heatmap radius is 100000; expected 0 to 10000 cells",
        ),
        (
            SmokeConfig { heatmap: HeatmapRule::CornerNet { min_overlap: 0.7, min_radius: -1.0 }, ..base() },
            "model.heatmap heatmap min_radius is -1; expected 0 to 10000 cells",
        ),
        (
            SmokeConfig {
                antialias: true,
                quirks: Quirks { sampling: Sampling::HalfPixel, ..Quirks::default() },
                ..base()
            },
            "model.antialias is true; expected quirks.sampling to be pixel_exact with it",
        ),
    ];
    for (config, expected) in table {
        assert_eq!(config.validate().unwrap_err().to_string(), expected);
    }
}

#[test]
fn a_model_comes_back_from_its_file_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let config = SmokeConfig { width: 0.25, msfe: Msfe::C, norm: NormKind::Batch, ..SmokeConfig::default() };
    let weights = initial_weights(&config.graph(), 3);
    let model = SmokeModel::new(config, weights).unwrap();
    model.write(&path).unwrap();
    let back = SmokeModel::read(&path).unwrap();
    assert_eq!(back.config, model.config);
    assert!(back.weights.tensors == model.weights.tensors);
}

#[test]
fn a_block_more_changes_no_initial_weight_elsewhere() {
    let weights =
        |msfe| initial_weights(&SmokeConfig { msfe, width: 0.25, ..SmokeConfig::default() }.graph(), 5).tensors;
    let (plain, with_msfe) = (weights(Msfe::None), weights(Msfe::A));
    assert!(plain.iter().all(|(name, tensor)| with_msfe[name] == *tensor));
}
