//! Grey pictures and their pyramids.

/// Pictures are made about this wide, pixels.
const USUAL_WIDTH: usize = 640;

/// Levels of a pyramid, each half as large as the one before.
pub(crate) const LEVELS: usize = 3;

/// A grey picture, row by row, 0 to 255.
#[derive(Debug, Clone)]
pub(crate) struct Grey {
    /// Width and height, pixels.
    pub(crate) size: [usize; 2],
    pub(crate) pixels: Vec<f32>,
}

/// By so much a picture of this width is made smaller.
pub(crate) fn factor(width: usize) -> usize {
    ((width + USUAL_WIDTH / 2) / USUAL_WIDTH).max(1)
}

impl Grey {
    /// Of 8-bit RGB, row by row: the mean of `factor` by `factor` pixels.
    pub(crate) fn from_rgb(rgb: &[u8], [width, height]: [usize; 2], factor: usize) -> Self {
        let size = [width / factor, height / factor];
        let mut pixels = Vec::with_capacity(size[0] * size[1]);
        let mut sums = vec![0_u32; size[0]];
        // Weights of the colours in 256 (ITU-R BT.601).
        let scale = 1.0 / (256.0 * (factor * factor) as f32);
        for row in 0..size[1] {
            sums.fill(0);
            for line in rgb[row * factor * width * 3..].chunks(width * 3).take(factor) {
                for (sum, group) in sums.iter_mut().zip(line.chunks_exact(3 * factor)) {
                    for pixel in group.chunks_exact(3) {
                        *sum += 77 * u32::from(pixel[0]) + 150 * u32::from(pixel[1]) + 29 * u32::from(pixel[2]);
                    }
                }
            }
            pixels.extend(sums.iter().map(|&sum| sum as f32 * scale));
        }
        Self { size, pixels }
    }

    /// Smoother: weighted 1, 2, 1 across and down. Patches are found by their slopes, which noise would spoil.
    pub(crate) fn smoothed(&self) -> Self {
        let [width, height] = self.size;
        let mut across = self.pixels.clone();
        for (row, line) in across.chunks_exact_mut(width.max(1)).enumerate() {
            for (value, near) in line.iter_mut().skip(1).zip(self.row(row).windows(3)) {
                *value = 0.25 * (near[0] + 2.0 * near[1] + near[2]);
            }
        }
        let across = Self { size: self.size, pixels: across };
        let mut pixels = across.pixels.clone();
        for row in 1..height.saturating_sub(1) {
            let near = across.row(row - 1).iter().zip(across.row(row)).zip(across.row(row + 1));
            for (value, ((a, b), c)) in pixels[row * width..].iter_mut().zip(near) {
                *value = 0.25 * (a + 2.0 * b + c);
            }
        }
        Self { size: self.size, pixels }
    }

    /// Half as large: the mean of two by two pixels.
    fn halved(&self) -> Self {
        let size = self.size.map(|side| side / 2);
        let mut pixels = Vec::with_capacity(size[0] * size[1]);
        for row in 0..size[1] {
            let (upper, lower) = (self.row(2 * row), self.row(2 * row + 1));
            let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2)).take(size[0]);
            pixels.extend(pairs.map(|(a, b)| 0.25 * (a[0] + a[1] + b[0] + b[1])));
        }
        Self { size, pixels }
    }

    pub(crate) fn row(&self, row: usize) -> &[f32] {
        &self.pixels[row * self.size[0]..][..self.size[0]]
    }

    /// Whether all within `reach` pixels of a place lies inside.
    pub(crate) fn holds(&self, [x, y]: [f32; 2], reach: f32) -> bool {
        let [width, height] = self.size.map(|side| side as f32);
        x >= reach && y >= reach && x + reach < width - 1.0 && y + reach < height - 1.0
    }

    /// The brightness along a row from a place on, pixel by pixel; all of it lies inside.
    pub(crate) fn sample(&self, x: f32, y: f32, values: &mut [f32]) {
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f32, y - row as f32);
        let count = values.len() + 1;
        let start = row * self.size[0] + column;
        let (upper, lower) = (&self.pixels[start..][..count], &self.pixels[start + self.size[0]..][..count]);
        for (value, (a, b)) in values.iter_mut().zip(upper.windows(2).zip(lower.windows(2))) {
            let above = a[0] + fx * (a[1] - a[0]);
            let below = b[0] + fx * (b[1] - b[0]);
            *value = above + fy * (below - above);
        }
    }

    /// The brightness at a place that lies inside.
    #[inline]
    pub(crate) fn at(&self, x: f32, y: f32) -> f32 {
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f32, y - row as f32);
        let start = row * self.size[0] + column;
        let (upper, lower) = (&self.pixels[start..start + 2], &self.pixels[start + self.size[0]..][..2]);
        let above = upper[0] + fx * (upper[1] - upper[0]);
        let below = lower[0] + fx * (lower[1] - lower[0]);
        above + fy * (below - above)
    }
}

/// A picture and its smaller versions.
pub(crate) fn pyramid(picture: Grey) -> Vec<Grey> {
    let mut levels = vec![picture];
    for level in 1..LEVELS {
        levels.push(levels[level - 1].halved());
    }
    levels
}
