//! Layers of overrides: merging the overrides of a layer, applying a layer to those below, and removing the keys that it excludes.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use super::actuation::ActuationTable;
use super::fluid::DragTable;
use super::head::HeadTable;
use super::key_error::KeyError;
use super::keys_by_choice::KeysByChoice;
use super::solver::SolverTable;
use super::start::StartTable;
use super::value::{SIGNAL_KEYS, refused};

/// Pairs of keys that exclude each other.
const ALTERNATIVES: [[&str; 2]; 6] = [
    ["time_step_s", "tolerance"],
    ["every", "interval_s"],
    ["stiffness_gradient", "stiffness_profile"],
    ["kappa_amp", "moment_amp_n_m"],
    ["density_kg_m3", "mass_per_length_kg_m"],
    ["damping_time_s", "loss_factor"],
];

/// Pairs in which the first key, in a higher layer, removes the second, but not vice versa.
const REMOVED_WITH: [[&str; 2]; 4] = [
    ["moment_amp_n_m", "kappa_reference_length_m"],
    ["moment_amp_n_m", "largest_1_m"],
    ["kappa_amp", "largest_moment_n_m"],
    ["damping_time_s", "loss_frequency_hz"],
];

/// The tables in which some keys are allowed only for some values of others.
const KEYS_BY_CHOICE: [&KeysByChoice; 5] = [
    &SolverTable::KEYS_BY_INTEGRATOR,
    &StartTable::KEYS_BY_KIND,
    &ActuationTable::KEYS_BY_KIND,
    &HeadTable::KEYS_BY_KIND,
    &DragTable::KEYS_BY_LAW,
];

/// The defaults of lists, so that an override may change one entry of a list that a scene does not give.
const DEFAULT_LISTS: [(&str, &str); 4] = [
    ("medium.flow_m_s", "[0.0, 0.0]"),
    ("actuation.envelope", "[1.0, 0.0]"),
    ("design.bounds", "[1e-2, 1e2]"),
    ("design.variables", "[\"stiffness\"]"),
];

/// The default of the list at `path`; empty if it has none.
fn default_list(path: &str) -> DeArray<'static> {
    let default = DEFAULT_LISTS.iter().find(|(key, _)| *key == path).map(|(_, list)| DeValue::parse(list));
    match default.map(|parsed| parsed.map(Spanned::into_inner)) {
        Some(Ok(DeValue::Array(entries))) => entries,
        _ => DeArray::new(),
    }
}

/// The dotted keys that exclude `key`.
#[cfg(feature = "report")]
pub(crate) fn exclusive_keys(key: &str) -> impl Iterator<Item = String> {
    let (table, name) = key.rsplit_once('.').unwrap_or(("", key));
    let pairs = ALTERNATIVES.iter().filter(move |pair| pair.contains(&name)).flatten();
    pairs.filter(move |other| **other != name).map(move |other| format!("{table}.{other}"))
}

/// The result of a layer operation: an error includes the span of its key in the texts.
type Layered = std::result::Result<(), (KeyError, Range<usize>)>;

/// Merges overrides of one layer. A key that is a table in one of them and a value in another is an error.
pub(super) fn merge_layer<'a>(base: &mut DeTable<'a>, more: DeTable<'a>, path: &str) -> Layered {
    for (key, value) in more {
        let place = key_in(path, key.get_ref());
        let there = base.get(&key).map(|value| value.get_ref().is_table());
        match (base.get_mut(&key).map(Spanned::get_mut), value.into_inner_with_span()) {
            (Some(DeValue::Table(base)), (DeValue::Table(more), _)) => merge_layer(base, more, &place)?,
            (_, (value, span)) => {
                if there.is_some_and(|table| table != value.is_table()) {
                    let found = refused("a table of its keys together with another value", "one of the two");
                    return Err((KeyError { key: place, problem: found }, key.span()));
                }
                base.remove(&key); // with its previous span
                base.insert(key, Spanned::new(span, value));
            }
        }
    }
    Ok(())
}

/// Marks a table that replaces another one completely; no scene has this key.
const WHOLE_TABLE: &str = "\0whole";

/// Marks the functions of time in the value of an override as values, because only here is it known whether a table was written
/// as `{ … }` or as dotted keys. `depth` is the number of keys before the value.
pub(super) fn mark_functions(table: &mut DeTable<'_>, depth: usize) {
    for (_, value) in table.iter_mut() {
        if let DeValue::Table(inner) = value.get_mut() {
            if depth <= 1 && is_function(inner) {
                inner.insert(Spanned::new(0..0, WHOLE_TABLE.into()), Spanned::new(0..0, DeValue::Boolean(true)));
            } else {
                mark_functions(inner, depth.saturating_sub(1));
            }
        }
    }
}

/// Removes the marks of [`mark_functions`].
fn remove_marks(value: &mut DeValue<'_>) {
    if let DeValue::Table(table) = value {
        table.remove(WHOLE_TABLE);
        table.iter_mut().for_each(|(_, value)| remove_marks(value.get_mut()));
    }
}

