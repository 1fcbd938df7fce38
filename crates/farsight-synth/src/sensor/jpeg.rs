//! What a JPEG file would lose, without making one.
//!
//! Only the lossy steps of ITU-T T.81 baseline are done: colours to luma and halved chroma, cosine transform, rounding
//! to the quantisation tables, and back. Entropy coding loses nothing, so it is left out: three times as fast as
//! encoding and decoding, and the same bytes on every machine, which decoders with hand-written vector code do not
//! promise.

use std::array::from_fn;

/// Side of a block.
const SIDE: usize = 8;

type Block = [[f32; SIDE]; SIDE];

/// Luma table of ITU-T T.81, annex K.1.
#[rustfmt::skip]
const LUMA: [[u16; SIDE]; SIDE] = [
    [16, 11, 10, 16, 24, 40, 51, 61],
    [12, 12, 14, 19, 26, 58, 60, 55],
    [14, 13, 16, 24, 40, 57, 69, 56],
    [14, 17, 22, 29, 51, 87, 80, 62],
    [18, 22, 37, 56, 68, 109, 103, 77],
    [24, 35, 55, 64, 81, 104, 113, 92],
    [49, 64, 78, 87, 103, 121, 120, 101],
    [72, 92, 95, 98, 112, 100, 103, 99],
];

/// Chroma table of annex K.1.
#[rustfmt::skip]
const CHROMA: [[u16; SIDE]; SIDE] = [
    [17, 18, 24, 47, 99, 99, 99, 99],
    [18, 21, 26, 66, 99, 99, 99, 99],
    [24, 26, 56, 99, 99, 99, 99, 99],
    [47, 66, 99, 99, 99, 99, 99, 99],
    [99, 99, 99, 99, 99, 99, 99, 99],
    [99, 99, 99, 99, 99, 99, 99, 99],
    [99, 99, 99, 99, 99, 99, 99, 99],
    [99, 99, 99, 99, 99, 99, 99, 99],
];

/// `cos(k pi / 16) / 2` for k from 0 to 8; the first is divided by the square root of 2 where it is used.
const HALF_COSINES: [f32; 9] =
    [0.5, 0.490_392_64, 0.461_939_77, 0.415_734_8, 0.353_553_4, 0.277_785_12, 0.191_341_71, 0.097_545_16, 0.0];

/// Replaces red, green and blue by what is left of them after a JPEG file of this quality (1 to 100, libjpeg's scale).
pub(super) fn compress(bytes: &mut [u8], size: [usize; 2], quality: u8) {
    let [mut luma, blue, red] = planes(bytes, size);
    let mut chroma = [blue.halved(), red.halved()];
    luma.lose(&table(&LUMA, quality));
    for plane in &mut chroma {
        plane.lose(&table(&CHROMA, quality));
    }
    for (y, row) in bytes.chunks_exact_mut(3 * size[0]).enumerate() {
        let (pixels, _) = row.as_chunks_mut::<3>();
        let luma = luma.row(y);
        let [blue, red] = [chroma[0].row(y / 2), chroma[1].row(y / 2)];
        for (x, pixel) in pixels.iter_mut().enumerate() {
            *pixel = rgb(luma[x], blue[x / 2], red[x / 2]);
        }
    }
}

/// One colour channel, padded to whole blocks by repeating its edge; values around 0.
struct Plane {
    stride: usize,
    values: Vec<f32>,
}

