//! Pixels to draw on: a thin layer over `tiny_skia` that speaks in points and inks.

use farsight_core::Box2d;
use image::RgbImage;
use tiny_skia::{
    Color, FillRule, IntSize, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Rect, Stroke, StrokeDash, Transform,
};

use crate::palette::Rgba;

/// A point of the picture, pixels.
pub(crate) type Point = [f64; 2];

/// A pen: how wide, which rgba, whether dashed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pen {
    pub(crate) rgba: Rgba,
    pub(crate) width_px: f64,
    pub(crate) dashed: bool,
}

impl Pen {
    pub(crate) const fn solid(rgba: Rgba, width_px: f64) -> Self {
        Self { rgba, width_px, dashed: false }
    }

    pub(crate) const fn dashed(rgba: Rgba, width_px: f64) -> Self {
        Self { rgba, width_px, dashed: true }
    }
}

pub(crate) struct Canvas {
    pixmap: Pixmap,
}

impl Canvas {
    /// `None` when the image has no pixels, or more than can be drawn on.
    pub(crate) fn from_image(image: &RgbImage) -> Option<Self> {
        let (pixels, _) = image.as_raw().as_chunks::<3>();
        let mut rgba = vec![u8::MAX; 4 * pixels.len()];
        let (drawn, _) = rgba.as_chunks_mut::<4>();
        for (drawn, [red, green, blue]) in drawn.iter_mut().zip(pixels) {
            *drawn = [*red, *green, *blue, u8::MAX];
        }
        let pixmap = Pixmap::from_vec(rgba, IntSize::from_wh(image.width(), image.height())?)?;
        Some(Self { pixmap })
    }

    /// `None` as for [`Canvas::from_image`].
    pub(crate) fn filled([width, height]: [u32; 2], rgba: Rgba) -> Option<Self> {
        let mut pixmap = Pixmap::new(width, height)?;
        pixmap.fill(color(rgba));
        Some(Self { pixmap })
    }

    pub(crate) fn into_image(self) -> RgbImage {
        // Everything was drawn on opaque ground, so the colours need no division by the opacity.
        let mut image = RgbImage::new(self.pixmap.width(), self.pixmap.height());
        let ((pixels, _), (drawn, _)) = (image.as_chunks_mut::<3>(), self.pixmap.data().as_chunks::<4>());
        for (pixel, [red, green, blue, _]) in pixels.iter_mut().zip(drawn) {
            *pixel = [*red, *green, *blue];
        }
        image
    }

    /// The whole picture.
    pub(crate) fn bounds(&self) -> Box2d {
        Box2d::new(0.0, 0.0, f64::from(self.pixmap.width()), f64::from(self.pixmap.height()))
    }

    /// Mixes `rgba` into one pixel; a pixel outside is left out.
    pub(crate) fn blend(&mut self, [x, y]: [i64; 2], rgba: Rgba, coverage: f32) {
        let (width, height) = (i64::from(self.pixmap.width()), i64::from(self.pixmap.height()));
        if !(0..width).contains(&x) || !(0..height).contains(&y) {
            return;
        }
        let weight = (rgba.opacity * coverage).clamp(0.0, 1.0);
        let first = 4 * (y * width + x) as usize;
        let Some(pixel) = self.pixmap.data_mut().get_mut(first..first + 3) else { return };
        for (old, new) in pixel.iter_mut().zip(rgba.rgb) {
            *old = (f32::from(*old) * (1.0 - weight) + f32::from(new) * weight).round() as u8;
        }
    }

    /// Strokes the open line through `points`.
    pub(crate) fn polyline(&mut self, points: &[Point], pen: Pen) {
        if let Some(path) = path(points, false) {
            self.stroke(&path, pen);
        }
    }

    /// Strokes the closed outline through `points`.
    pub(crate) fn outline(&mut self, points: &[Point], pen: Pen) {
        if let Some(path) = path(points, true) {
            self.stroke(&path, pen);
        }
    }

    /// Fills the polygon with these corners.
    pub(crate) fn polygon(&mut self, points: &[Point], rgba: Rgba) {
        if let Some(path) = path(points, true) {
            self.fill(&path, rgba);
        }
    }

    /// Fills a rectangle with rounded corners.
    pub(crate) fn rounded_rect(&mut self, area: &Box2d, radius_px: f64, rgba: Rgba) {
        if let Some(path) = rounded(area, radius_px) {
            self.fill(&path, rgba);
        }
    }

    fn fill(&mut self, path: &Path, rgba: Rgba) {
        self.pixmap.fill_path(path, &paint(rgba), FillRule::Winding, Transform::identity(), None);
    }

    fn stroke(&mut self, path: &Path, pen: Pen) {
        let width = pen.width_px as f32;
        let stroke = Stroke {
            width,
            line_cap: LineCap::Round,
            line_join: LineJoin::Round,
            dash: pen.dashed.then(|| StrokeDash::new(vec![3.0 * width, 3.5 * width], 0.0)).flatten(),
            ..Stroke::default()
        };
        self.pixmap.stroke_path(path, &paint(pen.rgba), &stroke, Transform::identity(), None);
    }
}

fn color(rgba: Rgba) -> Color {
    let [r, g, b] = rgba.rgb;
    let mut color = Color::from_rgba8(r, g, b, 255);
    color.apply_opacity(rgba.opacity);
    color
}

fn paint(rgba: Rgba) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color(color(rgba));
    paint
}

/// Pixel centres are whole numbers in a camera's pixels and half numbers in `tiny_skia`'s.
const CENTER: f64 = 0.5;

fn path(points: &[Point], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for (i, point) in points.iter().enumerate() {
        let [x, y] = point.map(|v| (v + CENTER) as f32);
        if i == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

fn rounded(area: &Box2d, radius_px: f64) -> Option<Path> {
    let [left, top, right, bottom] = [area.x1, area.y1, area.x2, area.y2].map(|v| v as f32);
    let r = radius_px.min(area.width() / 2.0).min(area.height() / 2.0) as f32;
    Rect::from_ltrb(left, top, right, bottom)?;
    let mut builder = PathBuilder::new();
    builder.move_to(left + r, top);
    builder.line_to(right - r, top);
    builder.quad_to(right, top, right, top + r);
    builder.line_to(right, bottom - r);
    builder.quad_to(right, bottom, right - r, bottom);
    builder.line_to(left + r, bottom);
    builder.quad_to(left, bottom, left, bottom - r);
    builder.line_to(left, top + r);
    builder.quad_to(left, top, left + r, top);
    builder.close();
    builder.finish()
}
