//! Whom to match with whom: the Hungarian method.

/// The column of each row in the assignment of least total cost; none where leaving the row alone, at the cost of 1,
/// is cheaper, or there are too few columns. Costs that are not finite are never taken.
///
/// Kuhn and Munkres' method with potentials, of the third order in the number of rows and columns.
pub fn assigned(costs: &[Vec<f64>]) -> Vec<Option<usize>> {
    let rows = costs.len();
    let columns = costs.iter().map(Vec::len).max().unwrap_or(0);
    // Each row has a column of its own besides, which leaves it alone.
    let cost = |row: usize, column: usize| {
        if column < columns {
            costs[row].get(column).copied().filter(|cost| cost.is_finite()).unwrap_or(NEVER)
        } else if column - columns == row {
            1.0
        } else {
            NEVER
        }
    };
    let all = columns + rows;
    // Row and column 0 are the method's own.
    let (mut row_price, mut column_price) = (vec![0.0; rows + 1], vec![0.0; all + 1]);
    let mut row_of = vec![0; all + 1];
    for row in 1..=rows {
        row_of[0] = row;
        let mut column = 0;
        let (mut least, mut came_from) = (vec![f64::INFINITY; all + 1], vec![0; all + 1]);
        let mut done = vec![false; all + 1];
        while row_of[column] != 0 {
            done[column] = true;
            let (here, mut step, mut next) = (row_of[column], f64::INFINITY, 0);
            for other in (1..=all).filter(|&other| !done[other]) {
                let reduced = cost(here - 1, other - 1) - row_price[here] - column_price[other];
                if reduced < least[other] {
                    (least[other], came_from[other]) = (reduced, column);
                }
                if least[other] < step {
                    (step, next) = (least[other], other);
                }
            }
            for other in 0..=all {
                if done[other] {
                    row_price[row_of[other]] += step;
                    column_price[other] -= step;
                } else {
                    least[other] -= step;
                }
            }
            column = next;
        }
        while column != 0 {
            let from = came_from[column];
            row_of[column] = row_of[from];
            column = from;
        }
    }
    let mut found = vec![None; rows];
    for column in 1..=columns {
        if row_of[column] != 0 && cost(row_of[column] - 1, column - 1) < NEVER {
            found[row_of[column] - 1] = Some(column - 1);
        }
    }
    found
}

/// Dearer than any assignment.
const NEVER: f64 = 1e9;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::assigned;

    /// The least total cost of all assignments from `row` on, tried one by one.
    fn least(costs: &[Vec<f64>], row: usize, taken: &mut Vec<bool>) -> f64 {
        if row == costs.len() {
            return 0.0;
        }
        let mut best = 1.0 + least(costs, row + 1, taken);
        for column in 0..taken.len() {
            if !taken[column] && costs[row][column].is_finite() {
                taken[column] = true;
                best = best.min(costs[row][column] + least(costs, row + 1, taken));
                taken[column] = false;
            }
        }
        best
    }

    proptest! {
        #[test]
        fn no_other_assignment_costs_less(
            rows in 0_usize..6,
            columns in 0_usize..6,
            numbers in prop::collection::vec(0.0..1.6, 36),
        ) {
            let cost = |i: usize| if numbers[i] > 1.4 { f64::INFINITY } else { numbers[i] };
            let costs: Vec<Vec<f64>> = (0..rows).map(|r| (0..columns).map(|c| cost(6 * r + c)).collect()).collect();
            let found = assigned(&costs);
            let mut columns_taken: Vec<usize> = found.iter().flatten().copied().collect();
            columns_taken.sort_unstable();
            columns_taken.dedup();
            prop_assert_eq!(columns_taken.len(), found.iter().flatten().count());
            let total: f64 = found.iter().enumerate().map(|(r, c)| c.map_or(1.0, |c| costs[r][c])).sum();
            let expected = least(&costs, 0, &mut vec![false; columns]);
            prop_assert!((total - expected).abs() < 1e-9, "{} is not {}", total, expected);
        }
    }

    #[test]
    fn the_cheapest_pair_gives_way_where_all_together_gain() {
        assert_eq!(assigned(&[vec![0.1, 0.2], vec![0.15, 0.9]]), [Some(1), Some(0)]);
        assert_eq!(assigned(&[vec![1.5], vec![f64::NAN]]), [None, None]);
        assert_eq!(assigned(&[]), []);
    }
}
