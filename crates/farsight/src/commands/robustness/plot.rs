//! The share of cars that is found against the severity, one line a condition.

use std::io;
use std::path::Path;

use anyhow::Result;
use farsight_eval::page::{Chart, Series};
use farsight_files::write_atomically;
use image::codecs::png::PngEncoder;

use super::Row;

/// One for each condition, in their order; colours that most eyes tell apart (Okabe and Ito's, and two greys).
const COLORS: [[u8; 3]; 10] = [
    [0, 114, 178],
    [230, 159, 0],
    [0, 158, 115],
    [204, 121, 167],
    [86, 180, 233],
    [213, 94, 0],
    [150, 140, 0],
    [90, 90, 90],
    [120, 60, 160],
    [160, 160, 160],
];

/// Draws `rows`, of which the first is of images as they are.
pub(super) fn write(path: &Path, rows: &[Row]) -> Result<()> {
    let Some((whole, worse)) = rows.split_first() else { return Ok(()) };
    let mut series: Vec<Series> = Vec::new();
    for row in worse {
        let point = [f64::from(row.severity), row.share()];
        if let Some(line) = series.iter_mut().find(|line| line.name == row.condition) {
            line.points.push(point);
        } else {
            let color = COLORS[series.len() % COLORS.len()];
            let points = vec![[0.0, whole.share()], point];
            series.push(Series { name: row.condition.clone(), color, points, band: Vec::new(), is_reference: false });
        }
    }
    let chart = Chart {
        title: "Cars found, Moderate, score from 0.5".to_owned(),
        x_label: "severity; 0 is the image as it is".to_owned(),
        y_label: "share found".to_owned(),
        x_end: 5.0,
        y_end: 1.0,
        series,
    };
    let drawn = chart.draw()?;
    Ok(write_atomically(path, |out| drawn.write_with_encoder(PngEncoder::new(out)).map_err(io::Error::other))?)
}
