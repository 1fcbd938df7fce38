//! Short vectors and small systems of linear equations.

/// The solution of `matrix` times x = `right` (Gauss and Jordan's elimination with the largest pivot); none where there
/// is not just one.
pub fn solved<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> Option<[f64; N]> {
    for column in 0..N {
        let pivot = (column..N).max_by(|&a, &b| matrix[a][column].abs().total_cmp(&matrix[b][column].abs()))?;
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        let (row, value) = (matrix[column], right[column]);
        if row[column] == 0.0 {
            return None;
        }
        for other in (0..N).filter(|other| *other != column) {
            let factor = matrix[other][column] / row[column];
            for (cell, entry) in matrix[other].iter_mut().zip(row) {
                *cell -= factor * entry;
            }
            right[other] -= factor * value;
        }
    }
    Some(std::array::from_fn(|i| right[i] / matrix[i][i]))
}

/// The sum of the products of the components.
pub fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The length of a vector.
pub fn norm<const N: usize>(v: &[f64; N]) -> f64 {
    dot(v, v).sqrt()
}

/// The vector across both, with a right hand.
pub fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::solved;

    #[test]
    fn systems_are_solved_with_pivots_and_singular_ones_are_told() {
        let [x, y, z] = solved([[0.0, 2.0, 1.0], [4.0, 0.0, 0.0], [1.0, 1.0, 1.0]], [7.0, 4.0, 6.0]).expect("regular");
        assert!((x - 1.0).abs() < 1e-12 && (y - 2.0).abs() < 1e-12 && (z - 3.0).abs() < 1e-12, "{x} {y} {z}");
        assert_eq!(solved([[1.0, 2.0], [2.0, 4.0]], [1.0, 2.0]), None);
    }
}
