//! The guide's reference of scene keys is generated from the JSON Schema, and is current.

use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use serde_json::{Map, Value};

/// Set to write the reference in place of comparing it.
const WRITE: &str = "CAUDAL_WRITE_REFERENCE";

const INTRODUCTION: &str = r#"# Reference of scene keys

<!-- Generated from `caudal schema` and `caudal schema --sweep`; do not edit.
     CAUDAL_WRITE_REFERENCE=1 cargo test --test command reference -->

A scene is a TOML file. Its keys end in their units, which are SI units; an unknown key is an error. `caudal schema` prints
the same as a JSON Schema for editors. `caudal check SCENE` also checks keys against each other.

A key without a default is **required** or has no effect if absent. Some types can be written in several ways:

| Type | Written as |
|---|---|
| profile | a number, or points `[[ξ, value], …]` along the rod with linear interpolation; ξ is 0 at the first node and 1 at the tip |
| function of time | a number, or `{ amplitude, frequency_hz, phase_rad, offset }` for offset + amplitude sin(2π frequency_hz t + phase_rad), or `{ table = "file.csv" }` with columns for time, value and rate |
| vector of functions of time | two functions of time `[x, y]`, or one of the tables above with two numbers in place of one |
"#;

/// Units by the ends of keys, longer ends first.
const UNITS: [(&str, &str); 27] = [
    ("inertia_kg_m2", "kg m²"),
    ("_n_m_s", "N m s"),
    ("_n_m2", "N m²"),
    ("_n_s_m2", "N s/m²"),
    ("_kg_m3", "kg/m³"),
    ("_rad_s", "rad/s"),
    ("_pa_s", "Pa s"),
    ("_m_s2", "m/s²"),
    ("_m_s", "m/s"),
    ("_n_m", "N m"),
    ("_per_s", "1/s"),
    ("_rad", "rad"),
    ("_hz", "Hz"),
    ("_pa", "Pa"),
    ("_kg_m", "kg/m"),
    ("_kg", "kg"),
    ("_from_s", "s"),
    ("interval_s", "s"),
    ("duration_s", "s"),
    ("time_step_s", "s"),
    ("ramp_s", "s"),
    ("lag_s", "s"),
    ("window_s", "s"),
    ("_w", "W"),
    ("_1_m", "1/m"),
    ("_m", "m"),
    ("_n", "N"),
];

struct Reference<'a> {
    definitions: &'a Map<String, Value>,
    /// The kind of file, at the end of headings, for other files than scenes.
    file: &'static str,
    text: String,
    /// The definitions that have a section, with its heading.
    written: Vec<(String, String)>,
}

