//! Reads the convolutions of a TFLite file.
//!
//! Such a file is a flatbuffer: tables of offsets, which are followed here with every step checked, and nothing else of
//! the file is used. The tables are those of TensorFlow's `schema.fbs`, version 3.

use std::collections::BTreeMap;

use crate::error::CheckpointProblem;
use farsight_graph::weights::{Element, WeightTensor, element_count};

/// Bytes 4 to 7 of every file.
const IDENTIFIER: &[u8] = b"TFL3";

/// Codes of operators (`BuiltinOperator`).
const CONV_2D: i32 = 3;
const DEPTHWISE_CONV_2D: i32 = 4;
const DEQUANTIZE: i32 = 6;

/// What TensorFlow puts behind the name of a layer, for its parts.
const PARTS: [&str; 2] = ["/Conv2D", "/BatchNorm/FusedBatchNormV3"];

/// Whether these are the bytes of a TFLite file.
pub fn is_tflite(bytes: &[u8]) -> bool {
    bytes.get(4..8) == Some(IDENTIFIER)
}

/// Weight and bias of every convolution, as `layer.weight` `[out, in, height, width]` (depthwise: `[channels, 1,
/// height, width]`) and `layer.bias` `[out]`; the layer is called as TensorFlow called it.
///
/// # Errors
/// When the bytes are no TFLite file, or of one that this reader does not know.
pub fn read_convolutions(bytes: &[u8]) -> Result<BTreeMap<String, WeightTensor>, CheckpointProblem> {
    let file = File::open(bytes).ok_or(CheckpointProblem::Tflite("a table lies outside the file"))?;
    file.convolutions()
}

/// The tables that matter.
struct File<'a> {
    /// Code of each kind of operator.
    codes: Vec<i32>,
    tensors: Vec<Table<'a>>,
    operators: Vec<Table<'a>>,
    buffers: Vec<Table<'a>>,
    /// Values that may still be given out: tensors may share buffers.
    budget: usize,
}

impl<'a> File<'a> {
    fn open(bytes: &'a [u8]) -> Option<Self> {
        let root = Table::at(bytes, 0)?;
        let graph = *root.tables(2)?.first()?;
        let code = |table: &Table<'_>| {
            // Codes above 127 came later and stand in a field of their own; the older one holds 127 then.
            let old = table.read(0, 0, |at| Some(i32::from(bytes.get(at)?.cast_signed())))?;
            let new = table.read(3, 0, |at| signed(bytes, at))?;
            Some(old.max(new))
        };
        Some(Self {
            codes: root.tables(1)?.iter().map(code).collect::<Option<_>>()?,
            tensors: graph.tables(0)?,
            operators: graph.tables(3)?,
            buffers: root.tables(4)?,
            budget: bytes.len(),
        })
    }

    fn convolutions(mut self) -> Result<BTreeMap<String, WeightTensor>, CheckpointProblem> {
        let broken = || CheckpointProblem::Tflite("an operator or a tensor lies outside the file");
        let mut sources = BTreeMap::new();
        let mut found = BTreeMap::new();
        for operator in std::mem::take(&mut self.operators) {
            let code = self.code(&operator).ok_or_else(broken)?;
            let inputs = operator.numbers(1).ok_or_else(broken)?;
            match code {
                // Half-precision files have the numbers behind such an operator.
                DEQUANTIZE => {
                    let outputs = operator.numbers(2).ok_or_else(broken)?;
                    sources.extend(outputs.first().copied().zip(inputs.first().copied()));
                }
                CONV_2D | DEPTHWISE_CONV_2D => {
                    let source = |place: usize| {
                        let id = inputs.get(place)?;
                        usize::try_from(*sources.get(id).unwrap_or(id)).ok()
                    };
                    let (weight, bias) = (source(1).ok_or_else(broken)?, source(2).ok_or_else(broken)?);
                    let name = self.name(weight).ok_or_else(broken)?;
                    let layer = layer(&name);
                    let (shape, values) = self.constant(weight)?;
                    let weight = convolution(&shape, &values, code == DEPTHWISE_CONV_2D);
                    let bias = self.constant(bias)?;
                    found.insert(
                        format!("{layer}.weight"),
                        weight.ok_or_else(|| CheckpointProblem::tflite_shape(&name, &shape))?,
                    );
                    found.insert(format!("{layer}.bias"), WeightTensor { shape: bias.0, values: bias.1 });
                }
                _ => {}
            }
        }
        Ok(found)
    }

    fn code(&self, operator: &Table<'_>) -> Option<i32> {
        let kind = operator.read(0, 0, |at| unsigned(operator.bytes, at))?;
        self.codes.get(kind).copied()
    }

    fn name(&self, tensor: usize) -> Option<String> {
        let table = self.tensors.get(tensor)?;
        let (start, length) = table.vector(3)?;
        Some(String::from_utf8_lossy(table.bytes.get(start..start.checked_add(length)?)?).into_owned())
    }

    /// Shape and values of a constant tensor of floats or half floats.
    fn constant(&mut self, tensor: usize) -> Result<(Vec<usize>, Vec<f32>), CheckpointProblem> {
        let broken = || CheckpointProblem::Tflite("a tensor lies outside the file");
        let name = self.name(tensor).ok_or_else(broken)?;
        let table = self.tensors[tensor];
        let kind = table.read(1, 0, |at| table.bytes.get(at).copied());
        let element = match kind {
            Some(0) => Element::F32,
            Some(1) => Element::F16,
            _ => {
                let found = "a tensor of another kind (TFLite)".to_owned();
                return Err(CheckpointProblem::NotATensor { name, found });
            }
        };
        let sizes = table.numbers(0).ok_or_else(broken)?;
        let shape: Vec<usize> =
            sizes.iter().map(|size| usize::try_from(*size)).collect::<Result<_, _>>().map_err(|_| broken())?;
        let buffer = table.read(2, 0, |at| unsigned(table.bytes, at));
        let buffer = buffer.and_then(|id| self.buffers.get(id)).ok_or_else(broken)?;
        let (start, length) = buffer.vector(0).ok_or_else(broken)?;
        let block = start.checked_add(length).and_then(|end| table.bytes.get(start..end)).ok_or_else(broken)?;
        let fits = element_count(&shape).and_then(|count| count.checked_mul(element.size())) == Some(block.len());
        if !fits {
            return Err(CheckpointProblem::tflite_shape(&name, &shape));
        }
        let values = element.decode(block);
        self.budget = self.budget.checked_sub(values.len()).ok_or(CheckpointProblem::TooMuch)?;
        Ok((shape, values))
    }
}

