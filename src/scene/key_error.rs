//! The error of one key of a scene, found before file and line are known. The document adds these.

use crate::error::did_you_mean;

/// A key whose value is missing or not allowed. [`Document::error_at`](super::Document::error_at) adds file and line.
#[derive(Debug, Clone, PartialEq)]
pub struct KeyError {
    /// The dotted key. If the text does not contain it, the error is located at its nearest parent.
    pub key: String,
    /// What was found and what is allowed.
    pub problem: String,
}

/// The message about a key that is not among those `allowed`.
pub(super) fn unknown_key(allowed: &str, near: Option<&str>) -> String {
    format!("unknown key; allowed: {allowed}{}", did_you_mean(near))
}
