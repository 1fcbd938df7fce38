//! What the distances of all vehicles of an image have in common: the sizes of the vehicles of a part of the world.
//!
//! A picture shows a small car near or a large one far. Where cars are larger than a network learnt, all distances are
//! too short by one factor, and ten cars that agree are as wrong as one. So an image has a common factor with an error
//! of its own, beside the error of each object.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::statistics::{quantile, sorted};
use crate::{Detection, ObjectClass};

/// A part of the world, by the sizes of the vehicles that drive there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Region {
    /// Anywhere.
    #[default]
    World,
    /// Europe, the islands that drive on the left included.
    Europe,
    /// The United States and Canada.
    NorthAmerica,
    /// China.
    China,
    /// Japan.
    Japan,
    /// India.
    India,
}

impl Region {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::World, Self::Europe, Self::NorthAmerica, Self::China, Self::Japan, Self::India];

    /// Its name in options and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::World => "world",
            Self::Europe => "europe",
            Self::NorthAmerica => "north-america",
            Self::China => "china",
            Self::Japan => "japan",
            Self::India => "india",
        }
    }
}

impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Region {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|region| region.name() == text);
        found.ok_or_else(|| format!("expected {}", Self::ALL.map(Self::name).join(", ")))
    }
}

/// What is known, before an image is seen, of the factor that the distances of all its vehicles share.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScalePrior {
    /// The factor that is likeliest.
    pub factor: f64,
    /// Standard deviation of its logarithm.
    pub log_sigma: f64,
}

impl Default for ScalePrior {
    /// Nothing is shared.
    fn default() -> Self {
        Self { factor: 1.0, log_sigma: 0.0 }
    }
}

/// A fit needs so many images with at least two objects.
const MIN_IMAGES: usize = 10;

impl ScalePrior {
    /// The prior that fits `images`: of each, the logarithms of found over true distance of its vehicles. None when
    /// fewer than ten have two.
    ///
    /// The factor makes the errors right in the median. The variance is the one between images, after that within them
    /// is taken off (analysis of variance of a random effect, method of moments).
    pub fn fit(images: &[Vec<f64>]) -> Option<Self> {
        let images: Vec<&Vec<f64>> = images.iter().filter(|errors| !errors.is_empty()).collect();
        if images.iter().filter(|errors| errors.len() > 1).count() < MIN_IMAGES {
            return None;
        }
        let count = |errors: &[f64]| errors.len() as f64;
        let mean_of = |errors: &[f64]| errors.iter().sum::<f64>() / count(errors);
        let objects: f64 = images.iter().map(|errors| count(errors)).sum();
        let groups = images.len() as f64;
        let mean = images.iter().map(|errors| errors.iter().sum::<f64>()).sum::<f64>() / objects;
        let squares = |errors: &&Vec<f64>| {
            let own = mean_of(errors);
            errors.iter().map(|error| (error - own).powi(2)).sum::<f64>()
        };
        let within = images.iter().map(squares).sum::<f64>() / (objects - groups);
        let between =
            images.iter().map(|errors| count(errors) * (mean_of(errors) - mean).powi(2)).sum::<f64>() / (groups - 1.0);
        let size =
            (objects - images.iter().map(|errors| count(errors).powi(2)).sum::<f64>() / objects) / (groups - 1.0);
        let median = quantile(&sorted(images.iter().flat_map(|errors| errors.iter().copied())), 0.5);
        let fitted = Self { factor: (-median).exp(), log_sigma: ((between - within) / size).max(0.0).sqrt() };
        fitted.is_usable().then_some(fitted)
    }

    /// The same where `log_sigma` more is unknown, independently.
    #[must_use]
    pub fn widened(self, log_sigma: f64) -> Self {
        Self { log_sigma: self.log_sigma.hypot(log_sigma), ..self }
    }

    /// Whether these are numbers that a fit could have given: files from strangers may hold others.
    pub fn is_usable(&self) -> bool {
        (0.2..5.0).contains(&self.factor) && (0.0..1.0).contains(&self.log_sigma)
    }

    /// Moves a vehicle along its rays by the likeliest factor.
    pub fn apply(&self, detection: &mut Detection) {
        if is_scaled(&detection.class) {
            detection.box3d = detection.box3d.scaled(self.factor);
            detection.range_sigma_m = detection.range_sigma_m.map(|sigma_m| sigma_m * self.factor);
        }
    }
}

/// Whether the class is one whose sizes differ by region. People are of one size everywhere, within their error bars.
pub const fn is_scaled(class: &ObjectClass) -> bool {
    matches!(class, ObjectClass::Car | ObjectClass::Van | ObjectClass::Truck)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_is_read_by_its_name() {
        for region in Region::ALL {
            assert_eq!(region.name().parse(), Ok(region));
        }
        assert!("texas".parse::<Region>().unwrap_err().contains("north-america"));
    }

    #[test]
    fn a_fit_takes_what_is_shared_from_what_is_not() {
        // The shared error is 0.08 either way, but for one of four objects; its own is 0.04 either way or none.
        let images = |own: f64| -> Vec<Vec<f64>> {
            let image = |shared: f64| vec![0.05 + shared + own, 0.05 + shared - own, 0.05 + shared, 0.05];
            (0..50).flat_map(|_| [image(0.08), image(-0.08)]).collect()
        };
        let fitted = ScalePrior::fit(&images(0.04)).expect("enough images");
        assert!((fitted.factor.ln() + 0.05).abs() < 1e-9, "{fitted:?}");
        // Three of four objects share it.
        assert!((fitted.log_sigma - 0.75 * 0.08).abs() < 0.01, "{fitted:?}");
        let mut independent = images(0.04);
        for (place, image) in independent.iter_mut().enumerate() {
            let sign = if place % 4 < 2 { 1.0 } else { -1.0 };
            *image = vec![0.08 * sign, -0.08 * sign];
        }
        assert!(ScalePrior::fit(&independent).expect("enough images").log_sigma < 1e-12);
        assert_eq!(ScalePrior::fit(&images(0.04)[..9]), None);
    }
}
