//! Tables in which the value of a key, such as a kind or a law, determines the other allowed keys.

/// Returns the value of a deciding key, by the name of the key.
pub(super) type Chosen<'a> = dyn Fn(&str) -> Option<String> + 'a;

/// A table in which some keys are allowed only for some values of others, such as the parameters of an integrator.
pub(super) struct KeysByChoice {
    /// The table.
    pub table: &'static str,
    /// The deciding keys.
    pub choices: &'static [&'static str],
    /// The keys that are allowed only for some values of the deciding keys.
    pub keys: fn() -> Vec<&'static str>,
    /// Those of `keys` that are allowed for the chosen values; `None` if a value is unknown.
    pub accepted: fn(&Chosen<'_>) -> Option<Vec<&'static str>>,
}
