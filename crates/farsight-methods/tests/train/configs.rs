//! The configs that come with the sources are read as a training reads them.

use std::fs;
use std::path::Path;

use farsight_methods::training::{TAGS, check};
use farsight_train::config::method_of;

#[test]
fn every_config_of_a_network_can_be_trained() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let mut methods = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let is_config = path.extension().is_some_and(|extension| extension == "toml");
        // The others describe scenes, or what is measured.
        if is_config && fs::read_to_string(&path).unwrap().lines().any(|line| line.starts_with("method = ")) {
            let table = fs::read_to_string(&path).unwrap().parse().unwrap();
            check(&table, &path).unwrap_or_else(|error| panic!("{error}"));
            methods.push(method_of(&table, &TAGS, &path).unwrap());
        }
    }
    for method in TAGS {
        assert!(methods.iter().any(|found| found == method), "no config of the method {method}");
    }
}
