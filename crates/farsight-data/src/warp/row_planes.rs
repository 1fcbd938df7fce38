//! One row of an image, as planes of 0 to 255.

/// A row as three planes, one after the other.
#[derive(Debug, Default)]
pub(super) struct Planes(pub(super) Vec<f32>);

impl Planes {
    /// Makes room for `len` pixels; what they hold is left over from before.
    pub(super) fn resize(&mut self, len: usize) {
        self.0.resize(3 * len, 0.0);
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
