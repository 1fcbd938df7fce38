//! The plate reader's network and its file.

use farsight_core::DepthFusion;
use farsight_graph::init::initial_weights;
use farsight_graph::model::NetworkConfig;
use farsight_methods::plate_reader::geometry::{ANSWER_CHANNELS, INPUT_CHANNELS};
use farsight_methods::plate_reader::{PlateReaderConfig, PlateReaderModel};
use farsight_methods::refiner::RefinerModel;
use farsight_methods::roi::ANSWER;

#[test]
fn one_answer_comes_out_of_a_cut_out_of_any_size_that_is_allowed() {
    for (side, hidden) in [(8, 4), (72, 128), (80, 32)] {
        let config = PlateReaderConfig { side, hidden, ..PlateReaderConfig::default() };
        assert_eq!(config.problem(), None);
        let graph = config.graph();
        assert_eq!(graph.nodes[0].channels, INPUT_CHANNELS);
        let shapes = graph.shapes(side, side).unwrap();
        assert_eq!(shapes[graph.tap(ANSWER).unwrap()], [ANSWER_CHANNELS, 1, 1], "{side} pixels");
    }
}

#[test]
fn a_config_of_no_network_is_told() {
    let depths = DepthFusion { depth_factor: 0.0, ..DepthFusion::default() };
    for (config, expected) in [
        (PlateReaderConfig { side: 76, ..PlateReaderConfig::default() }, "model.side is 76; expected a multiple of 8"),
        (PlateReaderConfig { hidden: 0, ..PlateReaderConfig::default() }, "has 0; expected 1 to 4096"),
        (PlateReaderConfig { depths, ..PlateReaderConfig::default() }, "model.depths is"),
    ] {
        let problem = config.problem().unwrap();
        assert!(problem.contains(expected), "{problem}");
    }
}

#[test]
fn a_file_gives_back_what_was_written_and_is_no_refiner() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plates.safetensors");
    let depths = DepthFusion {
        depth_factor: 1.01,
        error_factor: 1.2,
        correlation: 0.1,
        joint_error_factor: 0.9,
        joint_error_power: 1.4,
        interval_sigmas: [0.6, 1.8],
        ..DepthFusion::default()
    };
    let config = PlateReaderConfig { side: 16, channels: [8; 3], hidden: 16, depths };
    let written = PlateReaderModel::new(config.clone(), initial_weights(&config.graph(), 1)).unwrap();
    written.write(&path).unwrap();
    assert!(PlateReaderModel::is_one(&path) && !RefinerModel::is_one(&path));
    assert_eq!(PlateReaderModel::read(&path).unwrap().config, written.config);
    let told = RefinerModel::read(&path).unwrap_err().to_string();
    assert!(told.contains("plates.safetensors") && told.contains("expected a refiner"), "{told}");
}
