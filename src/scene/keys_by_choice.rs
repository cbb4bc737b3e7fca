//! Tables in which a key, such as a kind or a law, decides which other keys they may have.

/// A table some of whose keys belong to some values of others only, as the parameters of an integrator do.
pub(super) struct KeysByChoice {
    /// The table.
    pub table: &'static str,
    /// The keys that decide.
    pub choices: &'static [&'static str],
    /// The keys that belong to some of their values.
    pub keys: fn() -> Vec<&'static str>,
    /// Those of them that belong to the values that `chosen` gives of a choice; `None` if a value is unknown.
    pub accepted: fn(chosen: &dyn Fn(&str) -> Option<String>) -> Option<Vec<&'static str>>,
}
