//! The configs that come with the sources are read as a training reads them.

use std::fs;
use std::path::Path;

use farsight_graph::model::NetworkConfig;
use farsight_methods::centernet3d::CenterNet3dConfig;
use farsight_methods::centernet3d::train::CenterNet3dRun;
use farsight_methods::plate_reader::PlateReaderConfig;
use farsight_methods::plate_reader::train::PlateReaderRun;
use farsight_methods::refiner::RefinerConfig;
use farsight_methods::refiner::train::RefinerRun;
use farsight_methods::smoke::SmokeConfig;
use farsight_methods::smoke::train::SmokeRun;
use farsight_methods::training::METHODS;
use farsight_train::config::{RunConfigError, read_method};

fn read(path: &Path) -> Result<(), RunConfigError> {
    match read_method(path, &METHODS.map(|(tag, _)| tag))?.as_str() {
        SmokeConfig::METHOD => SmokeRun::read(path).map(drop),
        CenterNet3dConfig::METHOD => CenterNet3dRun::read(path).map(drop),
        RefinerConfig::METHOD => RefinerRun::read(path).map(drop),
        PlateReaderConfig::METHOD => PlateReaderRun::read(path).map(drop),
        other => panic!("{}: no run of the method {other} is read here", path.display()),
    }
}

#[test]
fn every_config_of_a_network_can_be_trained() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let mut methods = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let is_config = path.extension().is_some_and(|extension| extension == "toml");
        // The others describe scenes, or what is measured.
        if is_config && fs::read_to_string(&path).unwrap().lines().any(|line| line.starts_with("method = ")) {
            read(&path).unwrap_or_else(|error| panic!("{error}"));
            methods.push(read_method(&path, &METHODS.map(|(tag, _)| tag)).unwrap());
        }
    }
    for method in ["smoke", "refiner", "plate_reader"] {
        assert!(methods.iter().any(|found| found == method), "no config of the method {method}");
    }
}
