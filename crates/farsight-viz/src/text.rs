//! Text, from a font that is compiled in.

use std::sync::LazyLock;

use ab_glyph::{Font, FontRef, GlyphId, PxScale, ScaleFont, point};

use crate::canvas::Canvas;
use crate::palette::Rgba;

/// `None` only if the compiled-in font were damaged; then pictures have no text.
static FONT: LazyLock<Option<FontRef<'static>>> =
    LazyLock::new(|| FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT).ok());

/// How much wider strokes are drawn than the light font has them, in heights of the text.
const EMBOLDENING: f32 = 0.035;

/// Height of a capital letter in heights of the text.
pub(crate) const CAP_HEIGHT: f64 = 0.62;

/// Width of `text` at this height, pixels.
pub(crate) fn text_width(text: &str, height_px: f64) -> f64 {
    glyphs(text, height_px as f32).last().map_or(0.0, |placed| f64::from(placed.end))
}

/// Writes `text` with the left end of its baseline at `at`.
pub(crate) fn write(canvas: &mut Canvas, text: &str, at: [f64; 2], height_px: f64, color: Rgba) {
    let Some(font) = FONT.as_ref() else { return };
    let [x, y] = at.map(|v| v as f32);
    let bold = EMBOLDENING * height_px as f32;
    for placed in glyphs(text, height_px as f32) {
        // Two strokes half a stroke apart: the light face becomes a regular one.
        for shift in [-bold / 2.0, bold / 2.0] {
            let glyph =
                placed.id.with_scale_and_position(PxScale::from(height_px as f32), point(x + placed.start + shift, y));
            let Some(outline) = font.outline_glyph(glyph) else { continue };
            let [left, top] = [outline.px_bounds().min.x as i64, outline.px_bounds().min.y as i64];
            outline.draw(|dx, dy, coverage| canvas.blend([left + i64::from(dx), top + i64::from(dy)], color, coverage));
        }
    }
}

struct Placed {
    id: GlyphId,
    start: f32,
    end: f32,
}

/// Glyphs of one line with their kerning, from x = 0.
fn glyphs(text: &str, height_px: f32) -> Vec<Placed> {
    let Some(font) = FONT.as_ref() else { return Vec::new() };
    let scaled = font.as_scaled(PxScale::from(height_px));
    let mut placed: Vec<Placed> = Vec::new();
    for id in text.chars().map(|c| font.glyph_id(c)) {
        let start = placed.last().map_or(0.0, |before| before.end + scaled.kern(before.id, id));
        placed.push(Placed { id, start, end: start + scaled.h_advance(id) });
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::{FONT, text_width};

    #[test]
    fn the_font_has_every_sign_that_labels_use() {
        let font = FONT.as_ref().expect("the compiled-in font is readable");
        for sign in "Car 0123456789.± m+°".chars().filter(|c| *c != ' ') {
            assert_ne!(ab_glyph::Font::glyph_id(font, sign).0, 0, "no glyph for {sign:?}");
        }
    }

    #[test]
    fn width_grows_with_text_and_height() {
        assert!(text_width("", 20.0).abs() < f64::EPSILON);
        assert!(text_width("Car 23.4 m", 20.0) > text_width("Car", 20.0));
        assert!((text_width("Car", 40.0) / text_width("Car", 20.0) - 2.0).abs() < 1e-3);
    }
}
