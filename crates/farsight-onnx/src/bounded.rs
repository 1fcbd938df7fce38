//! What files of strangers say, as far as it makes sense.

use crate::error::OnnxProblem;
use crate::field;
use crate::proto::FLOAT;
use crate::wire::{Message, Value, WireError};
use farsight_graph::weights::WeightTensor;

/// More nodes, constants or facts than this has no network of ours.
const MAX_COUNT: usize = 100_000;

/// How much of a stranger's name goes into a message.
const SHOWN: usize = 60;

/// The last text of this number in a message; none is empty.
pub(super) fn text_in(message: Message<'_>, number: u64) -> Result<&str, WireError> {
    Ok(message.last(number)?.map(Message::text).transpose()?.unwrap_or_default())
}

/// All texts of this number in a message.
pub(super) fn texts_in(message: Message<'_>, number: u64) -> Result<Vec<&str>, WireError> {
    message.all(number).map(|text| text?.text()).collect()
}

/// The floats of a constant of at most four axes, or what it is instead.
pub(super) fn floats(tensor: Message<'_>) -> Result<Result<WeightTensor, String>, WireError> {
    if tensor.number(field::TENSOR_TYPE)? != FLOAT as u64 {
        return Ok(Err("holds no floats".to_owned()));
    }
    let mut shape = Vec::new();
    for part in tensor.fields() {
        match part? {
            part if part.number != field::TENSOR_AXIS => {}
            part => match part.value {
                Value::Number(size) if shape.len() < 4 => shape.push(usize::try_from(size).unwrap_or(usize::MAX)),
                _ => return Ok(Err("has a shape of more than four axes".to_owned())),
            },
        }
    }
    let raw = tensor.last(field::TENSOR_RAW)?.map(Message::bytes).unwrap_or_default();
    let values = raw.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    Ok(WeightTensor::new(shape, values).map_err(|error| format!("does not fit its shape: {error}")))
}

/// The items up to the largest count that makes sense, then an error.
pub(super) fn counted<'a>(
    items: impl Iterator<Item = Result<Message<'a>, WireError>>,
    what: &'static str,
) -> impl Iterator<Item = Result<Message<'a>, OnnxProblem>> {
    items.enumerate().map(move |(count, item)| {
        if count >= MAX_COUNT {
            return Err(OnnxProblem::Count { what, limit: MAX_COUNT });
        }
        Ok(item?)
    })
}

/// A name as far as it goes into a message.
pub(super) fn shortened(name: &str) -> String {
    name.chars().take(SHOWN).collect()
}
