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

/// Half the width of the interval that holds the next error with a probability of at least `share`, if it is drawn as
/// those `sorted` by size, of which there must be some, were: the one of rank `share * (n + 1)`, rounded up (split
/// conformal prediction; Vovk, Gammerman and Shafer 2005). The largest where they are too few to tell.
pub fn conformal_quantile(sorted: &[f64], share: f64) -> f64 {
    // What is a whole number but for rounding is that number.
    let rank = (share * (sorted.len() + 1) as f64 - 1e-9).ceil().max(1.0);
    sorted[(rank as usize).min(sorted.len()) - 1]
}

#[cfg(test)]
mod tests {
    use super::{conformal_quantile, quantile, sorted};

    /// The constants are what `scripts/make_conformal_goldens.py` prints: half widths of MAPIE's intervals.
    #[test]
    fn conformal_quantiles_are_those_of_mapie() {
        let error = |k: u32| -(-(f64::from(k) * 0.618_033_988_75).fract()).ln_1p();
        for (count, half_widths) in [
            (10, [0.826_235_012, 1.231_700_120, 2.887_270_950]),
            (19, [0.706_390_100, 1.231_700_120, 2.194_123_770]),
            (50, [0.706_390_100, 1.161_289_172, 2.319_725_530]),
            (99, [0.690_046_373, 1.161_289_172, 2.319_725_530]),
            (100, [0.706_390_100, 1.161_289_172, 2.319_725_530]),
            (333, [0.693_880_587, 1.161_289_172, 2.319_725_530]),
        ] {
            let errors = sorted((1..=count).map(error));
            for (share, want) in [0.5, 0.6827, 0.9].into_iter().zip(half_widths) {
                let found = conformal_quantile(&errors, share);
                assert!((found - want).abs() < 1e-8, "{count}, {share}: {found}, not {want}");
            }
        }
    }

    #[test]
    fn too_few_errors_give_the_largest() {
        assert_eq!(conformal_quantile(&[0.5], 0.9).to_bits(), 0.5_f64.to_bits());
        assert_eq!(conformal_quantile(&[0.5, 2.0], 0.9).to_bits(), 2.0_f64.to_bits());
        assert_eq!(conformal_quantile(&[0.5, 2.0], 0.0).to_bits(), 0.5_f64.to_bits());
    }

    #[test]
    fn quantiles_interpolate() {
        let sorted = sorted([3.0, 1.0, 4.0, 0.0, 2.0]);
        for (share, want) in [(0.0, 0.0), (0.5, 2.0), (0.625, 2.5), (1.0, 4.0)] {
            assert!((quantile(&sorted, share) - want).abs() < 1e-12, "{share}");
        }
    }
}
