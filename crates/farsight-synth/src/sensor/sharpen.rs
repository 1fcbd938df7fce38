//! Sharpening inside the camera: unsharp masking of the finished picture's brightness.

/// Adds what a blur takes away, `amount` times, to all channels alike.
///
/// The blur is binomial, 1 2 1 each way, so that halos are one to two pixels wide.
pub(super) fn sharpen(bytes: &mut [u8], [width, height]: [usize; 2], amount: f32) {
    if amount <= 0.0 || width < 3 || height < 3 {
        return;
    }
    let (pixels, _) = bytes.as_chunks::<3>();
    // Rec. 601 in 256ths.
    let luma: Vec<i32> =
        pixels.iter().map(|&[r, g, b]| 77 * i32::from(r) + 150 * i32::from(g) + 29 * i32::from(b)).collect();
    let across: Vec<i32> = luma
        .chunks_exact(width)
        .flat_map(|row| (0..width).map(|x| row[x.saturating_sub(1)] + 2 * row[x] + row[(x + 1).min(width - 1)]))
        .collect();
    let scaled = (amount * 256.0) as i32;
    let (pixels, _) = bytes.as_chunks_mut::<3>();
    for y in 0..height {
        let [above, below] = [y.saturating_sub(1), (y + 1).min(height - 1)];
        for x in 0..width {
            let at = |row: usize| across[row * width + x];
            let soft = (at(above) + 2 * at(y) + at(below)) / 16;
            // 256ths of 256ths of a grey value.
            let more = ((luma[y * width + x] - soft) / 16 * scaled) / 4096;
            for channel in &mut pixels[y * width + x] {
                *channel = (i32::from(*channel) + more).clamp(0, 255) as u8;
            }
        }
    }
}
