//! Axis-aligned boxes in the image.

/// A box in pixels: left, top, right, bottom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Box2d {
    /// Left edge, pixels.
    pub x1: f64,
    /// Top edge, pixels.
    pub y1: f64,
    /// Right edge, pixels.
    pub x2: f64,
    /// Bottom edge, pixels.
    pub y2: f64,
}

impl Box2d {
    /// The box with these edges.
    pub const fn new(x1: f64, y1: f64, x2: f64, y2: f64) -> Self {
        Self { x1, y1, x2, y2 }
    }

    /// The smallest box around `points`, or `None` when there are none.
    pub fn bounding(points: impl IntoIterator<Item = [f64; 2]>) -> Option<Self> {
        points.into_iter().fold(None, |bounds, [x, y]| {
            let b = bounds.unwrap_or(Self::new(x, y, x, y));
            Some(Self::new(b.x1.min(x), b.y1.min(y), b.x2.max(x), b.y2.max(y)))
        })
    }

    /// Width in pixels; negative when the edges are swapped.
    pub fn width(&self) -> f64 {
        self.x2 - self.x1
    }

    /// Height in pixels; negative when the edges are swapped.
    pub fn height(&self) -> f64 {
        self.y2 - self.y1
    }

    /// Area in square pixels; 0 for an empty or swapped box.
    pub fn area(&self) -> f64 {
        self.width().max(0.0) * self.height().max(0.0)
    }

    /// Whether an edge lies on the border of `[0, max_x] x [0, max_y]` or beyond: more may be there than the image
    /// shows.
    pub fn reaches_border(&self, max_x: f64, max_y: f64) -> bool {
        self.x1 <= 0.0 || self.y1 <= 0.0 || self.x2 >= max_x || self.y2 >= max_y
    }

    /// The smallest box around this one and `other`.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self::new(self.x1.min(other.x1), self.y1.min(other.y1), self.x2.max(other.x2), self.y2.max(other.y2))
    }

    /// The part inside `[0, max_x] x [0, max_y]`; edges outside move to the border.
    pub fn clamped(&self, max_x: f64, max_y: f64) -> Self {
        let clamp_x = |v: f64| v.max(0.0).min(max_x);
        let clamp_y = |v: f64| v.max(0.0).min(max_y);
        Self::new(clamp_x(self.x1), clamp_y(self.y1), clamp_x(self.x2), clamp_y(self.y2))
    }
}
