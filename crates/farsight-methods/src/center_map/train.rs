//! Tensors of targets that stand at cells of the maps, and losses there.

use tch::{Device, Kind, Reduction, Tensor};

use super::{DEPTH_EPSILON, HEADING_BINS};

/// What stands at the cells of the objects of several images.
pub(crate) struct AtCells<'a, T> {
    /// The image of each object, its column and row, and what stands there.
    objects: Vec<(usize, [usize; 2], &'a T)>,
    /// Width and height of the maps.
    map_size: [usize; 2],
    device: Device,
}

impl<'a, T> AtCells<'a, T> {
    /// The objects of each image; `cell_of` knows their columns and rows.
    pub(crate) fn new(
        images: impl Iterator<Item = &'a [T]>,
        map_size: [usize; 2],
        cell_of: impl Fn(&T) -> [usize; 2],
        device: Device,
    ) -> Self {
        let of_image = |(image, objects): (usize, &'a [T])| objects.iter().map(move |object| (image, object));
        let objects = images.enumerate().flat_map(of_image).map(|(image, object)| (image, cell_of(object), object));
        Self { objects: objects.collect(), map_size, device }
    }

    /// Where they are in flattened maps (`[batch, height, width]`), `[objects]`.
    pub(crate) fn cells(&self) -> Tensor {
        let [width, height] = self.map_size;
        let index =
            |(image, [column, row], _): &(usize, [usize; 2], &T)| ((image * height + row) * width + column) as i64;
        let cells: Vec<i64> = self.objects.iter().map(index).collect();
        Tensor::from_slice(&cells).to_device(self.device)
    }

    /// So many numbers of each, `[objects, columns]`.
    pub(crate) fn rows<const N: usize>(&self, values: impl Fn(&T) -> [f64; N]) -> Tensor {
        let values: Vec<f32> =
            self.objects.iter().flat_map(|(_, _, object)| values(object)).map(|v| v as f32).collect();
        Tensor::from_slice(&values).view([-1, N as i64]).to_device(self.device)
    }

    /// A class of each, `[objects]`.
    pub(crate) fn classes(&self, class: impl Fn(&T) -> usize) -> Tensor {
        let classes: Vec<i64> = self.objects.iter().map(|(_, _, object)| class(object) as i64).collect();
        Tensor::from_slice(&classes).to_device(self.device)
    }
}

/// The channels of a map `[batch, channels, height, width]` at flattened cells, `[cells, channels]`.
pub(crate) fn at_cells(map: &Tensor, cells: &Tensor) -> Tensor {
    let channels = map.size()[1];
    map.to_kind(Kind::Float).permute([0, 2, 3, 1]).reshape([-1, channels]).index_select(0, cells)
}

/// Depths, metres, of a raw channel.
pub(crate) fn depths_from_raw(raw: &Tensor) -> Tensor {
    (raw.sigmoid() + DEPTH_EPSILON).reciprocal() - 1.0
}

/// Mean absolute difference; zero without objects.
pub(crate) fn mean_l1(found: &Tensor, expected: &Tensor) -> Tensor {
    (found - expected).abs().sum(Kind::Float) / (expected.numel().max(1) as f64)
}

/// Cross entropy of the bins, and L1 of the residual in the right one; means over the objects.
///
/// # Shapes
/// `found` `[objects, 24]`, `bin` `[objects]`, `residual` `[objects, 1]`.
pub fn heading_loss(found: &Tensor, bin: &Tensor, residual: &Tensor) -> Tensor {
    let objects = residual.numel().max(1) as f64;
    let bins = HEADING_BINS as i64;
    let logits = found.narrow(1, 0, bins);
    let entropy = logits.cross_entropy_loss::<Tensor>(bin, None, Reduction::Sum, -100, 0.0) / objects;
    let found = found.narrow(1, bins, bins).gather(1, &bin.unsqueeze(1), false);
    entropy + (found - residual).abs().sum(residual.kind()) / objects
}
