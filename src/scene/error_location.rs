//! Location and wording of TOML errors: the key at a byte of the text, the span of a key, and plain-English versions of serde's
//! messages.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

use super::key_error::unknown_key;
use crate::error::{did_you_mean, nearest};

/// The dotted key at byte `at`.
pub(super) fn key_at(table: &DeTable<'_>, at: usize) -> Option<String> {
    table.iter().find_map(|(key, value)| {
        let inner = match value.get_ref() {
            DeValue::Table(inner) => key_at(inner, at),
            DeValue::Array(items) => items.iter().enumerate().find_map(|(i, item)| match item.get_ref() {
                DeValue::Table(inner) => match key_at(inner, at) {
                    Some(inner) => Some(format!("{i}.{inner}")),
                    None => item.span().contains(&at).then(|| i.to_string()),
                },
                _ => None,
            }),
            _ => None,
        };
        match inner {
            Some(inner) => Some(format!("{}.{inner}", key.get_ref())),
            None if key.span().contains(&at) || value.span().contains(&at) => Some(key.get_ref().to_string()),
            None => None,
        }
    })
}

/// The span of `key`, or of its nearest parent if it is absent.
pub(super) fn span_of(table: &DeTable<'_>, key: &str) -> Option<Range<usize>> {
    let (first, rest) = key.split_once('.').map_or((key, None), |(first, rest)| (first, Some(rest)));
    let (name, value) = table.get_key_value(first)?;
    let inner = rest.and_then(|rest| match value.get_ref() {
        DeValue::Table(inner) => span_of(inner, rest),
        DeValue::Array(items) => {
            let (index, rest) = rest.split_once('.')?;
            let item = items.get(index.parse::<usize>().ok()?)?;
            item.get_ref().as_table().and_then(|inner| span_of(inner, rest))
        }
        _ => None,
    });
    Some(inner.unwrap_or_else(|| name.span()))
}

/// Rephrases an error `message` of serde at `key`; `source` is the text of the wrong value.
pub(crate) fn rephrase(key: String, message: &str, source: Option<&str>) -> (String, String) {
    let listed = |names: &str| names.trim_start_matches("one of ").to_string();
    if let Some((name, names)) =
        message.strip_prefix("unknown field `").and_then(|rest| rest.rsplit_once("`, expected "))
    {
        let near = nearest(name, names.split('`').skip(1).step_by(2));
        return (key, unknown_key(&listed(names), near));
    }
    if let Some(name) =
        message.strip_prefix("unknown field `").and_then(|rest| rest.strip_suffix("`, there are no fields"))
    {
        return (key, format!("found `{name}`; allowed: nothing, there are no options"));
    }
    if let Some(name) = message.strip_prefix("missing field `") {
        let name = name.trim_end_matches('`');
        let key = if key.is_empty() { name.to_string() } else { format!("{key}.{name}") };
        return (key, "missing; it has no default".to_string());
    }
    if let Some((name, names)) =
        message.strip_prefix("unknown variant `").and_then(|rest| rest.rsplit_once("`, expected "))
    {
        let near = nearest(name, names.split('`').skip(1).step_by(2));
        return (key, format!("found {name:?}; allowed: {}{}", listed(names), did_you_mean(near)));
    }
    for prefix in ["invalid type: ", "invalid value: ", "invalid length "] {
        if let Some((found, allowed)) = message.strip_prefix(prefix).and_then(|rest| rest.rsplit_once(", expected ")) {
            let found = match (found, source) {
                // The source of a table defined by a dotted key is that key.
                ("map", Some(text)) if text.starts_with(|c: char| c == '{' || c == '[' || c.is_ascii_digit()) => text,
                ("map", _) => "a table",
                (_, Some(text)) => text,
                ("sequence", None) => "a list",
                (other, None) => other,
            };
            let allowed = match allowed {
                "a string" => "a text in quotes",
                "a boolean" => "true or false",
                "a sequence" => "a list in brackets",
                "f64" => "a number",
                "i64" => "a whole number",
                "usize" | "u64" => "a whole number that is not negative",
                "an array of length 2" => "two values in brackets",
                table if table.starts_with("struct ") => "a table",
                other => other,
            };
            return (key, format!("found {found}; allowed: {allowed}"));
        }
    }
    let found = source.unwrap_or("another value");
    match message {
        "wanted string or table" => (key, format!("found {found}; allowed: a text in quotes")),
        "floating-point number overflowed" | "integer number overflowed" => {
            (key, format!("found {found}; allowed: a number below 1e308"))
        }
        other => (key, other.to_string()),
    }
}
