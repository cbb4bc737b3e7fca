//! The JSON Schema of scenes, derived from their tables and from the registries of laws, models and integrators.

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};

use super::Scene;
use crate::actuation::KINDS;
use crate::fluid::laws::LAWS;
use crate::integrator::METHODS;
use crate::reduced::MODELS;

/// The schema of a type that is read from TOML, which has no null. Doc comments become its descriptions.
pub(crate) fn of<T: JsonSchema>() -> Value {
    let mut schema = SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<T>().to_value();
    tidy(&mut schema);
    schema
}

/// Removes null, and links to the documentation of the library.
fn tidy(value: &mut Value) {
    match value {
        Value::Array(values) => values.iter_mut().for_each(tidy),
        Value::Object(entries) => {
            entries.values_mut().for_each(tidy);
            without_null(entries);
            if let Some(Value::String(text)) = entries.get_mut("description") {
                *text = text.replace("[`", "").replace("`]", "").replace('`', "").replace('\n', " ");
            }
        }
        _ => {}
    }
}

fn without_null(entries: &mut Map<String, Value>) {
    if entries.get("default").is_some_and(Value::is_null) {
        entries.remove("default");
    }
    if let Some(Value::Array(types)) = entries.get_mut("type") {
        types.retain(|kind| kind != "null");
        if let [single] = &types[..] {
            let single = single.clone();
            entries.insert("type".into(), single);
        }
    }
    if let Some(Value::Array(choices)) = entries.get_mut("anyOf") {
        choices.retain(|choice| *choice != json!({ "type": "null" }));
        if let [Value::Object(single)] = &choices[..] {
            let single = single.clone();
            entries.remove("anyOf");
            for (key, value) in single {
                entries.entry(key).or_insert(value);
            }
        }
    }
}

/// Restricts `key` of a table to `names`.
fn named(schema: &mut Value, table: &str, key: &str, names: impl Iterator<Item = &'static str>) {
    if let Some(property) = schema.pointer_mut(&format!("/$defs/{table}/properties/{key}")) {
        property["enum"] = names.collect();
    }
}

impl Scene {
    /// The JSON Schema (draft 2020-12) of scenes, for editors and for programs that write scenes. It describes keys, units and
    /// ranges of single values. Constraints between several keys are checked only when a scene is read.
    pub fn schema() -> Value {
        let mut schema = of::<Self>();
        schema["title"] = "A scene of caudal".into();
        named(&mut schema, "ActuationTable", "kind", KINDS.iter().map(|kind| kind.name));
        named(&mut schema, "DragTable", "law", LAWS.iter().map(|law| law.name));
        let viscous = LAWS.iter().filter(|law| law.resistance.is_some());
        named(&mut schema, "DragTable", "viscous", viscous.map(|law| law.name));
        named(&mut schema, "SolverTable", "integrator", METHODS.iter().map(|method| method.name));
        named(&mut schema, "SolverTable", "model", MODELS.iter().map(|kind| kind.name).chain(["auto"]));
        // The parameters of integrators are not fields of the struct.
        if let Some(solver) = schema.pointer_mut("/$defs/SolverTable") {
            solver["additionalProperties"] = false.into();
            for method in METHODS {
                for parameter in method.parameters {
                    let description = format!("Parameter of the integrator {}.", method.name);
                    let mut own = json!({ "type": "number", "description": description, "default": parameter.default });
                    for (bound, value) in ["minimum", "maximum"].into_iter().zip(parameter.range) {
                        if value.is_finite() {
                            own[bound] = value.into();
                        }
                    }
                    solver["properties"][parameter.name] = own;
                }
            }
        }
        schema
    }
}
