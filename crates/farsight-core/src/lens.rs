//! What a lens does to the picture of a pinhole: OpenCV's two models of distortion.

use std::fmt::{self, Display};
use std::str::FromStr;

use thiserror::Error;

use crate::Camera;

/// Distortion of a lens, as OpenCV's `calibrateCamera` and `fisheye::calibrate` find it.
///
/// A ray goes through (x, y) in the plane at depth 1. The lens shows it where a pinhole would show the distorted (x,
/// y). Focal lengths and principal point are those of [`Camera`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// Brown and Conrady: k1, k2, p1, p2, k3, in OpenCV's order.
    Brown([f64; 5]),
    /// Kannala and Brandt, for fisheyes: k1, k2, k3, k4 of the angle.
    KannalaBrandt([f64; 4]),
}

/// A lens that cannot be used.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum LensError {
    /// A text that names no lens.
    #[error("{0:?} is no lens; expected brown:k1,k2,p1,p2,k3 or kb4:k1,k2,k3,k4")]
    Text(String),
    /// Parameters that send two rays to one pixel.
    #[error("the lens {lens} folds the image at column {:.0}, row {:.0}; expected parameters of this camera", pixel[0], pixel[1])]
    Folds {
        /// The lens.
        lens: Lens,
        /// Where in the picture without distortion, pixels.
        pixel: [f64; 2],
    },
}

/// Places along each side of the image where the lens is checked.
const CHECKED: usize = 65;

impl Lens {
    /// The distorted place of the ray through `point` in the plane at depth 1.
    pub fn distorted(&self, point: [f64; 2]) -> [f64; 2] {
        let [x, y] = point;
        let squared = x * x + y * y;
        match *self {
            Self::Brown([k1, k2, p1, p2, k3]) => {
                let radial = 1.0 + squared * (k1 + squared * (k2 + squared * k3));
                let (across, down) = (2.0 * x * y, squared);
                [
                    x * radial + p1 * across + p2 * (down + 2.0 * x * x),
                    y * radial + p1 * (down + 2.0 * y * y) + p2 * across,
                ]
            }
            Self::KannalaBrandt([k1, k2, k3, k4]) => {
                let radius = squared.sqrt();
                let angle = radius.atan();
                let a2 = angle * angle;
                let bent = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))));
                // The limit at the axis is 1.
                let scale = if radius > 1e-9 { bent / radius } else { 1.0 };
                [x * scale, y * scale]
            }
        }
    }

    /// Where the lens shows what a pinhole `camera` would show at `pixel`.
    pub fn distorted_pixel(&self, camera: &Camera, pixel: [f64; 2]) -> [f64; 2] {
        let ([fx, fy], [cx, cy]) = ([camera.focal_x(), camera.focal_y()], camera.principal_point());
        let [x, y] = self.distorted([(pixel[0] - cx) / fx, (pixel[1] - cy) / fy]);
        [fx * x + cx, fy * y + cy]
    }

    /// Refuses a lens that folds an image of `size` (width, height; pixels) of `camera`: two rays would share a pixel.
    ///
    /// # Errors
    /// When it does, or when a place is not finite.
    pub fn check(&self, camera: &Camera, size: [usize; 2]) -> Result<(), LensError> {
        let ([fx, fy], [cx, cy]) = ([camera.focal_x(), camera.focal_y()], camera.principal_point());
        let place = |i: usize, side: usize| i as f64 / (CHECKED - 1) as f64 * (side as f64 - 1.0);
        for (row, column) in (0..CHECKED).flat_map(|row| (0..CHECKED).map(move |column| (row, column))) {
            let pixel = [place(column, size[0]), place(row, size[1])];
            let area = self.area_scale([(pixel[0] - cx) / fx, (pixel[1] - cy) / fy]);
            // Turned over as well as without an area; NaN is neither.
            if !(area > 0.0 && area.is_finite()) {
                return Err(LensError::Folds { lens: *self, pixel });
            }
        }
        Ok(())
    }

    /// By how much an area at `point` grows: the determinant of the derivative, by central differences.
    fn area_scale(&self, point: [f64; 2]) -> f64 {
        const STEP: f64 = 1e-5;
        let [x, y] = point;
        let slope = |a: [f64; 2], b: [f64; 2]| {
            let (a, b) = (self.distorted(a), self.distorted(b));
            [(a[0] - b[0]) / (2.0 * STEP), (a[1] - b[1]) / (2.0 * STEP)]
        };
        let by_x = slope([x + STEP, y], [x - STEP, y]);
        let by_y = slope([x, y + STEP], [x, y - STEP]);
        by_x[0] * by_y[1] - by_x[1] * by_y[0]
    }
}

impl Display for Lens {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, values): (_, &[f64]) = match self {
            Self::Brown(values) => ("brown", values),
            Self::KannalaBrandt(values) => ("kb4", values),
        };
        let values: Vec<String> = values.iter().map(ToString::to_string).collect();
        write!(f, "{name}:{}", values.join(","))
    }
}