impl<'a> Reference<'a> {
    fn resolve(&self, schema: &'a Value) -> &'a Value {
        let name = schema["$ref"].as_str().and_then(|path| path.strip_prefix("#/$defs/"));
        name.map_or(schema, |name| &self.definitions[name])
    }

    /// The table that a key holds, if it holds one.
    fn table(&self, schema: &'a Value) -> Option<&'a Value> {
        let schema = self.resolve(schema);
        let alternatives = schema["anyOf"].as_array().into_iter().flatten();
        let constant = schema["anyOf"].as_array().is_some_and(|all| all.iter().any(|one| one.get("const").is_some()));
        let within = alternatives.filter(|_| constant).chain([schema]);
        within.into_iter().find(|one| one["properties"].is_object())
    }

    /// Writes the section of a table, and of those in it.
    fn section(&mut self, path: &str, heading: &str, description: &str, table: &'a Value) {
        let _ = write!(self.text, "\n## {heading}\n\n");
        if description.trim_end_matches('.') != heading.trim_matches('`') {
            let _ = write!(self.text, "{description}\n\n");
        }
        self.text.push_str("| Key | Type | Unit | Range | Default | Meaning |\n|---|---|---|---|---|---|\n");
        let required: Vec<&str> =
            table["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let properties = table["properties"].as_object().unwrap();
        let mut names = String::new();
        for (key, schema) in properties {
            let own = self.resolve(schema);
            let meaning = schema["description"].as_str().or(own["description"].as_str()).unwrap_or("");
            let meaning = if meaning.trim_end_matches('.') == format!("[{key}]") { "" } else { meaning };
            let (mut meaning, said) = without_default(meaning);
            let unit = match UNITS.iter().find(|(end, _)| key.ends_with(end)) {
                // A key ends in `n_m` for both.
                Some((_, "N m")) if meaning.contains("N/m") => "N/m",
                Some((_, unit)) => unit,
                None => "",
            };
            let default = match &schema["default"] {
                _ if !said.is_empty() => plain(&said),
                Value::Null if required.contains(&&**key) => "**required**".to_string(),
                Value::Null => String::new(),
                value => format!("`{}`", number(value)),
            };
            if !unit.is_empty() {
                for end in ['.', ';', ','] {
                    meaning = meaning.replacen(&format!(", {unit}{end}"), &end.to_string(), 1);
                }
            }
            if let Some(allowed) = own["enum"].as_array() {
                let allowed: Vec<String> = allowed.iter().map(|name| format!("`{}`", name.as_str().unwrap())).collect();
                let _ = write!(meaning, " One of {}.", allowed.join(", "));
            }
            let named = named(own).or_else(|| named(self.resolve(&own["items"])));
            if let Some(named) = named {
                let _ = write!(names, "\n`{key}` is one of:\n\n");
                for (name, meaning) in named {
                    let _ = writeln!(names, "- `{name}`: {}", plain(meaning));
                }
            }
            let (kind, range) = (self.kind(schema), range(own).unwrap_or_default());
            let _ = writeln!(self.text, "| `{key}` | {kind} | {unit} | {range} | {default} | {} |", plain(&meaning));
        }
        self.text.push_str(&names);
        for (key, schema) in properties {
            let inner = format!("{path}{key}");
            let (table, heading) = match self.table(&schema["items"]) {
                Some(table) => (Some(table), format!("`[[{inner}]]`{}", self.file)),
                None => (self.table(schema), format!("`[{inner}]`{}", self.file)),
            };
            let Some(table) = table else { continue };
            let description = schema["description"].as_str().unwrap_or("").to_string();
            let name = schema["$ref"].as_str().or(schema["items"]["$ref"].as_str()).unwrap_or("").to_string();
            if let Some((_, same)) = self.written.iter().find(|(own, _)| *own == name && !name.is_empty()) {
                let _ = write!(self.text, "\n## {heading}\n\n{description} Its keys are those of {same}.\n");
                continue;
            }
            self.written.push((name, heading.clone()));
            self.section(&format!("{inner}."), &heading, &description, table);
        }
    }

    /// The type of a value.
    fn kind(&self, schema: &'a Value) -> String {
        let schema = self.resolve(schema);
        if let Some(all) = schema["anyOf"].as_array() {
            let has = |one: &Value, key: &str| one["properties"].get(key).is_some();
            if all.iter().any(|one| has(one, "table")) {
                let vector = all.iter().any(|one| one["type"] == "array");
                return if vector { "vector of functions of time" } else { "function of time" }.to_string();
            }
            if all.iter().any(|one| one["items"]["prefixItems"].is_array()) {
                return "profile".to_string();
            }
            let mut kinds: Vec<String> = all.iter().map(|one| self.kind(one)).collect();
            kinds.dedup();
            return kinds.join(" or ");
        }
        if let Some(constant) = schema["const"].as_str() {
            return format!("`\"{constant}\"`");
        }
        if schema["oneOf"].is_array() || schema["enum"].is_array() {
            return "name".to_string();
        }
        match schema["type"].as_str() {
            Some("array") => {
                let items = self.resolve(&schema["items"]);
                let item = self.kind(items);
                match schema["maxItems"].as_u64() {
                    Some(2) => format!("[{item}, {item}]"),
                    _ if items["properties"].is_object() => "tables".to_string(),
                    _ => format!("list of {item}{}", if item.ends_with(']') { "" } else { "s" }),
                }
            }
            Some("object") => "table".to_string(),
            Some("string") => "string".to_string(),
            Some(kind) => kind.to_string(),
            None => "value".to_string(),
        }
    }
}

/// The names that a value may have, with their meanings.
fn named(schema: &Value) -> Option<Vec<(&str, &str)>> {
    let all = schema["oneOf"].as_array()?;
    Some(all.iter().map(|one| (one["const"].as_str().unwrap(), one["description"].as_str().unwrap_or(""))).collect())
}

/// The range of a number, or of the numbers in a list.
fn range(schema: &Value) -> Option<String> {
    if let Some(all) = schema["anyOf"].as_array() {
        return all.iter().find(|one| one["type"] == "number").and_then(range);
    }
    if schema["items"].is_object() {
        return range(&schema["items"]);
    }
    let bound = |key: &str| schema.get(key).map(number);
    let (least, above) = (bound("minimum"), bound("exclusiveMinimum"));
    let (most, below) = (bound("maximum"), bound("exclusiveMaximum"));
    match (least, above, most, below) {
        (Some(least), _, Some(most), _) => Some(format!("{least} … {most}")),
        (_, Some(above), _, Some(below)) => Some(format!("> {above}, < {below}")),
        (Some(least), ..) => Some(format!("≥ {least}")),
        (_, Some(above), ..) => Some(format!("> {above}")),
        _ => None,
    }
}

/// A number without needless digits; any other value as it is.
fn number(value: &Value) -> String {
    match value.as_f64() {
        Some(x) if x != 0.0 && !(1e-4..1e6).contains(&x.abs()) => format!("{x:e}"),
        Some(x) => format!("{x}"),
        None => value.to_string(),
    }
}

/// A description without the sentence about the default, and what that says.
fn without_default(description: &str) -> (String, String) {
    let Some((before, rest)) = description.split_once("By default") else {
        return (description.to_string(), String::new());
    };
    let (said, after) = rest.split_once(". ").unwrap_or((rest.trim_end_matches('.'), ""));
    let said = said.trim_start_matches(',').trim();
    (format!("{} {after}", before.trim_end()).trim_end().to_string(), said.to_string())
}

/// Text in a cell of a table.
fn plain(text: &str) -> String {
    text.replace('|', "\\|").replace('<', "&lt;")
}

fn schema(arguments: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_caudal")).args(arguments).output().unwrap();
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn the_reference_of_scene_keys_is_current() {
    let (scene, sweep) = (schema(&["schema"]), schema(&["schema", "--sweep"]));
    let definitions = scene["$defs"].as_object().unwrap();
    let mut reference = Reference { definitions, file: "", text: INTRODUCTION.to_string(), written: Vec::new() };
    reference.section("", "Scene", "The top level of the file.", &scene);
    let mut text = reference.text;

    let mut own = sweep.clone();
    let set = &mut own["properties"]["set"];
    set["description"] = "Keys of the base scene with other values for every case.".into();
    set.as_object_mut().unwrap().remove("properties"); // those of a scene, which stand above
    let definitions = sweep["$defs"].as_object().unwrap();
    let mut reference = Reference { definitions, file: " of a sweep", text: String::new(), written: Vec::new() };
    reference.section("", "Sweep", "The top level of the file of a [sweep](sweeps.md).", &own);
    text.push_str(&reference.text);

    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/src/reference.md");
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    let remedy = format!("{WRITE}=1 cargo test --test command reference");
    assert!(kept == text, "{} is not what the schema says; write it by: {remedy}", path.display());
}
