//! Writes half-precision model files anew, with the hash that files carry; their tensors stay what they are.
//!
//! `cargo run -p farsight-graph --example add_hash -- models/*.safetensors`

use std::path::Path;

use farsight_graph::weights::{Weights, WeightsError};

fn main() -> Result<(), WeightsError> {
    std::env::args_os().skip(1).try_for_each(|path| {
        let path = Path::new(&path);
        Weights::read(path)?.write_half(path)
    })
}
