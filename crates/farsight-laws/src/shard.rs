//! What the manifest of a part needs of its room.

// It is the program's, not the library's.
#[path = "../../farsight/src/shard/manifest.rs"]
#[allow(dead_code, reason = "the program uses the rest")]
pub(crate) mod manifest;

/// No command line is of any effect here.
fn words() -> Vec<String> {
    Vec::new()
}
