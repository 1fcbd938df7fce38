//! Tensors of what samples hold.

use tch::{Device, Tensor};

/// Planes of several images as one tensor, `[images, channels, height, width]`; `size` is width and height.
pub(crate) fn stacked<'a>(
    planes: impl Iterator<Item = &'a [f32]>,
    [width, height]: [usize; 2],
    device: Device,
) -> Tensor {
    let shape = [-1, height as i64, width as i64];
    let images: Vec<Tensor> = planes.map(|values| Tensor::from_slice(values).view(shape)).collect();
    Tensor::stack(&images, 0).to_device(device)
}
