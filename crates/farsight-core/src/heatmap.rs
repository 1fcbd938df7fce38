//! The Gaussian that a target draws around its centre: fixed, CornerNet's, or dynamic (DGH).

use serde::{Deserialize, Serialize};

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// How wide the Gaussian of an object is (spec section 6; dynamic Gaussian heatmap: MSFE/DGH spec section 4).
///
/// Boxes, radii, floors and ceilings are in cells of the feature map: four pixels of the network's input each (stride
/// 4), not pixels of the image. In every rule `sigma = (2 radius + 1) / 6`, so a radius of 0 still reaches a third of a
/// cell. Every rule takes a floor, `min_radius`, so that a comparison of rules need not be one of floors; 0 is none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "rule", rename_all = "snake_case", deny_unknown_fields)]
pub enum HeatmapRule {
    /// The same radius for every object.
    Fixed {
        /// Radius, cells.
        radius: f64,
        /// Smallest radius, cells.
        #[serde(default, skip_serializing_if = "is_default")]
        min_radius: f64,
    },
    /// The corrected CornerNet radius of official SMOKE, cut to whole cells.
    CornerNet {
        /// Overlap that a box moved by the radius must keep.
        min_overlap: f64,
        /// Smallest radius, cells; none in official SMOKE.
        #[serde(default, skip_serializing_if = "is_default")]
        min_radius: f64,
    },
    /// The CornerNet radius as its authors' code has it, several times larger than what the formula is for, cut to
    /// whole cells.
    CornerNetOriginal {
        /// Overlap that a box moved by the radius was meant to keep.
        min_overlap: f64,
        /// Smallest radius, cells; none in the authors' code.
        #[serde(default, skip_serializing_if = "is_default")]
        min_radius: f64,
    },
    /// DGH as the paper words it: `alpha * sqrt(w h)`, rounded to whole cells.
    DynamicInteger {
        /// Share of `sqrt(w h)`.
        alpha: f64,
        /// Smallest radius, cells.
        min_radius: f64,
        /// Largest radius, cells.
        max_radius: f64,
    },
    /// DGH without rounding: small and distant objects keep a soft target that follows their size.
    Dynamic {
        /// Share of `sqrt(w h)`.
        alpha: f64,
        /// Smallest radius, cells.
        min_radius: f64,
        /// Largest radius, cells.
        max_radius: f64,
    },
}

impl HeatmapRule {
    /// Official SMOKE's rule.
    pub const SMOKE: Self = Self::CornerNet { min_overlap: 0.7, min_radius: 0.0 };

    /// The Gaussian of a box `width` x `height` cells large; `factor` scales alpha for its class (before the floor),
    /// and plays no part in other rules.
    pub fn gaussian(&self, width: f64, height: f64, factor: f64) -> Gaussian {
        let dynamic = |alpha: f64| alpha * factor * (width.max(0.0) * height.max(0.0)).sqrt();
        let radius = match *self {
            Self::Fixed { radius, min_radius } => radius.max(min_radius),
            Self::CornerNet { min_overlap, min_radius } => {
                cornernet_radius(width, height, min_overlap).trunc().max(min_radius)
            }
            Self::CornerNetOriginal { min_overlap, min_radius } => {
                cornernet_original_radius(width, height, min_overlap).trunc().max(min_radius)
            }
            Self::DynamicInteger { alpha, min_radius, max_radius } => {
                (dynamic(alpha) + 0.5).floor().clamp(min_radius, max_radius)
            }
            Self::Dynamic { alpha, min_radius, max_radius } => dynamic(alpha).clamp(min_radius, max_radius),
        };
        Gaussian { radius }
    }