/// The layer whose weight is called so. Where TensorFlow joined several operations, their names stand one after the
/// other; the first is the layer's own.
fn layer(name: &str) -> &str {
    let first = name.split(';').next().unwrap_or(name);
    PARTS.iter().fold(first, |name, part| name.split(part).next().unwrap_or(name))
}

/// TFLite's order, `[out, height, width, in]` or depthwise `[1, height, width, channels]`, in ours.
fn convolution(shape: &[usize], values: &[f32], is_depthwise: bool) -> Option<WeightTensor> {
    let [first, height, width, last] = *shape else { return None };
    let (out, fan_in) = if is_depthwise { (last, first) } else { (first, last) };
    if is_depthwise && first != 1 {
        return None;
    }
    let cells = height * width;
    let at = |o: usize, i: usize, cell: usize| {
        if is_depthwise { cell * last + o } else { (o * cells + cell) * last + i }
    };
    let mut ours = Vec::with_capacity(values.len());
    for o in 0..out {
        for i in 0..fan_in {
            ours.extend((0..cells).map(|cell| values[at(o, i, cell)]));
        }
    }
    Some(WeightTensor { shape: vec![out, fan_in, height, width], values: ours })
}

/// A table: fields by their number, any of which may be absent.
#[derive(Clone, Copy)]
struct Table<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Where the places of the fields stand, and how many bytes that takes.
    fields: (usize, usize),
}

impl<'a> Table<'a> {
    /// The table that the offset at `at` leads to.
    fn at(bytes: &'a [u8], at: usize) -> Option<Self> {
        let at = at.checked_add(unsigned(bytes, at)?)?;
        let fields = usize::try_from(i64::try_from(at).ok()? - i64::from(signed(bytes, at)?)).ok()?;
        let length = short(bytes, fields)?;
        Some(Self { bytes, at, fields: (fields, length) })
    }

    /// What `present` reads where a field stands; `absent` when the table does not have it.
    fn read<T>(&self, field: usize, absent: T, present: impl FnOnce(usize) -> Option<T>) -> Option<T> {
        let (start, length) = self.fields;
        let slot = 4 + 2 * field;
        if slot + 2 > length {
            return Some(absent);
        }
        match short(self.bytes, start.checked_add(slot)?)? {
            0 => Some(absent),
            offset => present(self.at.checked_add(offset)?),
        }
    }

    /// Start and count of a vector; an absent one is empty.
    fn vector(&self, field: usize) -> Option<(usize, usize)> {
        self.read(field, (0, 0), |place| {
            let start = place.checked_add(unsigned(self.bytes, place)?)?;
            Some((start.checked_add(4)?, unsigned(self.bytes, start)?))
        })
    }

    /// A vector of four-byte items, all of them inside the file.
    fn items(&self, field: usize) -> Option<impl Iterator<Item = usize> + use<>> {
        let (start, count) = self.vector(field)?;
        let end = start.checked_add(count.checked_mul(4)?)?;
        (end <= self.bytes.len()).then(|| (start..end).step_by(4))
    }

    fn tables(&self, field: usize) -> Option<Vec<Self>> {
        self.items(field)?.map(|at| Self::at(self.bytes, at)).collect()
    }

    fn numbers(&self, field: usize) -> Option<Vec<i32>> {
        self.items(field)?.map(|at| signed(self.bytes, at)).collect()
    }
}

fn unsigned(bytes: &[u8], at: usize) -> Option<usize> {
    usize::try_from(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?)).ok()
}

fn signed(bytes: &[u8], at: usize) -> Option<i32> {
    Some(i32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn short(bytes: &[u8], at: usize) -> Option<usize> {
    Some(usize::from(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?)))
}
