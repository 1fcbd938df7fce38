//! Borrowed feature maps.

/// A feature map that somebody else owns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeatureMap<'a> {
    values: &'a [f32],
    channels: usize,
    height: usize,
    width: usize,
}

impl<'a> FeatureMap<'a> {
    /// `values` as `[channels, height, width]`; `None` when they are more or fewer than that.
    pub fn new(values: &'a [f32], [channels, height, width]: [usize; 3]) -> Option<Self> {
        let count = channels.checked_mul(height)?.checked_mul(width)?;
        (values.len() == count).then_some(Self { values, channels, height, width })
    }

    /// Channels, height and width.
    pub fn shape(&self) -> [usize; 3] {
        [self.channels, self.height, self.width]
    }

    /// The values of one channel, `[height, width]`.
    pub(super) fn plane(&self, channel: usize) -> &'a [f32] {
        let area = self.height * self.width;
        &self.values[channel * area..(channel + 1) * area]
    }
}