/// Applies a layer to the layers below it, table by table. Functions of time are values if they are [marked](mark_functions). The
/// entries of a list are addressed by their index from 0, as in `head.position_m.1.amplitude`.
///
/// # Errors
/// An index that a list does not have.
pub(super) fn apply_layer<'a>(base: &mut DeTable<'a>, over: DeTable<'a>, path: &str) -> Layered {
    for (key, value) in over {
        let place = key_in(path, key.get_ref());
        match (base.get_mut(&key).map(Spanned::get_mut), value.into_inner_with_span()) {
            (Some(DeValue::Table(base)), (DeValue::Table(over), _)) if !over.contains_key(WHOLE_TABLE) => {
                apply_layer(base, over, &place)?;
            }
            (Some(DeValue::Array(entries)), (DeValue::Table(over), _)) if are_places(&over) => {
                apply_to_entries(entries, over, &place)?;
                // The list belongs to this layer now.
                if let Some(list) = base.remove(&key) {
                    base.insert(key, list);
                }
            }
            (None, (DeValue::Table(over), span)) if are_places(&over) => {
                let mut entries = default_list(&place);
                apply_to_entries(&mut entries, over, &place)?;
                base.insert(key, Spanned::new(span, DeValue::Array(entries)));
            }
            (None, (DeValue::Table(over), span)) if !over.contains_key(WHOLE_TABLE) => {
                let mut own = DeTable::new();
                apply_layer(&mut own, over, &place)?;
                base.insert(key, Spanned::new(span, DeValue::Table(own)));
            }
            (_, (mut value, span)) => {
                remove_marks(&mut value);
                base.remove(&key); // with its previous span
                base.insert(key, Spanned::new(span, value));
            }
        }
    }
    Ok(())
}

/// The dotted key of `key` in the table at `path`.
fn key_in(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_string() } else { format!("{path}.{key}") }
}

/// True if all keys are indices of a list.
fn are_places(table: &DeTable<'_>) -> bool {
    !table.is_empty() && table.keys().all(|key| key.get_ref().parse::<usize>().is_ok())
}

/// Applies a layer to the entries of a list.
fn apply_to_entries<'a>(base: &mut DeArray<'a>, over: DeTable<'a>, path: &str) -> Layered {
    let count = base.len();
    for (key, value) in over {
        let place = key_in(path, key.get_ref());
        let Some(entry) = key.get_ref().parse().ok().and_then(|place: usize| base.get_mut(place)) else {
            let problem = match count {
                0 => refused("a place in a list without entries", "the whole list, in brackets"),
                1 => refused(format!("place {} of a list with one entry", key.get_ref()), "0"),
                _ => refused(
                    format!("place {} of a list with {count} entries", key.get_ref()),
                    format!("0 to {}", count - 1),
                ),
            };
            return Err((KeyError { key: place, problem }, key.span()));
        };
        match (entry.get_mut(), value.into_inner_with_span()) {
            (DeValue::Table(base), (DeValue::Table(over), _)) if !over.contains_key(WHOLE_TABLE) => {
                apply_layer(base, over, &place)?;
            }
            (DeValue::Array(base), (DeValue::Table(over), _)) if are_places(&over) => {
                apply_to_entries(base, over, &place)?;
            }
            (_, (mut value, span)) => {
                remove_marks(&mut value);
                *entry = Spanned::new(span, value);
            }
        }
    }
    Ok(())
}

/// True for a complete function of time.
fn is_function(table: &DeTable<'_>) -> bool {
    let whole = table.contains_key("table") || table.contains_key("amplitude") && table.contains_key("frequency_hz");
    whole && table.keys().all(|key| SIGNAL_KEYS.contains(&&**key.get_ref()))
}

/// Removes keys that keys of a higher layer exclude: alternatives, and keys of another integrator, law or kind.
pub(super) fn remove_excluded_keys(table: &mut DeTable<'_>, layer_of: &impl Fn(usize) -> usize) {
    let layer = |table: &DeTable<'_>, key: &str| table.get_key_value(key).map(|(key, _)| layer_of(key.span().start));
    for [a, b] in ALTERNATIVES {
        match (layer(table, a), layer(table, b)) {
            (Some(own), Some(other)) if own > other => drop(table.remove(b)),
            (Some(own), Some(other)) if own < other => drop(table.remove(a)),
            _ => {}
        }
    }
    for [own, other] in REMOVED_WITH {
        if layer(table, own).zip(layer(table, other)).is_some_and(|(own, other)| own > other) {
            table.remove(other);
        }
    }
    for (name, value) in table.iter_mut() {
        if let DeValue::Table(inner) = value.get_mut() {
            for by_choice in KEYS_BY_CHOICE.into_iter().filter(|by_choice| by_choice.table == name.get_ref()) {
                let chosen = |key: &str| Some(inner.get(key)?.get_ref().as_str()?.to_string());
                let highest = by_choice.choices.iter().filter_map(|key| layer(inner, key)).max();
                if let Some((accepted, highest)) = (by_choice.accepted)(&chosen).zip(highest) {
                    for key in (by_choice.keys)().into_iter().filter(|key| !accepted.contains(key)) {
                        if layer(inner, key).is_some_and(|layer| layer < highest) {
                            inner.remove(key);
                        }
                    }
                }
            }
            remove_excluded_keys(inner, layer_of);
        }
    }
}

trait IntoInnerWithSpan<T> {
    fn into_inner_with_span(self) -> (T, Range<usize>);
}

impl<T> IntoInnerWithSpan<T> for Spanned<T> {
    fn into_inner_with_span(self) -> (T, Range<usize>) {
        let span = self.span();
        (self.into_inner(), span)
    }
}