/// Luma, blue and red difference of the picture (JFIF).
fn planes(bytes: &[u8], [width, height]: [usize; 2]) -> [Plane; 3] {
    // Twice the block, so that the halved chroma is whole blocks too.
    let [stride, rows] = [width, height].map(|s| s.next_multiple_of(2 * SIDE));
    let plane = || Plane { stride, values: vec![0.0; stride * rows] };
    let (mut luma, mut blue, mut red) = (plane(), plane(), plane());
    for y in 0..rows {
        let line = y * stride..(y + 1) * stride;
        let (luma, blue, red) = (&mut luma.values[line.clone()], &mut blue.values[line.clone()], &mut red.values[line]);
        let (pixels, _) = bytes[3 * width * y.min(height - 1)..][..3 * width].as_chunks::<3>();
        let outs = luma.iter_mut().zip(blue).zip(red);
        for (((luma, blue), red), pixel) in outs.zip(pixels.iter().chain(std::iter::repeat(&pixels[width - 1]))) {
            let (r, g, b) = (f32::from(pixel[0]), f32::from(pixel[1]), f32::from(pixel[2]));
            *luma = 0.299 * r + 0.587 * g + 0.114 * b - 128.0;
            *blue = -0.168_736 * r - 0.331_264 * g + 0.5 * b;
            *red = 0.5 * r - 0.418_688 * g - 0.081_312 * b;
        }
    }
    [luma, blue, red]
}

fn rgb(luma: f32, blue: f32, red: f32) -> [u8; 3] {
    let luma = luma + 128.5;
    [(luma + 1.402 * red) as u8, (luma - 0.344_136 * blue - 0.714_136 * red) as u8, (luma + 1.772 * blue) as u8]
}

/// A quantisation table on libjpeg's scale of quality, and its inverse.
fn table(base: &[[u16; SIDE]; SIDE], quality: u8) -> Block {
    let quality = u32::from(quality.clamp(1, 100));
    let percent = if quality < 50 { 5000 / quality } else { 200 - 2 * quality };
    base.map(|row| row.map(|step| ((u32::from(step) * percent + 50) / 100).clamp(1, 255) as f32))
}

impl Plane {
    fn row(&self, y: usize) -> &[f32] {
        &self.values[y * self.stride..][..self.stride]
    }

    /// Half the size, each value the mean of four.
    fn halved(&self) -> Self {
        let stride = self.stride / 2;
        let mut values = Vec::with_capacity(self.values.len() / 4);
        for pair in self.values.chunks_exact(2 * self.stride) {
            let (above, below) = pair.split_at(self.stride);
            let squares = above.as_chunks::<2>().0.iter().zip(below.as_chunks::<2>().0);
            values.extend(squares.map(|([a, b], [c, d])| (a + b + c + d) * 0.25));
        }
        Self { stride, values }
    }

    /// Rounds every block to the steps of `table`.
    fn lose(&mut self, table: &Block) {
        let inverse = table.map(|row| row.map(|step| 1.0 / step));
        for start in (0..self.values.len()).step_by(SIDE * self.stride) {
            for left in (0..self.stride).step_by(SIDE) {
                let at = |row: usize| start + row * self.stride + left;
                let block: Block = from_fn(|row| from_fn(|column| self.values[at(row) + column]));
                let mut seen = transposed(&forward(&transposed(&forward(&block))));
                for row in 0..SIDE {
                    for column in 0..SIDE {
                        seen[row][column] = rounded(seen[row][column] * inverse[row][column]) * table[row][column];
                    }
                }
                let block = transposed(&backward(&transposed(&backward(&seen))));
                for (row, values) in block.iter().enumerate() {
                    self.values[at(row)..at(row) + SIDE].copy_from_slice(values);
                }
            }
        }
    }
}

/// The nearest whole number, for numbers below a million.
#[inline]
fn rounded(x: f32) -> f32 {
    // Adding 1.5 * 2^23 leaves no bits for the fraction.
    const LARGE: f32 = 12_582_912.0;
    (x + LARGE) - LARGE
}

#[inline]
fn transposed(block: &Block) -> Block {
    from_fn(|row| from_fn(|column| block[column][row]))
}

/// `cos((2 place + 1) frequency pi / 16) / 2`, so that the transform keeps lengths.
const fn basis(frequency: usize, place: usize) -> f32 {
    if frequency == 0 {
        return HALF_COSINES[4];
    }
    let angle = (2 * place + 1) * frequency % 32;
    let mirrored = if angle > 16 { 32 - angle } else { angle };
    if mirrored > 8 { -HALF_COSINES[16 - mirrored] } else { HALF_COSINES[mirrored] }
}

