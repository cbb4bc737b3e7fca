//! The keys of scenes that differ between runs, by value: how a number is written makes no difference.

use std::collections::{BTreeMap, BTreeSet};

use toml::Value;

use crate::scene::Document;

/// A key in which scenes differ.
#[derive(Debug, Clone, PartialEq)]
pub struct KeyDifference {
    /// The dotted key; entries of a list of tables have their places, from 0.
    pub key: String,
    /// Its value in each run; `None` where the scene does not have it, or is not known.
    pub values: Vec<Option<Value>>,
}

/// The keys in which the known `scenes` differ, overrides included, in the order of their names. A key that one scene sets and
/// another leaves at its default also differs.
pub fn differing_keys(scenes: &[Option<&Document>]) -> Vec<KeyDifference> {
    let of_scene = |document: &&Document| {
        let mut found = BTreeMap::new();
        if let Ok(table) = document.read_as::<toml::Table>() {
            flatten(Value::Table(table), "", &mut found);
            found.remove("name"); // runs are labelled by it
        }
        found
    };
    let scenes: Vec<Option<BTreeMap<String, Value>>> =
        scenes.iter().map(|scene| scene.as_ref().map(of_scene)).collect();
    let all: BTreeSet<&String> = scenes.iter().flatten().flat_map(BTreeMap::keys).collect();
    let differs = |key: &&String| {
        let mut values = scenes.iter().flatten().map(|scene| scene.get(*key));
        let first = values.next().flatten();
        values.any(|other| !is_equal(first, other))
    };
    let values = |key: &String| scenes.iter().map(|scene| scene.as_ref()?.get(key).cloned()).collect();
    all.into_iter().filter(differs).map(|key| KeyDifference { key: key.clone(), values: values(key) }).collect()
}

/// Collects the values below `value` by dotted keys.
fn flatten(value: Value, key: &str, found: &mut BTreeMap<String, Value>) {
    let inner = |name: &str| if key.is_empty() { name.to_string() } else { format!("{key}.{name}") };
    match value {
        // The presence of a table without keys has a meaning.
        Value::Table(table) if table.is_empty() && !key.is_empty() => {
            drop(found.insert(key.to_string(), Value::Table(table)))
        }
        Value::Table(table) => table.into_iter().for_each(|(name, value)| flatten(value, &inner(&name), found)),
        Value::Array(entries) if entries.iter().any(Value::is_table) => {
            entries.into_iter().enumerate().for_each(|(i, value)| flatten(value, &inner(&i.to_string()), found));
        }
        value => drop(found.insert(key.to_string(), value)),
    }
}

fn is_equal(a: Option<&Value>, b: Option<&Value>) -> bool {
    let number = |value: &Value| value.as_float().or_else(|| value.as_integer().map(|x| x as f64));
    match (a, b) {
        (Some(Value::Integer(a)), Some(Value::Integer(b))) => a == b,
        (Some(Value::Array(a)), Some(Value::Array(b))) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_equal(Some(a), Some(b)))
        }
        (Some(a), Some(b)) => match (number(a), number(b)) {
            (Some(a), Some(b)) => a == b,
            _ => a == b,
        },
        (None, None) => true,
        _ => false,
    }
}

/// A value as a scene has it, with the shortest digits.
pub fn shown(value: &Value) -> String {
    match value {
        Value::Float(x) if *x != 0.0 && !(1e-3..1e5).contains(&x.abs()) => format!("{x:e}"),
        Value::Float(x) => x.to_string(),
        Value::String(text) => text.clone(),
        Value::Array(entries) => format!("[{}]", entries.iter().map(shown).collect::<Vec<_>>().join(", ")),
        Value::Table(table) if table.is_empty() => "{}".to_string(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_are_written_differently_are_equal_and_overrides_count() {
        let one = Document::new(
            "a.toml",
            "[rod]\nnodes = 17\nlength_m = 0.001\nprofile = [[0, 1], [1.0, 2]]\nname = \"a\"\n",
        );
        let mut other = Document::new(
            "b.toml",
            "rod = { nodes = 17.0, length_m = 1e-3, profile = [[0.0, 1.0], [1, 2.0]], name = \"b\" }\n[[tendons]]\nn = 1\n",
        );
        let keys = |other: &Document| -> Vec<String> {
            differing_keys(&[Some(&one), Some(other), None]).into_iter().map(|found| found.key).collect()
        };
        assert_eq!(keys(&other), ["rod.name", "tendons.0.n"]);
        other.set("rod.name=a").ok();
        other.set("rod.nodes=9").ok();
        assert_eq!(keys(&other), ["rod.nodes", "tendons.0.n"]);
        let found = differing_keys(&[Some(&one), Some(&other), None]);
        assert_eq!(found[0].values, [Some(Value::Integer(17)), Some(Value::Integer(9)), None]);
    }

    #[test]
    fn values_are_shown_in_their_shortest_form() {
        let shown = |x: f64| super::shown(&Value::Float(x));
        assert_eq!([0.001, 1e6, 0.3, 1e-6, 0.0].map(shown), ["0.001", "1e6", "0.3", "1e-6", "0"]);
    }
}
