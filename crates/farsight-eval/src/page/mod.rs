//! The report page: one HTML file that holds everything, and its charts as PNG files beside it.
//!
//! `contents` says what the page is made of, `charts` which charts it has, `chart` draws one, `html` is the text,
//! `write` puts it on the disk. All figures come from the [`Report`](crate::Report); none is computed here.

mod chart;
mod charts;
mod contents;
mod error;
mod html;
mod scenes;
mod worst;
mod write;

pub use chart::{Chart, Series};
pub use contents::{Page, ShownFrame};
pub use error::PageError;
pub use scenes::{ChosenScene, SHOWN_SCORE, SceneKind, ShownScene, chosen_scenes};
pub use worst::{FrameErrors, frame_of, worst_frames};
