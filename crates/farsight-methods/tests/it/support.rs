//! Running SMOKE's networks on the built-in engine.

use farsight_methods::smoke::HeadMaps;
use farsight_methods::smoke::network::LOGITS;
use farsight_onnx::INPUT;
use farsight_runtime::{Runner, TensorView};

/// The maps of a batch of inputs of this size (width, height).
pub(crate) fn batch_head_maps(runner: &mut dyn Runner, values: &[f32], [width, height]: [usize; 2]) -> Vec<HeadMaps> {
    let shape = [values.len() / (3 * width * height), 3, height, width];
    let mut outputs = runner.run(&[(INPUT, TensorView { shape: &shape, values })]).unwrap();
    assert_eq!(runner.outputs()[0].name, LOGITS);
    let regression = outputs.pop().unwrap();
    HeadMaps::of_batch(outputs.pop().unwrap(), regression)
}

/// The maps of one input.
pub(crate) fn head_maps(runner: &mut dyn Runner, values: &[f32], size: [usize; 2]) -> HeadMaps {
    batch_head_maps(runner, values, size).remove(0)
}
