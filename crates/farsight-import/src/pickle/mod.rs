//! A pickle reader that runs nothing.
//!
//! Python's own reader calls whatever function a pickle names; this one only builds [`Value`]s. It knows the opcodes
//! that PyTorch writes and five globals with a meaning (see [`value::Global`]). Every other class or function becomes
//! an inert [`Value::Object`] that remembers the name, so that optimizer states and training notes do not get in the
//! way of the weights.
//!
//! What a hostile pickle cannot do: run code, overflow the call stack (nothing recurses, values refer to each other by
//! place), or take memory that is not in proportion to its own length.

mod input;
mod machine;
mod opcode;
#[cfg(test)]
mod tests;
mod value;

use thiserror::Error;

pub(crate) use value::{Id, Storage, Tensor, Value};

/// Most values in one pickle. A full training checkpoint of SMOKE has about 20,000.
const MAX_VALUES: usize = 1 << 21;

/// Why a pickle could not be read. `at` is the byte where the trouble is, counted from the start of the pickle.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PickleError {
    /// The stream ends too early.
    #[error("pickle byte {at}: the stream ends inside a value")]
    Truncated {
        /// Byte of the pickle.
        at: usize,
    },
    /// An opcode that PyTorch does not write.
    #[error("pickle byte {at}: unknown opcode 0x{opcode:02x}")]
    Opcode {
        /// Byte of the pickle.
        at: usize,
        /// The opcode.
        opcode: u8,
    },
    /// An opcode asks for more values than there are.
    #[error("pickle byte {at}: too few values on the stack")]
    Stack {
        /// Byte of the pickle.
        at: usize,
    },
    /// A memo entry is read before it was stored.
    #[error("pickle byte {at}: memo entry {index} was never stored")]
    Memo {
        /// Byte of the pickle.
        at: usize,
        /// Number of the entry.
        index: usize,
    },
    /// A value of another type was expected.
    #[error("pickle byte {at}: found {found}; expected {expected}")]
    Type {
        /// Byte of the pickle.
        at: usize,
        /// What is there.
        found: String,
        /// What belongs there.
        expected: &'static str,
    },
    /// More values than any checkpoint needs.
    #[error("pickle byte {at}: more than {MAX_VALUES} values")]
    TooMany {
        /// Byte of the pickle.
        at: usize,
    },
}

/// A whole pickle, read.
#[derive(Debug)]
pub(crate) struct Pickled {
    values: Vec<Value>,
    root: Id,
    /// Bytes of the pickle; what follows in the stream is not part of it.
    pub(crate) length: usize,
}

impl Pickled {
    /// Reads the pickle that `bytes` starts with.
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, PickleError> {
        machine::Machine::new(bytes).run()
    }

    /// The value that the whole pickle stands for.
    pub(crate) fn root(&self) -> &Value {
        self.get(self.root)
    }

    pub(crate) fn get(&self, id: Id) -> &Value {
        &self.values[id.0 as usize]
    }

    /// The entry of a dictionary under a text key; none when `value` is no dictionary.
    pub(crate) fn entry(&self, value: &Value, key: &str) -> Option<&Value> {
        let Value::Dict(entries) = value else { return None };
        let is_key = |id: Id| matches!(self.get(id), Value::Text(text) if **text == *key);
        entries.iter().rev().find(|(id, _)| is_key(*id)).map(|(_, value)| self.get(*value))
    }

    /// All storages that the pickle names, in the order of their first use; one storage may come several times.
    pub(crate) fn storages(&self) -> impl Iterator<Item = &Storage> {
        self.values.iter().filter_map(|value| match value {
            Value::Storage(storage) => Some(&**storage),
            _ => None,
        })
    }
}
