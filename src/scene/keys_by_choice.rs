//! Tables in which a key, such as a kind or a law, decides which other keys they may have.

/// The value of a key that decides, by the key.
pub(super) type Chosen<'a> = dyn Fn(&str) -> Option<String> + 'a;

/// A table some of whose keys belong to some values of others only, as the parameters of an integrator do.
pub(super) struct KeysByChoice {
    /// The table.
    pub table: &'static str,
    /// The keys that decide.
    pub choices: &'static [&'static str],
    /// The keys that belong to some of their values.
    pub keys: fn() -> Vec<&'static str>,
    /// Those of them that belong to the values that are chosen; `None` if a value is unknown.
    pub accepted: fn(&Chosen<'_>) -> Option<Vec<&'static str>>,
}
