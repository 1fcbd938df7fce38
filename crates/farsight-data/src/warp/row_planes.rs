//! One row of an image, as planes of 0 to 255.

/// A row as three planes, one after the other.
pub(super) struct Planes(pub(super) Vec<f32>);

impl Planes {
    pub(super) fn new(len: usize) -> Self {
        Self(vec![0.0; 3 * len])
    }

    pub(super) fn len(&self) -> usize {
        self.0.len() / 3
    }

    pub(super) fn channels(&self) -> [&[f32]; 3] {
        let len = self.len();
        [0, 1, 2].map(|channel| &self.0[channel * len..][..len])
    }

    pub(super) fn set(&mut self, index: usize, rgb: [f32; 3]) {
        let len = self.len();
        for (channel, value) in rgb.into_iter().enumerate() {
            self.0[channel * len + index] = value;
        }
    }
}
