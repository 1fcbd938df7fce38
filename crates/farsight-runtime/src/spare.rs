//! Memory of earlier answers, for the next ones.

/// So many buffers are kept: as many as the network with the most outputs has, and a few.
const MOST: usize = 16;

/// Buffers that nobody uses now.
#[derive(Debug, Default)]
pub(crate) struct Spare(Vec<Vec<f32>>);

impl Spare {
    /// These values in the smallest buffer that has room for them, or in a new one.
    pub(crate) fn filled(&mut self, values: &[f32]) -> Vec<f32> {
        let fitting = (0..self.0.len()).filter(|&place| self.0[place].capacity() >= values.len());
        let place = fitting.min_by_key(|&place| self.0[place].capacity());
        let mut buffer = place.map_or_else(Vec::new, |place| self.0.swap_remove(place));
        buffer.clear();
        buffer.extend_from_slice(values);
        buffer
    }

    /// Keeps a buffer; one of those from before goes where there are too many.
    pub(crate) fn keep(&mut self, buffer: Vec<f32>) {
        if self.0.len() == MOST {
            self.0.swap_remove(0);
        }
        self.0.push(buffer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_are_used_again_where_they_fit() {
        let mut spare = Spare::default();
        let [small, large] = [spare.filled(&[1.0; 8]), spare.filled(&[2.0; 100])];
        let places = [small.as_ptr(), large.as_ptr()];
        spare.keep(large);
        spare.keep(small);
        let [small, large] = [spare.filled(&[3.0; 7]), spare.filled(&[4.0; 90])];
        assert_eq!([small.as_ptr(), large.as_ptr()], places);
        assert_eq!([small, large], [vec![3.0; 7], vec![4.0; 90]]);
        assert_eq!(spare.filled(&[5.0; 3]), [5.0; 3], "there is none left");
        (0..2 * MOST).for_each(|_| spare.keep(vec![0.0]));
        assert_eq!(spare.0.len(), MOST);
    }
}
