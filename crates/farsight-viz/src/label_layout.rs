//! Where labels go, so that they cover neither each other nor more of the scene than they must.

use farsight_core::Box2d;

use crate::canvas::Point;

/// Steps that a label may move up, and down, from its place; in heights of the label.
const STEPS: i32 = 6;

/// A label that hides another costs this many times the hidden share.
const OVER_LABEL: f64 = 100.0;

/// A label that hides an object costs this many times the hidden share of the object.
const OVER_OBJECT: f64 = 3.0;

/// A label that lies on its own object costs this many times the share of the label that does.
const OVER_OWN: f64 = 0.8;

/// Cost of moving away by the height of the label.
const AWAY: f64 = 0.35;

/// Cost of standing lower than above the object.
const NOT_ABOVE: f64 = 0.25;

/// Labels placed so far and what they should not hide.
pub(crate) struct LabelLayout<'a> {
    window: Box2d,
    objects: &'a [Box2d],
    placed: Vec<Box2d>,
    gap_px: f64,
}

impl<'a> LabelLayout<'a> {
    /// Labels stay inside `window`, `gap_px` apart, and keep off `objects` where they can.
    pub(crate) fn new(window: Box2d, objects: &'a [Box2d], gap_px: f64) -> Self {
        Self { window, objects, placed: Vec::new(), gap_px }
    }

    /// The place for a label of `size` that belongs to `object`: above it, below it or beside it, wherever it hides
    /// least.
    pub(crate) fn place(&mut self, object: &Box2d, size: [f64; 2]) -> Box2d {
        let mut best: Option<(f64, Box2d)> = None;
        for candidate in self.candidates(object, size) {
            let cost = self.cost(&candidate, object, size[1]);
            // The first of equals wins: the order of the candidates is the order of preference.
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, candidate));
            }
        }
        let place = best.map_or(Box2d::new(0.0, 0.0, size[0], size[1]), |(_, place)| place);
        self.placed.push(place);
        place
    }

    fn candidates(&self, object: &Box2d, [width, height]: [f64; 2]) -> Vec<Box2d> {
        let middle = f64::midpoint(object.x1, object.x2) - width / 2.0;
        let columns = [middle, object.x1, object.x2 - width, object.x1 - width - self.gap_px, object.x2 + self.gap_px];
        let step = height + self.gap_px;
        let mut candidates = Vec::new();
        for i in 0..=STEPS {
            let by = f64::from(i) * step;
            for row in [object.y1 - self.gap_px - height - by, object.y2 + self.gap_px + by, object.y1 + by] {
                candidates.extend(columns.iter().map(|&x| self.moved_inside([x, row], [width, height])));
            }
        }
        candidates
    }

    fn moved_inside(&self, [x, y]: Point, [width, height]: [f64; 2]) -> Box2d {
        let x = x.min(self.window.x2 - width).max(self.window.x1);
        let y = y.min(self.window.y2 - height).max(self.window.y1);
        Box2d::new(x, y, x + width, y + height)
    }

    fn cost(&self, candidate: &Box2d, object: &Box2d, height: f64) -> f64 {
        let labels: f64 = self.placed.iter().map(|placed| share_hidden(placed, candidate, self.gap_px)).sum();
        let objects: f64 = self.objects.iter().map(|other| share_hidden(other, candidate, 0.0)).sum();
        let own = share_hidden(candidate, object, 0.0);
        let aside = (f64::midpoint(candidate.x1, candidate.x2) - f64::midpoint(object.x1, object.x2)).abs();
        let apart = (object.y1 - candidate.y2).max(candidate.y1 - object.y2).max(0.0);
        let lower = if candidate.y2 <= object.y1 { 0.0 } else { NOT_ABOVE };
        let moved = AWAY * (0.5 * aside).hypot(apart) / height;
        OVER_LABEL * labels + OVER_OBJECT * objects + OVER_OWN * own + lower + moved
    }
}

/// Share of `area`, grown by `margin` on all sides, that `cover` hides.
fn share_hidden(area: &Box2d, cover: &Box2d, margin: f64) -> f64 {
    let grown = Box2d::new(area.x1 - margin, area.y1 - margin, area.x2 + margin, area.y2 + margin);
    let common =
        Box2d::new(grown.x1.max(cover.x1), grown.y1.max(cover.y1), grown.x2.min(cover.x2), grown.y2.min(cover.y2));
    common.area() / grown.area().max(1.0)
}

#[cfg(test)]
mod tests {
    use farsight_core::Box2d;

    use super::{LabelLayout, share_hidden};

    const WINDOW: Box2d = Box2d::new(0.0, 0.0, 1000.0, 400.0);
    const SIZE: [f64; 2] = [80.0, 18.0];

    #[test]
    fn a_lone_label_stands_above_the_middle() {
        let object = Box2d::new(400.0, 200.0, 500.0, 260.0);
        let place = LabelLayout::new(WINDOW, &[object], 2.0).place(&object, SIZE);
        assert_eq!(place, Box2d::new(410.0, 180.0, 490.0, 198.0));
    }

    #[test]
    fn a_row_of_parked_cars_gets_labels_that_do_not_touch() {
        let objects: Vec<_> = (0..10)
            .map(|i| Box2d::new(400.0 + 15.0 * f64::from(i), 180.0, 440.0 + 15.0 * f64::from(i), 210.0))
            .collect();
        let mut layout = LabelLayout::new(WINDOW, &objects, 2.0);
        let places: Vec<_> = objects.iter().map(|object| layout.place(object, SIZE)).collect();
        for (i, a) in places.iter().enumerate() {
            for b in &places[..i] {
                assert!(share_hidden(a, b, 0.0) <= 0.0, "{a:?} and {b:?} overlap");
            }
        }
    }

    #[test]
    fn labels_stay_inside_even_when_the_window_is_smaller() {
        let window = Box2d::new(0.0, 0.0, 10.0, 10.0);
        let object = Box2d::new(-50.0, -50.0, 60.0, 60.0);
        let place = LabelLayout::new(window, &[object], 2.0).place(&object, SIZE);
        assert_eq!(place, Box2d::new(0.0, 0.0, SIZE[0], SIZE[1]));
    }
}
