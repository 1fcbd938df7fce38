//! The hash that every file of ours carries, and constants that no network computes with.

use sha2::{Digest, Sha256};

use farsight_graph::weights::{FILE_SHA256_KEY, hexadecimal};
use prost::Message as _;
use prost::encoding::{WireType, encode_key, encode_varint};

use crate::bounded::{shortened, text_in};
use crate::error::OnnxProblem;
use crate::field;
use crate::proto::{FLOAT, StringStringEntryProto};
use crate::wire::{Field, Message, Value};

/// The file with the hash of everything before it as its last fact.
pub(super) fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let value = hexadecimal(&Sha256::digest(&bytes));
    let entry = StringStringEntryProto { key: FILE_SHA256_KEY.to_owned(), value }.encode_to_vec();
    encode_key(field::MODEL_METADATA as u32, WireType::LengthDelimited, &mut bytes);
    encode_varint(entry.len() as u64, &mut bytes);
    bytes.extend(entry);
    bytes
}

/// Refuses a file that is not as it was written; says whether it carries a hash at all.
pub(super) fn check(model: Message<'_>) -> Result<bool, OnnxProblem> {
    let mut at = 0;
    for part in model.fields() {
        let Field { number, raw, value } = part?;
        if number == field::MODEL_METADATA
            && let Value::Bytes(entry) = value
            && text_in(entry, field::ENTRY_KEY)? == FILE_SHA256_KEY
        {
            let (before, after) = (&model.bytes()[..at], &model.bytes()[at + raw.len()..]);
            let found = hexadecimal(&Sha256::new().chain_update(before).chain_update(after).finalize());
            let expected = text_in(entry, field::ENTRY_VALUE)?;
            if found == expected {
                return Ok(true);
            }
            return Err(OnnxProblem::Hash { found, expected: shortened(expected) });
        }
        at += raw.len();
    }
    Ok(false)
}

/// Refuses floats that are not finite: a network with them answers nothing, without a word.
pub(super) fn check_floats(tensor: Message<'_>) -> Result<(), OnnxProblem> {
    if tensor.number(field::TENSOR_TYPE)? != u64::from(FLOAT.unsigned_abs()) {
        return Ok(());
    }
    let mut place = 0;
    for part in tensor.fields() {
        let part = part?;
        let bytes = match (part.number, part.value) {
            (field::TENSOR_RAW | field::TENSOR_FLOATS, Value::Bytes(floats)) => floats.bytes(),
            // One float that is not packed with others: its key, then its four bytes.
            (field::TENSOR_FLOATS, Value::Fixed) => &part.raw[part.raw.len().saturating_sub(size_of::<f32>())..],
            _ => continue,
        };
        let floats = bytes.as_chunks().0;
        if let Some(found) = floats.iter().position(|float| !f32::from_le_bytes(*float).is_finite()) {
            let (name, value) = (shortened(text_in(tensor, field::TENSOR_NAME)?), f32::from_le_bytes(floats[found]));
            return Err(OnnxProblem::NotFinite { name, place: place + found, value });
        }
        place += floats.len();
    }
    Ok(())
}
