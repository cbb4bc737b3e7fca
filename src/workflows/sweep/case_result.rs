//! The result of a case, as the journal of a sweep stores it.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::report::RodMotion;

/// The result of a case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CaseResult {
    /// Hash of its scene, with the values of the axes.
    pub scene_hash: String,
    /// The quantities of its summary; for a case that could not start, only `complete` and `ending` (the error).
    pub quantities: Map<String, Value>,
    /// Its motion, if recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<RodMotion>,
    /// Times (s) with the x of the centre of mass (m), over the whole run, of a case whose motion is recorded.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub path: Vec<[f64; 2]>,
    /// Time (s) and centre of mass (m) along its path, if recorded.
    pub trace: Vec<[f64; 3]>,
    /// Wall-clock time, s.
    pub wall_s: f64,
}

impl CaseResult {
    /// True if the case reached its end.
    pub fn complete(&self) -> bool {
        self.quantities.get("complete") == Some(&Value::Bool(true))
    }

    /// How it ended: "complete", or its error.
    pub fn ending(&self) -> &str {
        self.quantities.get("ending").and_then(Value::as_str).unwrap_or_default()
    }
}
