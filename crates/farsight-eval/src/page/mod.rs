//! The report page: one HTML file that holds everything, and its charts as PNG files beside it.

mod chart;
mod charts;
mod html;
mod worst;

use std::path::{Path, PathBuf};
use std::{fs, io};

use farsight_files::{DurableError, write_quickly};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use thiserror::Error;

use crate::ranging::RangingComparison;
use crate::{Findings, Frame, Report};

pub use chart::{Chart, Corner, Series};
pub use worst::{WorstFrame, worst_frames};

/// Quality of the photographs inside the page, of 100; the PNG files beside it lose nothing.
const JPEG_QUALITY: u8 = 80;

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
    pub comparison: Option<&'a RangingComparison>,
    /// The frames with the largest errors.
    pub worst: &'a [ShownFrame],
}

/// A frame as the page shows it.
#[derive(Debug, Clone)]
pub struct ShownFrame {
    /// Its objects by error.
    pub worst: WorstFrame,
    /// All that is in its files.
    pub frame: Frame,
    /// Its image with detections and labels, where there is one.
    pub image: Option<RgbImage>,
}

/// A page that could not be made.
#[derive(Debug, Error)]
pub enum PageError {
    /// A chart cannot be drawn.
    #[error("chart \"{title}\" cannot be drawn: {problem}")]
    Draw {
        /// Heading of the chart.
        title: String,
        /// What the drawing library says.
        problem: String,
    },
    /// A picture cannot be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Encode(#[from] image::ImageError),
    /// The folder cannot be made.
    #[error("{}: this folder cannot be made: {source}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] DurableError),
}

/// A picture of the page.
struct Picture {
    /// File name without extension.
    name: String,
    /// The file.
    png: Vec<u8>,
    /// What stands for it inside the page, when the file is too large for that.
    jpeg: Option<Vec<u8>>,
}

impl Page<'_> {
    /// Writes `index.html` and the pictures into `folder`, which is made if it is not there. Each file is there whole or not at all.
    ///
    /// # Errors
    /// When a picture cannot be made or a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, PageError> {
        fs::create_dir_all(folder).map_err(|source| PageError::Folder { path: folder.to_owned(), source })?;
        let charts = charts::charts(self.report);
        let charts: Vec<_> = charts
            .iter()
            .map(|(name, chart)| Ok(Picture { name: name.clone(), png: png(&chart.draw()?)?, jpeg: None }))
            .collect::<Result<_, PageError>>()?;
        let worst = self.worst.iter().map(|shown| {
            let name = format!("worst_{}", shown.worst.id);
            let picture = |image| Ok::<_, PageError>(Picture { name, png: png(image)?, jpeg: Some(jpeg(image)?) });
            shown.image.as_ref().map(picture).transpose()
        });
        let worst: Vec<_> = worst.collect::<Result<_, _>>()?;
        for picture in charts.iter().chain(worst.iter().flatten()) {
            write(&folder.join(format!("{}.png", picture.name)), &picture.png)?;
        }
        let page = folder.join("index.html");
        write(&page, html::page(self, &charts, &worst).as_bytes())?;
        Ok(page)
    }
}

fn png(image: &RgbImage) -> Result<Vec<u8>, PageError> {
    let mut bytes = io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

fn jpeg(image: &RgbImage) -> Result<Vec<u8>, PageError> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).encode_image(image)?;
    Ok(bytes)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), PageError> {
    Ok(write_quickly(path, |file| file.write_all(bytes))?)
}
