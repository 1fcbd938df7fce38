//! Which scores become thresholds (spec rule 17).

use super::RECALL_POINTS;

/// Positions, in the falling list of `matched` scores of true positives, of those at which recall comes nearest to 0,
/// 1/40, ... 1; the last score is always one.
///
/// The recall aimed at is **summed up**, as the devkit does: `k / 40` would choose other scores for most numbers of
/// objects.
pub(super) fn threshold_positions(objects: u64, matched: u64) -> Vec<u64> {
    /// How far before the middle between two aims the search starts; rounding moves it by far less.
    const MARGIN: f64 = 4.0;
    let recall = |count: u64| count as f64 / objects as f64;
    let mut aim = 0.0;
    let mut positions = Vec::with_capacity(RECALL_POINTS);
    let mut position = 0;
    // Never more than 41 for any number of objects tried; a longer list would have no place on the curve.
    while position < matched && positions.len() < RECALL_POINTS {
        // The devkit asks this of every position; all before this one are further away.
        position = position.max((aim * objects as f64 - MARGIN) as u64).min(matched - 1);
        while position + 1 < matched && recall(position + 2) - aim < aim - recall(position + 1) {
            position += 1;
        }
        positions.push(position);
        position += 1;
        aim += 1.0 / (RECALL_POINTS as f64 - 1.0);
    }
    positions
}

#[cfg(test)]
mod tests {
    use super::threshold_positions;

    /// The devkit's loop, position by position.
    fn one_by_one(objects: u64, matched: u64) -> Vec<u64> {
        let recall = |count: u64| count as f64 / objects as f64;
        let mut aim = 0.0;
        let mut positions = Vec::new();
        for i in 0..matched {
            if i + 1 < matched && recall(i + 2) - aim < aim - recall(i + 1) {
                continue;
            }
            positions.push(i);
            aim += 1.0 / 40.0;
        }
        positions.truncate(41);
        positions
    }

    #[test]
    fn no_position_is_passed_over() {
        for objects in (0..300).chain([997, 1000, 4096, 14_000, 99_999]) {
            let few = 0..=objects.min(60);
            for matched in few.chain([objects / 3, objects / 2, objects - objects / 7, objects]) {
                assert_eq!(
                    threshold_positions(objects, matched),
                    one_by_one(objects, matched),
                    "{matched} of {objects}"
                );
            }
        }
    }
}
