//! Structured pruning: what is left is a network of the same kind.

use farsight_graph::graph::Role;
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{Msfe, Stem};
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_graph::model::NetworkConfig;
use farsight_graph::prune::{PruneError, prune};
use farsight_methods::smoke::SmokeConfig;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::{LOGITS, REGRESSION};

use farsight_methods::smoke::network::Backbone;

fn model(config: SmokeConfig) -> SmokeModel {
    let weights = initial_weights(&config.graph(), 7);
    SmokeModel::new(config, weights).unwrap()
}

fn configs() -> Vec<(String, SmokeConfig)> {
    let mut configs = Vec::new();
    for msfe in [Msfe::None, Msfe::A, Msfe::B, Msfe::C] {
        for (norm, neck, stem) in
            [(NormKind::Batch, NeckKind::Plain, Stem::Half), (NormKind::Group, NeckKind::Deformable, Stem::Full)]
        {
            let config = SmokeConfig { width: 0.5, norm, neck, stem, msfe, ..SmokeConfig::default() };
            configs.push((format!("{msfe:?} {norm:?} {neck:?}"), config));
        }
    }
    let (backbone, norm) = (Backbone::MobilenetV2, NormKind::Batch);
    let mobile = SmokeConfig { backbone, norm, msfe: Msfe::A, neck: NeckKind::Plain, ..SmokeConfig::default() };
    configs.push(("mobile".to_owned(), mobile));
    configs
}

#[test]
fn every_kind_of_network_stays_a_network() {
    for (name, config) in configs() {
        let whole = model(config.clone());
        let pruned = prune(&whole, 0.5).unwrap();
        for output in [LOGITS, REGRESSION] {
            let channels = |model: &SmokeModel| model.graph.nodes[model.graph.tap(output).unwrap()].channels;
            assert_eq!(channels(&pruned), channels(&whole), "{name}: {output}");
        }
        let size = |model: &SmokeModel| {
            let used = model.graph.parameters.iter().filter(|p| p.role != Role::Unused);
            used.map(farsight_graph::graph::Parameter::len).sum::<usize>() as f64
        };
        let share = size(&pruned) / size(&whole);
        // Group norm keeps its groups, so layers with one channel a group stay as they are.
        let limit = if config.norm == NormKind::Batch { 0.35 } else { 0.6 };
        assert!(share < limit, "{name}: {share:.2} of the parameters are left");
        let [width, height] = config.input;
        assert!(pruned.graph.shapes(width, height).is_some(), "{name}: maps that are added differ");
    }
}

#[test]
fn keeping_everything_changes_nothing() {
    for (name, config) in configs() {
        let whole = model(config);
        let kept = prune(&whole, 1.0).unwrap();
        for (tensor, values) in &kept.weights.tensors {
            assert_eq!(values, &whole.weights.tensors[tensor], "{name}: {tensor}");
        }
    }
}

#[test]
fn a_pruned_model_comes_back_from_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pruned.safetensors");
    let (_, config) = configs().remove(2);
    let pruned = prune(&model(config), 0.5).unwrap();
    pruned.write(&path).unwrap();
    let read = SmokeModel::read(&path).unwrap();
    assert!(read.is_pruned());
    assert_eq!(read.graph, pruned.graph);
    assert_eq!(read.weights.tensors, pruned.weights.tensors);
}

#[test]
fn tensors_that_do_not_fit_each_other_are_named() {
    let (_, config) = configs().remove(0);
    let pruned = prune(&model(config.clone()), 0.5).unwrap();
    let mut weights = pruned.weights;
    let name = "heads.predictor.class_head.0.weight";
    weights.tensors.get_mut(name).unwrap().shape[1] += 1;
    let error = SmokeModel::pruned(config, weights).unwrap_err().to_string();
    assert!(error.contains(name), "{error}");
}

#[test]
fn shares_that_are_none() {
    let whole = model(configs().remove(0).1);
    for keep in [0.0, -0.5, 1.01, f64::NAN] {
        assert!(matches!(prune(&whole, keep), Err(PruneError::Share(_))), "{keep}");
    }
}
