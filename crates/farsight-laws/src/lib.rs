//! What must hold for any bytes in a file that Farsight reads: nothing panics, what is accepted can be used, and what
//! is written can be read again.
//!
//! Each [`Target`] is a law with inputs to begin with. Three things feed them: the fuzzer of this crate
//! (`cargo xtask fuzz --minutes N`, any compiler), libFuzzer (`cargo +nightly fuzz run NAME`), and the tests, which
//! replay what is saved in `fuzz/corpus` and `fuzz/artifacts`.

#![allow(clippy::expect_used, reason = "a broken law is a finding")]
#![allow(clippy::missing_panics_doc, reason = "a panic is how a law says that it is broken")]

#[path = "../../farsight-data/tests/laws/mod.rs"]
mod images;
#[path = "../../farsight-methods/tests/laws/mod.rs"]
mod onnx;
#[path = "../../farsight-eval/tests/laws/mod.rs"]
mod rows;
// They are the program's, not the library's.
#[path = "../../farsight/src/json_array.rs"]
#[allow(dead_code, reason = "the program uses the rest")]
mod json_array;
#[path = "../../farsight/src/layout.rs"]
#[allow(dead_code, reason = "the program uses the rest")]
mod layout;

mod answers;
mod experiment;
mod film;
pub mod mutate;
pub mod readers;
mod request;
mod seeds;
mod shard;
mod text;
#[cfg(feature = "train")]
mod training;
mod weights;

/// A kind of file, what must hold of it, and inputs to begin with.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Its name, and that of its folder in `fuzz/corpus`.
    pub name: &'static str,
    /// Panics where the law is broken; whether the file is accepted.
    pub law: fn(&[u8]) -> bool,
    /// Good files of the kind, beside those in `fuzz/corpus`.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

const fn target(name: &'static str, law: fn(&[u8]) -> bool, seeds: fn() -> Vec<Vec<u8>>) -> Target {
    Target { name, law, seeds }
}

/// All kinds of files that are read.
pub const TARGETS: &[Target] = &[
    target("labels", rows::labels, seeds::labels),
    target("results", rows::results, seeds::results),
    target("calibration", rows::calibration, seeds::calibration),
    target("track_labels", text::track_labels, seeds::track_labels),
    target("ego", text::ego, seeds::ego),
    target("split", text::split, seeds::split),
    target("class_map", text::class_map, seeds::class_map),
    target("plates_rows", text::plates, seeds::plates_rows),
    target("scene_config", text::scene_config, seeds::scene_config),
    target("model_config", text::model_config, seeds::model_config),
    target("experiment", experiment::experiment, seeds::experiment),
    target("answers", answers::answers, seeds::answers),
    target("film", film::film, seeds::film),
    target("detector", weights::detector, seeds::detector),
    target("refiner", weights::refiner, seeds::refiner),
    target("plate_reader", weights::plate_reader, seeds::plate_reader),
    target("pickle", weights::pickle, seeds::pickle),
    target("tflite", weights::tflite, seeds::tflite),
    target("model", onnx::model, seeds::onnx),
    target("image", images::image, seeds::images),
    target("request", request::request, seeds::requests),
    #[cfg(feature = "train")]
    target("train_config", training::config, seeds::train_config),
    #[cfg(feature = "train")]
    target("checkpoint", training::checkpoint, seeds::checkpoint),
];

/// The target called `name`.
pub fn named(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.name == name)
}
