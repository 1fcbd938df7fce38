//! The native module `farsight._farsight`: pipelines, pictures, evaluation and rendered scenes for the Python package
//! `farsight`, whose classes are in `python/farsight`.
//!
//! It is a client of [`farsight::Pipeline`]. Images cross the border as bytes, answers as the JSON of `farsight range`:
//! Python reads the same digits that the program writes. Whatever takes long runs without Python's lock.

#![allow(clippy::needless_pass_by_value, reason = "arguments from Python come as values of their own")]

mod camera;
mod errors;
mod evaluation;
mod picture;
mod pipeline;
mod scene;
mod track;

/// What the Python package is made of.
#[pyo3::pymodule]
mod _farsight {
    use pyo3::prelude::{Bound, PyModule, PyModuleMethods as _, PyResult};

    #[pymodule_export]
    use super::evaluation::{evaluate, write_results};
    #[pymodule_export]
    use super::picture::{draw, png};
    #[pymodule_export]
    use super::pipeline::Pipeline;
    #[pymodule_export]
    use super::scene::render;
    #[pymodule_export]
    use super::track::Video;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", farsight::VERSION)
    }
}
