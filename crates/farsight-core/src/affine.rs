//! Affine maps of the image plane: crop, scale, pad, mirror.

/// `p' = linear * p + offset`, from pixels to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine2 {
    /// Row-major 2x3 matrix.
    pub matrix: [[f64; 3]; 2],
}

impl Affine2 {
    /// The map that changes nothing.
    pub const IDENTITY: Self = Self { matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };

    /// Scales both axes by `scale` about the pixel (0, 0).
    pub const fn scaling(scale: f64) -> Self {
        Self { matrix: [[scale, 0.0, 0.0], [0.0, scale, 0.0]] }
    }

    /// Left-right mirror of an image `width` pixels wide: column `u` becomes `width - 1 - u`.
    pub fn mirror(width: usize) -> Self {
        Self { matrix: [[-1.0, 0.0, width as f64 - 1.0], [0.0, 1.0, 0.0]] }
    }

    /// Takes the source window centred at `center` and `window_width` pixels wide to an output of `size` (width,
    /// height).
    ///
    /// The width alone sets the scale, the same for both axes; the height is centred and cropped or padded (SMOKE, spec
    /// 5.2).
    pub fn window(center: [f64; 2], window_width: f64, size: [usize; 2]) -> Self {
        let scale = size[0] as f64 / window_width;
        Self::centered(center, [scale; 2], size)
    }

    /// Takes `center` to the middle of an output of `size` (width, height), with a scale of its own for each axis.
    pub fn centered(center: [f64; 2], scale: [f64; 2], size: [usize; 2]) -> Self {
        let [width, height] = size.map(|s| s as f64);
        let [across, down] = scale;
        Self { matrix: [[across, 0.0, width / 2.0 - across * center[0]], [0.0, down, height / 2.0 - down * center[1]]] }
    }

    /// The image of pixel `p`.
    pub fn apply(&self, p: [f64; 2]) -> [f64; 2] {
        self.matrix.map(|row| row[0] * p[0] + row[1] * p[1] + row[2])
    }

    /// `next` after `self`.
    pub fn then(&self, next: &Self) -> Self {
        let mut matrix = [[0.0; 3]; 2];
        for (out, row) in matrix.iter_mut().zip(&next.matrix) {
            for (j, value) in out.iter_mut().enumerate() {
                *value = row[0] * self.matrix[0][j] + row[1] * self.matrix[1][j];
            }
            out[2] += row[2];
        }
        Self { matrix }
    }

    /// The map back, or `None` when the linear part is singular.
    pub fn inverse(&self) -> Option<Self> {
        let [[a, b, c], [d, e, f]] = self.matrix;
        let determinant = a * e - b * d;
        if !determinant.is_normal() {
            return None;
        }
        let [ia, ib, id, ie] = [e, -b, -d, a].map(|v| v / determinant);
        Some(Self { matrix: [[ia, ib, -(ia * c + ib * f)], [id, ie, -(id * c + ie * f)]] })
    }
}
