//! A line chart with bands.

use std::sync::Once;

use image::RgbImage;
use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};

use super::error::PageError;

/// What the drawing library says of a backend.
type DrawingError<DB> = DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>;

/// Size of a chart, pixels.
const SIZE: (u32, u32) = (760, 480);

/// Height of heading and a legend of one row above the plot, pixels. The legend stands outside the plot, so it covers
/// no line.
pub(super) const HEADER_PX: u32 = 72;

/// Rows of heading and legend within the header, pixels from above; a legend may have more rows, and keeps away from
/// the sides.
const HEADING_Y: i32 = 14;
const LEGEND_Y: i32 = 50;
const LEGEND_ROW_PX: u32 = 22;
const LEGEND_MARGIN_PX: i32 = 14;

/// Length of the line in a legend entry, and the gaps after it and after the entry, pixels.
const LEGEND_LINE_PX: i32 = 22;
const LEGEND_GAPS_PX: [i32; 2] = [7, 26];

/// Dashes of a dashed line and the gaps between them, pixels.
const DASH_PX: [u32; 2] = [7, 5];

/// The name under which the compiled-in font is known to the drawing library.
const FONT: &str = "sans-serif";

/// How strongly a band is tinted.
const BAND_OPACITY: f64 = 0.18;

/// Series side by side in the legend, each with the width of its entry without the gap after it, pixels.
type LegendRow<'a> = Vec<(&'a Series, i32)>;

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
    /// The lines.
    pub series: Vec<Series>,
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
    /// Dashed, and without marks at the points: what others are compared with.
    pub is_reference: bool,
}

impl Chart {
    /// The number at a line of the horizontal axis: whole ones where the axis is longer than 1.
    fn x_text(&self, x: f64) -> String {
        let is_between = (x - x.round()).abs() > 1e-6;
        match self.x_end > 1.0 {
            true if is_between => String::new(),
            true => format!("{x:.0}"),
            false => format!("{x:.1}"),
        }
    }

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
        let legend = self.legend_rows(&area).map_err(|e| e.to_string())?;
        let more_rows = legend.len().saturating_sub(1) as u32;
        let (header, body) = area.split_vertically(HEADER_PX + more_rows * LEGEND_ROW_PX);
        self.draw_header(&header, &legend).map_err(|e| e.to_string())?;
        let mut chart = ChartBuilder::on(&body)
            .margin(14)
            .margin_top(4)
            .x_label_area_size(46)
            .y_label_area_size(62)
            .build_cartesian_2d(0.0..self.x_end, 0.0..self.y_end)
            .map_err(|e| e.to_string())?;
        chart
            .configure_mesh()
            .x_desc(&self.x_label)
            .y_desc(&self.y_label)
            .x_label_formatter(&|x| self.x_text(*x))
            .label_style((FONT, 15))
            .axis_desc_style((FONT, 16))
            .light_line_style(WHITE)
            .bold_line_style(RGBColor(225, 225, 225))
            .draw()
            .map_err(|e| e.to_string())?;
        for series in &self.series {
            let color = series.rgb();
            let edge = |end: usize| series.points.iter().zip(&series.band).map(move |(p, band)| (p[0], band[end]));
            let outline: Vec<_> = edge(0).chain(edge(1).rev()).collect();
            chart
                .draw_series(std::iter::once(Polygon::new(outline, color.mix(BAND_OPACITY))))
                .map_err(|e| e.to_string())?;
            let points = series.points.iter().map(|p| (p[0], p[1]));
            if series.is_reference {
                let [dash, gap] = DASH_PX;
                let line = DashedLineSeries::new(points, dash, gap, color.stroke_width(2));
                chart.draw_series(line).map_err(|e| e.to_string())?;
                continue;
            }
            chart.draw_series(LineSeries::new(points.clone(), color.stroke_width(2))).map_err(|e| e.to_string())?;
            if series.points.len() < 20 {
                chart
                    .draw_series(points.map(|point| Circle::new(point, 3, color.filled())))
                    .map_err(|e| e.to_string())?;
            }
        }
        area.present().map_err(|e| e.to_string())?;
        Ok(())
    }

    /// The rows of the legend, as many entries in each as there is room for.
    fn legend_rows<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
    ) -> Result<Vec<LegendRow<'_>>, DrawingError<DB>> {
        let [gap, next] = LEGEND_GAPS_PX;
        let mut rows: Vec<LegendRow> = Vec::new();
        let mut left_px = 0;
        for series in &self.series {
            let text_px = area.estimate_text_size(&series.name, &legend_style())?.0 as i32;
            let width = LEGEND_LINE_PX + gap + text_px;
            match rows.last_mut() {
                Some(row) if width + next <= left_px => row.push((series, width)),
                _ => {
                    rows.push(vec![(series, width)]);
                    left_px = SIZE.0 as i32 - 2 * LEGEND_MARGIN_PX + next;
                }
            }
            left_px -= width + next;
        }
        Ok(rows)
    }

    /// Heading and legend, centred in rows of their own.
    fn draw_header<DB: DrawingBackend>(
        &self,
        header: &DrawingArea<DB, Shift>,
        legend: &[LegendRow],
    ) -> Result<(), DrawingError<DB>> {
        let middle = Pos::new(HPos::Center, VPos::Top);
        let heading = TextStyle::from((FONT, 22)).pos(middle);
        header.draw_text(&self.title, &heading, (SIZE.0 as i32 / 2, HEADING_Y))?;
        let [gap, next] = LEGEND_GAPS_PX;
        for (row, y) in legend.iter().zip((LEGEND_Y..).step_by(LEGEND_ROW_PX as usize)) {
            let total: i32 = row.iter().map(|(_, width)| width + next).sum::<i32>() - next;
            let mut x = (SIZE.0 as i32 - total) / 2;
            for (series, width) in row {
                let ends = [(x, y), (x + LEGEND_LINE_PX, y)];
                if series.is_reference {
                    let [dash, gap] = DASH_PX.map(|length| length as i32);
                    header.draw(&DashedPathElement::new(ends, dash, gap, series.rgb().stroke_width(2)))?;
                } else {
                    header.draw(&PathElement::new(ends, series.rgb().stroke_width(2)))?;
                }
                header.draw_text(&series.name, &legend_style(), (x + LEGEND_LINE_PX + gap, y))?;
                x += width + next;
            }
        }
        Ok(())
    }
}

