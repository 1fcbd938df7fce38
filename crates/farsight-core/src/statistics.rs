//! Order statistics.

/// The values from the smallest to the largest.
pub fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// The value below which this share of the sorted values, which must not be empty, lies; interpolated.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let position = share * (sorted.len() - 1) as f64;
    let (below, part) = (position.floor(), position.fract());
    let at = |index: f64| sorted[(index as usize).min(sorted.len() - 1)];
    at(below) + part * (at(below + 1.0) - at(below))
}

#[cfg(test)]
mod tests {
    use super::{quantile, sorted};

    #[test]
    fn quantiles_interpolate() {
        let sorted = sorted([3.0, 1.0, 4.0, 0.0, 2.0]);
        for (share, want) in [(0.0, 0.0), (0.5, 2.0), (0.625, 2.5), (1.0, 4.0)] {
            assert!((quantile(&sorted, share) - want).abs() < 1e-12, "{share}");
        }
    }
}
