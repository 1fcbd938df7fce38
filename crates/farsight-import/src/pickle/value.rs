//! What a pickle holds, as plain data.
//!
//! Names are shared and not copied: a stream of a few bytes may mention a long one a million times.

use std::rc::Rc;

use farsight_graph::weights::Element;

/// Place of a value in its [`super::Pickled`]. Values refer to each other by place, so that shared and even circular
/// ones are harmless.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Id(pub(super) u32);

/// One value of a pickle.
#[derive(Debug)]
pub(crate) enum Value {
    Bool(bool),
    Int(i64),
    /// An integer beyond 64 bits, two's complement, lowest byte first.
    BigInt(Box<[u8]>),
    Text(Rc<str>),
    List(Vec<Id>),
    Tuple(Vec<Id>),
    /// Entries in the order they were set; of equal keys the last one counts.
    Dict(Vec<(Id, Id)>),
    Global(Global),
    Storage(Box<Storage>),
    Tensor(Box<Tensor>),
    /// What calling a class or function that is not on the list would have given. Nothing was called.
    Object(Rc<str>),
    /// Data that no tensor depends on; the text says what, for errors.
    Other(&'static str),
}

impl Value {
    /// What this is, for errors.
    pub(crate) fn describe(&self) -> &str {
        match self {
            Self::Bool(_) => "a truth value",
            Self::Int(_) | Self::BigInt(_) => "an integer",
            Self::Text(_) => "a text",
            Self::List(_) => "a list",
            Self::Tuple(_) => "a tuple",
            Self::Dict(_) => "a dictionary",
            Self::Global(_) => "a class or function",
            Self::Storage(_) => "a storage",
            Self::Tensor(_) => "a tensor",
            Self::Object(class) => class,
            Self::Other(what) => what,
        }
    }
}

/// The classes and functions with a meaning here; of all others only the name is kept.
#[derive(Debug, Clone)]
pub(crate) enum Global {
    OrderedDict,
    /// `torch._utils._rebuild_tensor_v2(storage, offset, shape, strides, ...)`.
    RebuildTensor,
    /// `torch._utils._rebuild_parameter(tensor, ...)`.
    RebuildParameter,
    /// `torch.Size(tuple)`.
    Size,
    StorageType(&'static StorageType),
    Unknown(Rc<str>),
}

impl Global {
    pub(super) fn named(module: &str, name: &str) -> Self {
        match (module, name) {
            ("collections", "OrderedDict") => Self::OrderedDict,
            ("torch._utils", "_rebuild_tensor_v2") => Self::RebuildTensor,
            ("torch._utils", "_rebuild_parameter") => Self::RebuildParameter,
            ("torch", "Size") => Self::Size,
            _ => {
                let known = (module == "torch").then(|| STORAGE_TYPES.iter().find(|t| t.name == name)).flatten();
                known.map_or_else(|| Self::Unknown(format!("{module}.{name}").into()), Self::StorageType)
            }
        }
    }
}

/// A storage class of PyTorch.
#[derive(Debug)]
pub(crate) struct StorageType {
    pub(crate) name: &'static str,
    /// Bytes of one number.
    pub(crate) size: usize,
    /// How to read it; none where a network's weights are never stored so.
    pub(crate) element: Option<Element>,
}

/// Every storage class that `torch.save` may name (PyTorch 2.11, `torch/storage.py`). Sizes of the unread ones are
/// needed to step over them.
const STORAGE_TYPES: [StorageType; 15] = [
    read_as("FloatStorage", Element::F32),
    read_as("HalfStorage", Element::F16),
    read_as("BFloat16Storage", Element::Bf16),
    read_as("DoubleStorage", Element::F64),
    read_as("LongStorage", Element::I64),
    skipped("IntStorage", 4),
    skipped("ShortStorage", 2),
    skipped("CharStorage", 1),
    skipped("ByteStorage", 1),
    skipped("BoolStorage", 1),
    skipped("ComplexFloatStorage", 8),
    skipped("ComplexDoubleStorage", 16),
    skipped("QInt8Storage", 1),
    skipped("QUInt8Storage", 1),
    skipped("QInt32Storage", 4),
];

const fn read_as(name: &'static str, element: Element) -> StorageType {
    StorageType { name, size: element.size(), element: Some(element) }
}

const fn skipped(name: &'static str, size: usize) -> StorageType {
    StorageType { name, size, element: None }
}

/// A block of numbers outside the pickle.
#[derive(Debug, Clone)]
pub(crate) struct Storage {
    /// Its name in the file.
    pub(crate) key: Rc<str>,
    pub(crate) kind: &'static StorageType,
    /// How many numbers it holds.
    pub(crate) count: usize,
}

/// A view of a storage.
#[derive(Debug)]
pub(crate) struct Tensor {
    pub(crate) storage: Storage,
    /// First number, counted in numbers.
    pub(crate) offset: usize,
    pub(crate) shape: Vec<usize>,
    /// Steps along the axes, counted in numbers.
    pub(crate) strides: Vec<usize>,
}
