//! What the page shows.

use image::RgbImage;

use super::scenes::ShownScene;
use super::worst::FrameErrors;
use crate::compare::Comparison;
use crate::oracle::OracleRow;
use crate::{Findings, Frame, Report};

/// What the page tells.
#[derive(Debug, Clone, Copy)]
pub struct Page<'a> {
    /// Where the results came from.
    pub title: &'a str,
    /// The figures.
    pub report: &'a Report,
    /// What was odd about the files.
    pub findings: &'a Findings,
    /// The comparison with other results.
    pub comparison: Option<&'a Comparison>,
    /// What the truth of some parts would bring.
    pub oracle: &'a [OracleRow],
    /// The frames with the largest errors.
    pub worst: &'a [ShownFrame],
    /// Scenes with what both results of the comparison found in them.
    pub scenes: &'a [ShownScene],
    /// What these results are called, ours and the others.
    pub names: [&'a str; 2],
}

/// A frame as the page shows it.
#[derive(Debug, Clone)]
pub struct ShownFrame {
    /// Its objects by error.
    pub worst: FrameErrors,
    /// All that is in its files.
    pub frame: Frame,
    /// Its image with detections and labels, where there is one.
    pub image: Option<RgbImage>,
}

/// A picture of the page.
pub(super) struct Picture {
    /// File name without extension.
    pub(super) name: String,
    /// The file.
    pub(super) png: Vec<u8>,
    /// What stands for it inside the page, when the file is too large for that.
    pub(super) jpeg: Option<Vec<u8>>,
}
