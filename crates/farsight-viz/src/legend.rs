//! What the colours mean.

use farsight_core::{Box2d, ObjectClass};

use crate::canvas::Canvas;
use crate::options::{ColorBy, DrawOptions, Scene};
use crate::palette::{RAMP_END_M, Rgba, SHADOW, WHITE, class_color, distance_color};
use crate::text::{CAP_HEIGHT, text_width, write};

/// Swatches that make the ramp of distances.
const SWATCHES: u32 = 24;

/// A part of the legend, from left to right.
enum Item {
    Ramp,
    Swatch(Rgba),
    Text(String),
}

impl Item {
    fn width(&self, text_px: f64) -> f64 {
        match self {
            Self::Ramp => 8.0 * text_px,
            Self::Swatch(_) => 0.7 * text_px,
            Self::Text(text) => text_width(text, text_px),
        }
    }
}

/// Draws the legend in the lower left corner; nothing when nothing was found or the picture is too small for it.
pub(crate) fn legend(canvas: &mut Canvas, scene: &Scene, options: &DrawOptions, text_px: f64) {
    if scene.detections.is_empty() {
        return;
    }
    let items = match options.color_by {
        ColorBy::Distance => vec![Item::Text("0".to_owned()), Item::Ramp, Item::Text(format!("{RAMP_END_M:.0} m"))],
        ColorBy::Class => class_items(scene),
    };
    let gap = 0.5 * text_px;
    let width = items.iter().map(|item| item.width(text_px) + gap).sum::<f64>() + gap;
    let bounds = canvas.bounds();
    let bottom = bounds.y2 - gap;
    let background = Box2d::new(gap, bottom - 1.6 * text_px, gap + width, bottom);
    if background.x2 > bounds.x2 || background.y1 < bounds.y2 / 2.0 {
        return;
    }
    canvas.rounded_rect(&background, 0.25 * text_px, SHADOW.faded(0.75));
    let mut x = background.x1 + gap;
    for item in items {
        let middle = f64::midpoint(background.y1, background.y2);
        let half_height = CAP_HEIGHT * text_px / 2.0;
        let area = Box2d::new(x, middle - half_height, x + item.width(text_px), middle + half_height);
        x = area.x2 + gap;
        match item {
            Item::Ramp => ramp(canvas, &area),
            Item::Swatch(color) => canvas.rounded_rect(&area, 0.15 * text_px, color),
            Item::Text(text) => write(canvas, &text, [area.x1, area.y2], text_px, WHITE),
        }
    }
}

fn ramp(canvas: &mut Canvas, area: &Box2d) {
    for i in 0..SWATCHES {
        let share = |part: u32| f64::from(part) / f64::from(SWATCHES);
        // Each reaches to the end, under its successors, so that no seam shows between them.
        let rest = Box2d::new(area.x1 + share(i) * area.width(), area.y1, area.x2, area.y2);
        canvas.rounded_rect(&rest, 0.0, distance_color(RAMP_END_M * share(i)));
    }
}

fn class_items(scene: &Scene) -> Vec<Item> {
    let mut classes: Vec<&ObjectClass> = scene.detections.iter().map(|d| &d.class).collect();
    classes.sort();
    classes.dedup();
    classes.into_iter().flat_map(|class| [Item::Swatch(class_color(class)), Item::Text(class.to_string())]).collect()
}