    /// Why this rule cannot be used, if it cannot.
    pub fn problem(&self) -> Option<String> {
        let positive = |name: &str, value: f64| {
            (!(value.is_finite() && value > 0.0))
                .then(|| format!("heatmap {name} is {value}; expected a positive number"))
        };
        let cells = |name: &str, value: f64| {
            (!(0.0..=MAX_CELLS).contains(&value))
                .then(|| format!("heatmap {name} is {value}; expected 0 to {MAX_CELLS} cells"))
        };
        match *self {
            Self::Fixed { radius, min_radius } => cells("radius", radius).or_else(|| cells("min_radius", min_radius)),
            Self::CornerNet { min_overlap, min_radius } | Self::CornerNetOriginal { min_overlap, min_radius } => {
                (!(min_overlap > 0.0 && min_overlap < 1.0))
                    .then(|| format!("heatmap min_overlap is {min_overlap}; expected a number between 0 and 1"))
                    .or_else(|| cells("min_radius", min_radius))
            }
            Self::DynamicInteger { alpha, min_radius, max_radius }
            | Self::Dynamic { alpha, min_radius, max_radius } => positive("alpha", alpha).or_else(|| {
                (!(min_radius >= 0.0 && min_radius <= max_radius && max_radius <= MAX_CELLS)).then(|| {
                    format!("heatmap radii are {min_radius} to {max_radius}; expected 0 <= min_radius <= max_radius <= {MAX_CELLS}")
                })
            }),
        }
    }
}

/// A larger radius than any map has cells a side.
const MAX_CELLS: f64 = 1e4;

/// The largest radius by which both corners of a box can move and keep an overlap of `t`, cells (the corrected
/// formula).
pub fn cornernet_radius(width: f64, height: f64, t: f64) -> f64 {
    let (sum, area) = (width + height, width * height);
    let r1 = (sum - (sum * sum - 4.0 * area * (1.0 - t) / (1.0 + t)).sqrt()) / 2.0;
    let r2 = (2.0 * sum - (4.0 * sum * sum - 16.0 * (1.0 - t) * area).sqrt()) / 8.0;
    let r3 = (-2.0 * t * sum + (4.0 * t * t * sum * sum + 16.0 * t * (1.0 - t) * area).sqrt()) / (8.0 * t);
    r1.min(r2).min(r3)
}

/// The radius of the authors' code: of each quadratic equation the larger root, divided by two instead of twice its
/// leading factor, cells.
pub fn cornernet_original_radius(width: f64, height: f64, t: f64) -> f64 {
    let (sum, area) = (width + height, width * height);
    let root = |a: f64, b: f64, c: f64| f64::midpoint(b, (b * b - 4.0 * a * c).sqrt());
    let r1 = root(1.0, sum, area * (1.0 - t) / (1.0 + t));
    let r2 = root(4.0, 2.0 * sum, (1.0 - t) * area);
    let r3 = root(4.0 * t, -2.0 * t * sum, (t - 1.0) * area);
    r1.min(r2).min(r3)
}

/// A round Gaussian with peak 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaussian {
    /// Radius, cells, not negative.
    pub radius: f64,
}

impl Gaussian {
    /// Standard deviation, cells.
    pub fn sigma(&self) -> f64 {
        (2.0 * self.radius + 1.0) / 6.0
    }

    /// Draws the Gaussian at `cell` (column, row) of `map`, `width` cells a row; where targets meet, the larger value
    /// stays.
    ///
    /// # Panics
    /// When `cell` lies outside the map.
    pub fn draw(&self, map: &mut [f32], width: usize, cell: [usize; 2]) {
        let height = map.len() / width;
        let reach = self.radius.ceil() as usize;
        let scale = 1.0 / (2.0 * self.sigma() * self.sigma());
        let range = |center: usize, size: usize| center.saturating_sub(reach)..(center + reach + 1).min(size);
        for row in range(cell[1], height) {
            for column in range(cell[0], width) {
                let (dx, dy) = (column.abs_diff(cell[0]) as f64, row.abs_diff(cell[1]) as f64);
                let value = (-(dx * dx + dy * dy) * scale).exp() as f32;
                let here = &mut map[row * width + column];
                *here = here.max(value);
            }
        }
    }
}
