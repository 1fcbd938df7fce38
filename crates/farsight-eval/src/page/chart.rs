//! A line chart with bands.

use std::sync::Once;

use image::RgbImage;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use super::error::PageError;

/// Size of a chart, pixels.
const SIZE: (u32, u32) = (760, 460);

/// The name under which the compiled-in font is known to the drawing library.
const FONT: &str = "sans-serif";

/// How strongly a band is tinted.
const BAND_OPACITY: f64 = 0.18;

/// What to draw.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Heading.
    pub title: String,
    /// Name and unit of the horizontal axis.
    pub x_label: String,
    /// Name and unit of the vertical axis.
    pub y_label: String,
    /// Where the horizontal axis ends; it starts at 0.
    pub x_end: f64,
    /// Where the vertical axis ends; it starts at 0.
    pub y_end: f64,
    /// Where the legend hides least.
    pub legend: LegendPosition,
    /// The lines.
    pub series: Vec<Series>,
}

/// A corner of a chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LegendPosition {
    /// For lines that rise.
    UpperLeft,
    /// For lines that fall.
    LowerLeft,
}

/// One line.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// Red, green, blue.
    pub color: [u8; 3],
    /// Points from left to right.
    pub points: Vec<[f64; 2]>,
    /// Lower and upper end of an interval at each point; empty without intervals.
    pub band: Vec<[f64; 2]>,
}

impl Chart {
    /// Draws the chart.
    ///
    /// # Errors
    /// When the drawing library fails.
    pub fn draw(&self) -> Result<RgbImage, PageError> {
        static FONT_KNOWN: Once = Once::new();
        // A font that is refused shows as an error of the first text drawn.
        FONT_KNOWN.call_once(|| drop(register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)));

        let mut image = RgbImage::new(SIZE.0, SIZE.1);
        let drawn = self.draw_on(&mut image).map_err(|error| error.to_string());
        drawn.map_err(|problem| PageError::Draw { title: self.title.clone(), problem })?;
        Ok(image)
    }

    fn draw_on(&self, image: &mut RgbImage) -> Result<(), Box<dyn std::error::Error + '_>> {
        let area = BitMapBackend::with_buffer(image, SIZE).into_drawing_area();
        area.fill(&WHITE).map_err(|e| e.to_string())?;
        let mut chart = ChartBuilder::on(&area)
            .margin(14)
            .caption(&self.title, (FONT, 22))
            .x_label_area_size(46)
            .y_label_area_size(62)
            .build_cartesian_2d(0.0..self.x_end, 0.0..self.y_end)
            .map_err(|e| e.to_string())?;
        chart
            .configure_mesh()
            .x_desc(&self.x_label)
            .y_desc(&self.y_label)
            .x_label_formatter(&|x| if self.x_end > 1.0 { format!("{x:.0}") } else { format!("{x:.1}") })
            .label_style((FONT, 15))
            .axis_desc_style((FONT, 16))
            .light_line_style(WHITE)
            .bold_line_style(RGBColor(225, 225, 225))
            .draw()
            .map_err(|e| e.to_string())?;
        for series in &self.series {
            let [red, green, blue] = series.color;
            let color = RGBColor(red, green, blue);
            let edge = |end: usize| series.points.iter().zip(&series.band).map(move |(p, band)| (p[0], band[end]));
            let outline: Vec<_> = edge(0).chain(edge(1).rev()).collect();
            chart
                .draw_series(std::iter::once(Polygon::new(outline, color.mix(BAND_OPACITY))))
                .map_err(|e| e.to_string())?;
            let points = series.points.iter().map(|p| (p[0], p[1]));
            chart
                .draw_series(LineSeries::new(points.clone(), color.stroke_width(2)))
                .map_err(|e| e.to_string())?
                .label(&series.name)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], color.stroke_width(2)));
            if series.points.len() < 20 {
                chart
                    .draw_series(points.map(|point| Circle::new(point, 3, color.filled())))
                    .map_err(|e| e.to_string())?;
            }
        }
        chart
            .configure_series_labels()
            .position(match self.legend {
                LegendPosition::UpperLeft => SeriesLabelPosition::UpperLeft,
                LegendPosition::LowerLeft => SeriesLabelPosition::LowerLeft,
            })
            .background_style(WHITE.mix(0.85))
            .border_style(RGBColor(200, 200, 200))
            .label_font((FONT, 15))
            .draw()
            .map_err(|e| e.to_string())?;
        area.present().map_err(|e| e.to_string())?;
        Ok(())
    }
}