/// The basis of even frequencies (first index) or odd ones over the first four places; the other four mirror it.
const fn half_basis(odd: usize) -> [[f32; 4]; 4] {
    let mut half = [[0.0; 4]; 4];
    let mut k = 0;
    while k < 4 {
        let mut place = 0;
        while place < 4 {
            half[k][place] = basis(2 * k + odd, place);
            place += 1;
        }
        k += 1;
    }
    half
}

const EVEN: [[f32; 4]; 4] = half_basis(0);
const ODD: [[f32; 4]; 4] = half_basis(1);

/// Cosine transform down the columns, all eight at once.
#[inline]
fn forward(block: &Block) -> Block {
    let mut out = [[0.0; SIDE]; SIDE];
    for place in 0..4 {
        for column in 0..SIDE {
            let (a, b) = (block[place][column], block[7 - place][column]);
            let (sum, difference) = (a + b, a - b);
            for k in 0..4 {
                out[2 * k][column] += EVEN[k][place] * sum;
                out[2 * k + 1][column] += ODD[k][place] * difference;
            }
        }
    }
    out
}

/// The inverse of [`forward`].
#[inline]
fn backward(block: &Block) -> Block {
    let mut out = [[0.0; SIDE]; SIDE];
    for place in 0..4 {
        for column in 0..SIDE {
            let (mut even, mut odd) = (0.0, 0.0);
            for k in 0..4 {
                even += EVEN[k][place] * block[2 * k][column];
                odd += ODD[k][place] * block[2 * k + 1][column];
            }
            out[place][column] = even + odd;
            out[7 - place][column] = even - odd;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transform_has_an_inverse_and_keeps_lengths() {
        let block: Block = from_fn(|row| from_fn(|column| ((row * 31 + column * 17) % 23) as f32 - 11.0));
        let seen = transposed(&forward(&transposed(&forward(&block))));
        let back = transposed(&backward(&transposed(&backward(&seen))));
        let energy = |b: &Block| b.as_flattened().iter().map(|v| v * v).sum::<f32>();
        assert!((energy(&seen) / energy(&block) - 1.0).abs() < 1e-5);
        for (a, b) in block.as_flattened().iter().zip(back.as_flattened()) {
            assert!((a - b).abs() < 1e-4, "{a} became {b}");
        }
        // A level block has only its mean: eight times it, as in the standard.
        let level = transposed(&forward(&transposed(&forward(&[[3.0; SIDE]; SIDE]))));
        assert!((level[0][0] - 24.0).abs() < 1e-4 && level.as_flattened()[1..].iter().all(|v| v.abs() < 1e-5));
    }

    /// The bytes that a picture has after the `image` crate wrote it as a JPEG file and read it again.
    fn through_a_file(bytes: &[u8], [width, height]: [usize; 2], quality: u8) -> Vec<u8> {
        let mut file = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, quality);
        let image = image::RgbImage::from_raw(width as u32, height as u32, bytes.to_vec()).expect("an image");
        image.write_with_encoder(encoder).expect("a JPEG file");
        image::load_from_memory(&file).expect("the same file").to_rgb8().into_raw()
    }

    fn deviation(a: &[u8], b: &[u8]) -> f64 {
        let squares: f64 = a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
        (squares / a.len() as f64).sqrt()
    }

    #[test]
    fn it_loses_about_what_a_real_file_loses() {
        let size = [83, 45];
        // Grey, so that the halved chroma, which the crate's encoder does not do, has no part in it.
        let grey = (0..83 * 45).map(|i| ((i % 83) * 3 % 200 + (i / 83 * 7) % 50 + (i * i) % 13) as u8);
        let picture: Vec<u8> = grey.flat_map(|v| [v; 3]).collect();
        for quality in [30, 60, 90] {
            let mut ours = picture.clone();
            compress(&mut ours, size, quality);
            let theirs = through_a_file(&picture, size, quality);
            let (lost, apart) = (deviation(&picture, &ours), deviation(&ours, &theirs));
            assert!(lost > 0.5, "quality {quality} loses {lost}");
            assert!(apart < 0.25 * lost + 0.5, "quality {quality}: {apart} from a real file, which loses {lost}");
        }
    }
}
