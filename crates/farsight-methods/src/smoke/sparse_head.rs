//! The regression head, computed only where the decoder asks: at the peaks of the heatmap.

use farsight_onnx::{HeadLayer, LocalHeadFile};

use super::codec::CHANNELS;

/// A convolution, `ReLU` and a 1x1 convolution, at single cells of a map of features.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseHead {
    /// Channels of the features.
    channels: usize,
    /// Cells a side of the first convolution's window.
    kernel: usize,
    /// Weights of the first convolution, `[channels kernel kernel, hidden]`: one tap after the other, so that the inner
    /// loop runs over all hidden channels.
    taps: Vec<f32>,
    hidden_bias: Vec<f32>,
    output: HeadLayer,
}

impl SparseHead {
    /// The head of a cut network.
    pub fn new(cut: &LocalHeadFile) -> Self {
        let weight = &cut.hidden.weight;
        let [hidden, channels, kernel] = [weight.shape[0], weight.shape[1], weight.shape[2]];
        let fan_in = channels * kernel * kernel;
        let taps = (0..fan_in).flat_map(|tap| (0..hidden).map(move |h| weight.values[h * fan_in + tap])).collect();
        Self { channels, kernel, taps, hidden_bias: cut.hidden.bias.values.clone(), output: cut.output.clone() }
    }

    /// Channels of the features that it reads.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The raw regression channels at `cell` (column, row).
    ///
    /// # Shapes
    /// `features` is `[channels, height, width]`, `map_size` its width and height. Outside the map the features are
    /// zero.
    ///
    /// # Panics
    /// When `features` has fewer values than that, or `cell` lies outside.
    pub fn regression(&self, features: &[f32], map_size: [usize; 2], cell: [usize; 2]) -> [f64; CHANNELS] {
        let mut hidden = self.hidden_bias.clone();
        let mut taps = self.taps.chunks_exact(hidden.len());
        for plane in features.chunks_exact(map_size[0] * map_size[1]).take(self.channels) {
            for value in self.patch(plane, map_size, cell) {
                let Some(weights) = taps.next() else { break };
                for (sum, weight) in hidden.iter_mut().zip(weights) {
                    *sum += value * weight;
                }
            }
        }
        let output = &self.output;
        std::array::from_fn(|channel| {
            let weights = &output.weight.values[channel * hidden.len()..][..hidden.len()];
            let products = hidden.iter().zip(weights).map(|(h, w)| f64::from(h.max(0.0)) * f64::from(*w));
            products.sum::<f64>() + f64::from(output.bias.values[channel])
        })
    }

    /// The window around `cell`, row by row.
    fn patch<'a>(
        &self,
        plane: &'a [f32],
        [width, height]: [usize; 2],
        cell: [usize; 2],
    ) -> impl Iterator<Item = f32> + 'a {
        let (kernel, reach) = (self.kernel, self.kernel / 2);
        (0..kernel * kernel).map(move |tap| {
            // Padded by `reach` on all sides the window begins at the cell itself.
            let column = (cell[0] + tap % kernel).checked_sub(reach).filter(|&column| column < width);
            let row = (cell[1] + tap / kernel).checked_sub(reach).filter(|&row| row < height);
            column.zip(row).map_or(0.0, |(column, row)| plane[row * width + column])
        })
    }
}
