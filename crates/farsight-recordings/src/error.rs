//! Why there is no recording.

use thiserror::Error;

/// A recording that could not be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The file.
    #[error("MCAP: {0}")]
    Mcap(#[from] mcap::McapError),
    /// An image that JPEG cannot hold.
    #[error("image: {0}")]
    Image(#[from] image::ImageError),
    /// A message that did not become bytes.
    #[error("message of {topic}: {problem}")]
    Message {
        /// Where it was to go.
        topic: &'static str,
        /// What went wrong.
        problem: String,
    },
    /// A time that the format has no place for.
    #[error("time of {0} seconds; expected one from 0 to 136 years")]
    Time(f64),
    /// What rerun says.
    #[error("rerun: {0}")]
    Rerun(String),
    /// There are no recordings of rerun in this build.
    #[error("this build has no rerun; expected one with it: cargo install --path crates/farsight --features rerun")]
    NoRerun,
}
