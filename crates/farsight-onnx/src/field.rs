//! Field numbers of `onnx.proto`, for what is read.

pub(super) const MODEL_GRAPH: u64 = 7;
pub(super) const MODEL_METADATA: u64 = 14;
pub(super) const MODEL_FUNCTIONS: u64 = 25;
pub(super) const ENTRY_KEY: u64 = 1;
pub(super) const ENTRY_VALUE: u64 = 2;
pub(super) const GRAPH_NODE: u64 = 1;
pub(super) const GRAPH_CONSTANT: u64 = 5;
pub(super) const GRAPH_INPUT: u64 = 11;
pub(super) const GRAPH_OUTPUT: u64 = 12;
pub(super) const NODE_INPUT: u64 = 1;
pub(super) const NODE_OUTPUT: u64 = 2;
pub(super) const NODE_OPERATOR: u64 = 4;
pub(super) const TENSOR_AXIS: u64 = 1;
pub(super) const TENSOR_TYPE: u64 = 2;
pub(super) const TENSOR_FLOATS: u64 = 4;
pub(super) const TENSOR_NAME: u64 = 8;
pub(super) const TENSOR_RAW: u64 = 9;
pub(super) const TENSOR_LOCATION: u64 = 14;
pub(super) const VALUE_NAME: u64 = 1;
pub(super) const VALUE_TYPE: u64 = 2;
pub(super) const TYPE_TENSOR: u64 = 1;
pub(super) const TENSOR_SHAPE: u64 = 2;
pub(super) const SHAPE_AXIS: u64 = 1;
pub(super) const AXIS_SIZE: u64 = 1;