impl FromStr for Lens {
    type Err = LensError;

    /// `brown:k1,k2,p1,p2,k3` (k3 may be left out) or `kb4:k1,k2,k3,k4`.
    fn from_str(text: &str) -> Result<Self, LensError> {
        let wrong = || LensError::Text(text.to_owned());
        let (name, list) = text.split_once(':').ok_or_else(wrong)?;
        let number = |word: &str| word.trim().parse().ok().filter(|value: &f64| value.is_finite());
        let values: Vec<f64> = list.split(',').map(number).collect::<Option<_>>().ok_or_else(wrong)?;
        match (name, values.as_slice()) {
            ("brown", &[k1, k2, p1, p2]) => Ok(Self::Brown([k1, k2, p1, p2, 0.0])),
            ("brown", &[k1, k2, p1, p2, k3]) => Ok(Self::Brown([k1, k2, p1, p2, k3])),
            ("kb4", &[k1, k2, k3, k4]) => Ok(Self::KannalaBrandt([k1, k2, k3, k4])),
            _ => Err(wrong()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Lens, LensError};
    use crate::Camera;

    fn camera() -> Camera {
        Camera::from_intrinsics(720.0, 700.0, 640.0, 360.0).unwrap()
    }

    /// Where OpenCV 4 shows the rays through these x and y (`projectPoints`, `fisheye.projectPoints`), pixels.
    const X: [f64; 4] = [-0.9, -0.35, 0.0, 0.6];
    const Y: [f64; 3] = [-0.5, 0.0, 0.4];
    const BROWN: [f64; 5] = [-0.28, 0.09, 0.0011, -0.0007, -0.012];
    const KB4: [f64; 4] = [-0.031, 0.012, -0.0065, 0.0013];
    #[rustfmt::skip]
    const BY_BROWN: [[f64; 2]; 12] = [
        [127.421_468, 84.249_067], [103.610_413, 360.6237], [118.344_857, 585.942_199], [411.258_889, 42.851_587],
        [396.123_597, 360.094_325], [405.703_751, 620.38849], [639.874, 33.174_375], [640.0, 360.0],
        [639.91936, 628.456_957], [1_010.359_458, 60.16087], [1_032.707_063, 360.2772], [1018.64024, 605.985_237],
    ];
    #[rustfmt::skip]
    const BY_KB4: [[f64; 2]; 12] = [
        [144.770_445, 92.514_901], [119.804_979, 360.0], [136.25847, 577.666_093], [415.642_192, 48.391_933],
        [398.410_776, 360.0], [409.949_242, 615.611_953], [640.0, 37.449_589], [640.0, 360.0],
        [640.0, 625.220_875], [1_002.420_443, 66.372_326], [1_025.918_185, 360.0], [1_010.297_381, 600.007_562],
    ];

    #[test]
    fn both_models_are_those_of_opencv() {
        let camera = camera();
        for (lens, expected) in [(Lens::Brown(BROWN), BY_BROWN), (Lens::KannalaBrandt(KB4), BY_KB4)] {
            let rays = X.iter().flat_map(|x| Y.map(|y| [*x, y]));
            for (ray, expected) in rays.zip(expected) {
                let pixel = camera.pixel_from_point([ray[0], ray[1], 1.0]).unwrap();
                let found = lens.distorted_pixel(&camera, pixel);
                for axis in [0, 1] {
                    assert!((found[axis] - expected[axis]).abs() < 2e-6, "{lens}: {found:?}, {expected:?}");
                }
            }
        }
    }

    #[test]
    fn a_lens_that_folds_the_image_is_refused() {
        let size = [1280, 720];
        for good in ["brown:-0.28,0.09,0,0,-0.012", "kb4:-0.03,0.01,-0.006,0.001", "brown:0,0,0,0"] {
            assert_eq!(good.parse::<Lens>().unwrap().check(&camera(), size), Ok(()), "{good}");
        }
        for folded in ["brown:-0.9,0,0,0", "kb4:-2,0,0,0", "brown:1e300,0,0,0", "brown:0,0,5,0"] {
            let told = folded.parse::<Lens>().unwrap().check(&camera(), size);
            assert!(matches!(told, Err(LensError::Folds { .. })), "{folded}: {told:?}");
        }
    }

    #[test]
    fn a_text_comes_back_and_nonsense_is_told() {
        for text in ["brown:-0.28,0.09,0.0011,-0.0007,-0.012", "kb4:-0.031,0.012,-0.0065,0.0013"] {
            assert_eq!(text.parse::<Lens>().unwrap().to_string(), text);
        }
        for text in ["", "brown", "brown:1,2,3", "kb4:1,2,3", "kb4:1,2,3,nan", "fisheye:1,2,3,4", "brown:1,2,3,4,5,6"] {
            let told = text.parse::<Lens>().unwrap_err().to_string();
            assert!(told.ends_with("is no lens; expected brown:k1,k2,p1,p2,k3 or kb4:k1,k2,k3,k4"), "{told}");
        }
    }
}