/// How the legend is written.
fn legend_style() -> TextStyle<'static> {
    TextStyle::from((FONT, 15)).pos(Pos::new(HPos::Left, VPos::Center))
}

impl Series {
    fn rgb(&self) -> RGBColor {
        let [red, green, blue] = self.color;
        RGBColor(red, green, blue)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::{Chart, HEADER_PX, LEGEND_ROW_PX, Series};

    fn chart(names: [&str; 2]) -> Chart {
        let series = |name: &str, color, points: &[[f64; 2]], is_reference| Series {
            name: name.to_owned(),
            color,
            points: points.to_vec(),
            band: Vec::new(),
            is_reference,
        };
        Chart {
            title: "a curve through all corners".to_owned(),
            x_label: "x".to_owned(),
            y_label: "y".to_owned(),
            x_end: 1.0,
            y_end: 1.0,
            series: vec![
                series(names[0], [0, 114, 178], &[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]], false),
                series(names[1], [120, 120, 120], &[[0.0, 0.0], [1.0, 1.0]], true),
            ],
        }
    }

    #[test]
    fn the_legend_touches_no_part_of_the_plot() {
        let [short, long] =
            [["a", "b"], ["moderate: 71.23 of 100", "expected"]].map(|names| chart(names).draw().unwrap());
        let (width, height) = short.dimensions();
        let part =
            |image: &image::RgbImage, y: u32, rows: u32| image::imageops::crop_imm(image, 0, y, width, rows).to_image();
        assert_ne!(part(&short, 0, HEADER_PX), part(&long, 0, HEADER_PX));
        assert_eq!(part(&short, HEADER_PX, height - HEADER_PX), part(&long, HEADER_PX, height - HEADER_PX));
    }

    #[test]
    fn a_long_legend_takes_more_rows_and_keeps_from_the_sides() {
        let mut many = chart(["gaussian_noise", "gaussian_blur"]);
        let first = many.series[0].clone();
        for name in ["motion_blur", "brightness", "contrast", "jpeg_compression"] {
            many.series.push(Series { name: name.to_owned(), ..first.clone() });
        }
        let image = many.draw().unwrap();
        let is_white = |x: u32, y: u32| image.get_pixel(x, y).0 == [255; 3];
        let rows = HEADER_PX + LEGEND_ROW_PX;
        assert!((0..rows).all(|y| is_white(4, y) && is_white(image.width() - 5, y)));
        let second = (HEADER_PX - LEGEND_ROW_PX / 2..rows - LEGEND_ROW_PX / 2)
            .any(|y| (0..image.width()).any(|x| !is_white(x, y)));
        assert!(second, "there is a second row");
    }

    #[test]
    fn a_curve_along_the_upper_edge_is_seen_whole() {
        let image = chart(["a", "b"]).draw().unwrap();
        let blue = |x: u32, y: u32| image.get_pixel(x, y).0 == [0, 114, 178];
        let longest = (HEADER_PX..image.height()).map(|y| (0..image.width()).filter(|&x| blue(x, y)).count()).max();
        assert!(longest.unwrap() > 600, "{longest:?}");
    }
}
