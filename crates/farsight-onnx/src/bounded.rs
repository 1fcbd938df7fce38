//! What files of strangers say, as far as it makes sense.

use crate::error::OnnxProblem;
use crate::wire::{Message, WireError};

/// More nodes, constants or facts than this has no network of ours.
const MAX_COUNT: usize = 100_000;

/// How much of a stranger's name goes into a message.
const SHOWN: usize = 60;

/// The last text of this number in a message; none is empty.
pub(super) fn text_in(message: Message<'_>, number: u64) -> Result<&str, WireError> {
    Ok(message.last(number)?.map(Message::text).transpose()?.unwrap_or_default())
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
