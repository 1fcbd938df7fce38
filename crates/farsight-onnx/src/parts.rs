//! Nodes, attributes and constants in the making.

use std::collections::BTreeSet;

use crate::proto::{
    AttributeProto, Dimension, DimensionProto, FLOAT, GraphProto, INT8, INT32, INT64, NodeProto, TensorProto,
    TensorShapeProto, TensorTypeProto, TypeProto, UINT8, ValueInfoProto,
};
use farsight_graph::graph::Window;

/// A graph in the making: values are known by their names.
#[derive(Default)]
pub(super) struct Parts {
    graph: GraphProto,
    constants: BTreeSet<String>,
}

impl Parts {
    /// The finished nodes and constants.
    pub(super) fn finish(self) -> GraphProto {
        self.graph
    }

    /// Appends an operator with one output, called like the output, and returns that name.
    pub(super) fn node(
        &mut self,
        operator: &str,
        inputs: &[&str],
        output: &str,
        attribute: Vec<AttributeProto>,
    ) -> String {
        self.graph.node.push(NodeProto {
            input: inputs.iter().map(|&input| input.to_owned()).collect(),
            output: vec![output.to_owned()],
            name: output.to_owned(),
            op_type: operator.to_owned(),
            attribute,
        });
        output.to_owned()
    }

    /// A constant of floats; a second one of the same name is the first one.
    pub(super) fn floats(&mut self, name: &str, shape: &[usize], values: &[f32]) -> String {
        let raw_data = || values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constant(name.to_owned(), shape, FLOAT, raw_data)
    }

    /// A list of whole numbers, named after its values.
    pub(super) fn list(&mut self, values: &[i64]) -> String {
        let raw_data = || values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constant(format!("list {values:?}"), &[values.len()], INT64, raw_data)
    }

    /// One whole number.
    pub(super) fn whole(&mut self, value: i64) -> String {
        self.constant(format!("whole {value}"), &[], INT64, || value.to_le_bytes().to_vec())
    }

    /// One byte.
    pub(super) fn byte(&mut self, value: u8) -> String {
        self.constant(format!("byte {value}"), &[], UINT8, || vec![value])
    }

    /// A constant of whole numbers of 8 bits.
    pub(super) fn bytes(&mut self, name: &str, shape: &[usize], values: &[i8]) -> String {
        self.constant(name.to_owned(), shape, INT8, || values.iter().map(|value| value.cast_unsigned()).collect())
    }

    /// A constant of whole numbers of 32 bits.
    pub(super) fn words(&mut self, name: &str, shape: &[usize], values: &[i32]) -> String {
        let raw_data = || values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.constant(name.to_owned(), shape, INT32, raw_data)
    }

    /// One float.
    pub(super) fn float(&mut self, value: f32) -> String {
        self.floats(&format!("float {value}"), &[], &[value])
    }

    fn constant(
        &mut self,
        name: String,
        shape: &[usize],
        data_type: i32,
        raw_data: impl FnOnce() -> Vec<u8>,
    ) -> String {
        if self.constants.insert(name.clone()) {
            let dims = shape.iter().map(|&size| size as i64).collect();
            self.graph.initializer.push(TensorProto { dims, data_type, name: name.clone(), raw_data: raw_data() });
        }
        name
    }
}

/// A whole number as a setting.
pub(super) fn int(name: &str, value: i64) -> AttributeProto {
    AttributeProto { name: name.to_owned(), i: Some(value), kind: 2, ..AttributeProto::default() }
}

/// A list of whole numbers as a setting.
pub(super) fn ints(name: &str, values: &[i64]) -> AttributeProto {
    AttributeProto { name: name.to_owned(), ints: values.to_vec(), kind: 7, ..AttributeProto::default() }
}

/// A number as a setting.
pub(super) fn float(name: &str, value: f32) -> AttributeProto {
    AttributeProto { name: name.to_owned(), f: Some(value), kind: 1, ..AttributeProto::default() }
}

/// A word as a setting.
pub(super) fn word(name: &str, value: &str) -> AttributeProto {
    AttributeProto { name: name.to_owned(), s: Some(value.as_bytes().to_vec()), kind: 3, ..AttributeProto::default() }
}

/// An output at a quarter of the input's size.
pub(super) fn map_info(name: &str, channels: usize) -> ValueInfoProto {
    value_info(name, ["batch", "", "map_height", "map_width"], channels)
}

/// A tensor whose channels are known and whose other axes are called `axes`.
pub(super) fn value_info(name: &str, axes: [&str; 4], channels: usize) -> ValueInfoProto {
    let dimension = |axis: &str| match axis {
        "" => Dimension::Size(channels as i64),
        name => Dimension::Name(name.to_owned()),
    };
    let dim = axes.iter().map(|axis| DimensionProto { value: Some(dimension(axis)) }).collect();
    let tensor_type = Some(TensorTypeProto { elem_type: FLOAT, shape: Some(TensorShapeProto { dim }) });
    ValueInfoProto { name: name.to_owned(), kind: Some(TypeProto { tensor_type }) }
}

/// The settings of a convolution, transposed or not.
pub(super) fn convolution(window: Window, groups: usize) -> Vec<AttributeProto> {
    let Window { kernel, stride, padding, end_padding, dilation } = window;
    let [kernel, stride, padding, dilation] = [kernel, stride, padding, dilation].map(|value| value as i64);
    let end = padding + end_padding as i64;
    vec![
        ints("dilations", &[dilation; 2]),
        int("group", groups as i64),
        ints("kernel_shape", &[kernel; 2]),
        ints("pads", &[padding, padding, end, end]),
        ints("strides", &[stride; 2]),
    ]
}
