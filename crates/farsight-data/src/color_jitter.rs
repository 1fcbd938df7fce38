//! Colour jitter: brightness, contrast, saturation and hue as one linear map of colours.

/// Share of red, green and blue in what the eye sees as grey (ITU-R BT.601).
const LUMA: [f64; 3] = [0.299, 0.587, 0.114];

/// The grey that contrast turns about, 0 to 1: the luma of ImageNet's mean colour.
///
/// Fixed, not the mean of each image, so that the whole jitter is one matrix and needs no extra pass over the pixels.
const CONTRAST_PIVOT: f64 = 0.459;

/// One drawn change of colours. Applied in the order of the fields; the result is clipped once, at the end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorJitter {
    /// Factor on all colours; 1 changes nothing.
    pub brightness: f64,
    /// Factor on the distance from a middle grey; 1 changes nothing.
    pub contrast: f64,
    /// Factor on the distance from the pixel's own grey; 0 is a grey image, 1 changes nothing.
    pub saturation: f64,
    /// Turn of the colours about the grey axis, radians; 0 changes nothing.
    pub hue_rad: f64,
}

impl ColorJitter {
    /// Changes nothing.
    pub const NONE: Self = Self { brightness: 1.0, contrast: 1.0, saturation: 1.0, hue_rad: 0.0 };

    /// New red, green and blue (rows) from old red, green, blue and 1, on the scale 0 to 1.
    pub fn matrix(&self) -> [[f64; 4]; 3] {
        let linear = product(&hue_matrix(self.hue_rad), &saturation_matrix(self.saturation));
        let gain = self.brightness * self.contrast;
        let constant = CONTRAST_PIVOT * (1.0 - self.contrast);
        // Saturation and hue leave greys alone, so contrast's grey constant passes through them unchanged.
        linear.map(|[r, g, b]| [r * gain, g * gain, b * gain, constant])
    }
}

fn saturation_matrix(saturation: f64) -> [[f64; 3]; 3] {
    matrix(|row, column| LUMA[column] * (1.0 - saturation) + if row == column { saturation } else { 0.0 })
}

/// The turn by `hue_rad` about the axis of greys.
fn hue_matrix(hue_rad: f64) -> [[f64; 3]; 3] {
    let (sin, cos) = hue_rad.sin_cos();
    let even = (1.0 - cos) / 3.0;
    let odd = sin / 3.0_f64.sqrt();
    matrix(|row, column| match (column + 3 - row) % 3 {
        0 => cos + even,
        1 => even - odd,
        _ => even + odd,
    })
}

fn matrix(value: impl Fn(usize, usize) -> f64) -> [[f64; 3]; 3] {
    std::array::from_fn(|row| std::array::from_fn(|column| value(row, column)))
}

fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    matrix(|row, column| (0..3).map(|k| a[row][k] * b[k][column]).sum())
}

#[cfg(test)]
mod tests {
    use super::{CONTRAST_PIVOT, ColorJitter, LUMA};
    use farsight_core::input::CHANNEL_MEAN;

    const TOLERANCE: f64 = 1e-12;

    fn apply(jitter: &ColorJitter, rgb: [f64; 3]) -> [f64; 3] {
        jitter.matrix().map(|row| row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2] + row[3])
    }

    fn assert_close(a: [f64; 3], b: [f64; 3]) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < TOLERANCE), "{a:?} {b:?}");
    }

    #[test]
    fn no_jitter_changes_nothing() {
        assert_close(apply(&ColorJitter::NONE, [0.1, 0.7, 0.4]), [0.1, 0.7, 0.4]);
    }

    #[test]
    fn each_factor_does_what_its_name_says() {
        let rgb = [0.1, 0.7, 0.4];
        assert_close(apply(&ColorJitter { brightness: 1.2, ..ColorJitter::NONE }, rgb), rgb.map(|v| 1.2 * v));
        let contrast = rgb.map(|v| CONTRAST_PIVOT + 0.8 * (v - CONTRAST_PIVOT));
        assert_close(apply(&ColorJitter { contrast: 0.8, ..ColorJitter::NONE }, rgb), contrast);
        let grey = LUMA[0] * rgb[0] + LUMA[1] * rgb[1] + LUMA[2] * rgb[2];
        assert_close(apply(&ColorJitter { saturation: 0.0, ..ColorJitter::NONE }, rgb), [grey; 3]);
        let third = std::f64::consts::TAU / 3.0;
        assert_close(apply(&ColorJitter { hue_rad: third, ..ColorJitter::NONE }, rgb), [0.4, 0.1, 0.7]);
    }

    #[test]
    fn saturation_and_hue_leave_greys_alone() {
        let jitter = ColorJitter { saturation: 1.7, hue_rad: 0.3, ..ColorJitter::NONE };
        assert_close(apply(&jitter, [0.3; 3]), [0.3; 3]);
    }

    #[test]
    fn the_pivot_is_the_luma_of_the_mean_colour() {
        let luma: f64 = LUMA.iter().zip(CHANNEL_MEAN).map(|(weight, mean)| weight * f64::from(mean)).sum();
        assert!((luma - CONTRAST_PIVOT).abs() < 1e-3, "{luma}");
    }
}
