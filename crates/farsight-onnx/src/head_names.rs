//! Where a head lies that a decoder may compute at single cells.

use serde::{Deserialize, Serialize};

/// Where a head lies in a file, by name, as its metadata say.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HeadNames {
    /// The value that the head reads.
    pub(super) features: String,
    /// Weight and bias of its first convolution.
    pub(super) hidden: [String; 2],
    /// Weight and bias of its second.
    pub(super) output: [String; 2],
}

impl HeadNames {
    pub(super) fn to_json(&self) -> String {
        serde_json::json!(self).to_string()
    }
}
