//! Peaks of a heatmap: SMOKE's substitute for non-maximum suppression (spec section 10).

/// A local maximum of one class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Channel of the heatmap.
    pub class: usize,
    /// Column and row.
    pub cell: [usize; 2],
    /// Value of the map there.
    pub value: f32,
}

/// The `count` highest peaks of `map` (`[classes, height, width]`, `map_size` = width, height), of each class those
/// above its `floor`, highest first.
///
/// A cell is a peak when no neighbour of its 3x3 surroundings in the same class is higher; ties stay. Logits and
/// probabilities have the same peaks. Equal values come in the order of the map, so the answer is the same everywhere.
/// Values that are not numbers are no peaks.
///
/// # Panics
/// When a side of the map is 0.
pub fn peaks(map: &[f32], map_size: [usize; 2], count: usize, floor: impl Fn(usize) -> f32) -> Vec<Peak> {
    let [width, height] = map_size;
    let mut found = Vec::new();
    for (class, channel) in map.chunks_exact(width * height).enumerate() {
        let floor = floor(class);
        for row in 0..height {
            for column in 0..width {
                let value = channel[row * width + column];
                if value > floor && is_peak(channel, map_size, [column, row], value) {
                    found.push(Peak { class, cell: [column, row], value });
                }
            }
        }
    }
    // Stable, so equal values keep the order of the map.
    found.sort_by(|a, b| b.value.total_cmp(&a.value));
    found.truncate(count);
    found
}

fn is_peak(channel: &[f32], [width, height]: [usize; 2], [column, row]: [usize; 2], value: f32) -> bool {
    let columns = column.saturating_sub(1)..(column + 2).min(width);
    (row.saturating_sub(1)..(row + 2).min(height)).all(|r| {
        channel[r * width + columns.start..r * width + columns.end]
            .iter()
            .all(|&other| other <= value || other.is_nan())
    })
}
