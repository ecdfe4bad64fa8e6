//! The tables as a JSON Schema, by which editors complete and check graph and robot files while they are written.

use serde_json::{Map, Value as Json, json};
use toml::{Table, Value};

use super::range;
use super::{FOOTPRINT, GRAPH, Key, LIDAR, ODOMETRY, ROBOT, SERVICE, SIMULATOR, SONAR, SONARS, Section, TOPIC};

/// The draft that schemas are written in.
const DRAFT: &str = "http://json-schema.org/draft-07/schema#";

/// The schema of graph files.
pub fn graph() -> Json {
    let mut tables: Map<String, Json> =
        GRAPH.iter().map(|section| (section.name.to_owned(), table(section, &[]))).collect();
    for section in [&SERVICE, &TOPIC] {
        // The tables of what the user names.
        let each =
            json!({ "type": "object", "description": section.about, "additionalProperties": table(section, &[]) });
        tables.insert(section.name.to_owned(), each);
    }
    document("An echogrid graph", tables, &[])
}

/// The schema of robot files.
pub fn robot() -> Json {
    // There are no defaults for a robot's geometry.
    let whole = |section: &Section| table(section, &section.keys.iter().map(|key| key.name).collect::<Vec<_>>());
    let mut tables = properties(&ROBOT);
    for section in [&FOOTPRINT, &SONARS, &LIDAR] {
        tables.insert(section.name.to_owned(), whole(section));
    }
    tables.insert(SONAR.name.to_owned(), json!({ "type": "array", "items": whole(&SONAR) }));
    for section in [&ODOMETRY, &SIMULATOR] {
        tables.insert(section.name.to_owned(), table(section, &[]));
    }
    document("A robot of echogrid", tables, &["name"])
}

fn document(title: &str, properties: Map<String, Json>, required: &[&str]) -> Json {
    json!({
        "$schema": DRAFT,
        "title": title,
        "type": "object",
        "additionalProperties": false,
        "required": required,
        "properties": properties,
    })
}

fn table(section: &Section, required: &[&str]) -> Json {
    json!({
        "type": "object",
        "description": section.about,
        "additionalProperties": false,
        "required": required,
        "properties": properties(section),
    })
}

fn properties(section: &Section) -> Map<String, Json> {
    let mut defaults = (section.defaults)();
    let property = |key: &Key| {
        let default = defaults.remove(key.name);
        let mut property = Map::from_iter([
            ("description".to_owned(), json!(format!("{}; expected {}", key.about, key.expected))),
            ("anyOf".to_owned(), Json::Array(forms(section, key, default.as_ref()))),
        ]);
        property.extend(default.and_then(|default| Some(("default".to_owned(), serde_json::to_value(default).ok()?))));
        (key.name.to_owned(), Json::Object(property))
    };
    section.keys.iter().map(property).collect()
}

/// What a key takes: tried out on the type of its section, which decides.
fn forms(section: &Section, key: &Key, default: Option<&Value>) -> Vec<Json> {
    let takes = |value: Value| section.takes(key.name, &value).is_ok();
    let takes_default = |is_such: fn(&Value) -> bool| default.is_some_and(is_such);
    let mut forms = Vec::new();
    let is_number = takes(Value::Float(0.5)) || takes_default(Value::is_float);
    if is_number || takes(Value::Integer(1)) || takes_default(Value::is_integer) {
        let mut number = Map::from_iter([("type".to_owned(), json!(if is_number { "number" } else { "integer" }))]);
        number.extend(range::of(section, key, default, is_number));
        forms.push(Json::Object(number));
    }
    if takes(Value::Boolean(true)) {
        forms.push(json!({ "type": "boolean" }));
    }
    if takes(Value::from("/x")) || takes(Value::from("x")) {
        forms.push(json!({ "type": "string" }));
    } else if key.words.iter().any(|word| takes(Value::from(*word))) {
        forms.push(json!({ "enum": key.words }));
    }
    if takes_default(Value::is_array) && !key.words.is_empty() {
        forms.push(json!({ "type": "array", "items": { "enum": key.words } }));
    } else if takes_default(Value::is_array)
        || [vec![], vec![Value::Integer(0)], vec![Value::Float(0.0); 3]].map(Value::Array).into_iter().any(takes)
    {
        forms.push(json!({ "type": "array" }));
    }
    if takes(Value::Table(Table::new())) {
        forms.push(json!({ "type": "object" }));
    }
    forms
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether the schema takes a value: as far as these schemas go.
    fn takes(schema: &Json, value: &Json) -> bool {
        if let Some(forms) = schema["anyOf"].as_array() {
            return forms.iter().any(|form| takes(form, value));
        }
        if let Some(words) = schema["enum"].as_array() {
            return words.contains(value);
        }
        let within = |number: f64| {
            schema["minimum"].as_f64().is_none_or(|least| number >= least)
                && schema["maximum"].as_f64().is_none_or(|most| number <= most)
                && schema["exclusiveMinimum"].as_f64().is_none_or(|least| number > least)
                && schema["exclusiveMaximum"].as_f64().is_none_or(|most| number < most)
        };
        match (schema["type"].as_str().unwrap(), value) {
            ("number", Json::Number(number)) => within(number.as_f64().unwrap()),
            ("integer", Json::Number(number)) => !number.is_f64() && within(number.as_f64().unwrap()),
            ("boolean", Json::Bool(_)) | ("string", Json::String(_)) => true,
            ("array", Json::Array(items)) => {
                items.iter().all(|item| schema["items"].is_null() || takes(&schema["items"], item))
            }
            ("object", Json::Object(table)) => {
                let required = schema["required"].as_array().into_iter().flatten();
                let taken = |(name, value): (&String, &Json)| match schema["properties"].get(name) {
                    Some(property) => takes(property, value),
                    None if schema["additionalProperties"].is_object() => takes(&schema["additionalProperties"], value),
                    None => schema["additionalProperties"] != Json::Bool(false),
                };
                required.into_iter().all(|name| table.contains_key(name.as_str().unwrap())) && table.iter().all(taken)
            }
            _ => false,
        }
    }

    fn is_graph(text: &str) -> bool {
        takes(&graph(), &serde_json::to_value(toml::from_str::<Table>(text).unwrap()).unwrap())
    }

    #[test]
    fn files_that_are_shipped_are_taken() {
        let here = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        for (folder, schema) in [("../../launch/graphs", graph()), ("robots", robot())] {
            for file in std::fs::read_dir(here.join(folder)).unwrap() {
                let path = file.unwrap().path();
                let table: Table = toml::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
                assert!(takes(&schema, &serde_json::to_value(table).unwrap()), "{}", path.display());
            }
        }
    }

    #[test]
    fn every_key_takes_its_default() {
        for section in GRAPH {
            for (name, property) in properties(section) {
                assert!(takes(&property, &property["default"]), "{}.{name}: {property}", section.name);
            }
        }
    }

    #[test]
    fn what_check_takes_is_taken_and_what_it_refuses_is_not() {
        for text in [
            "[run]\nrate = \"max\"",
            "[run]\nrate = 2.5",
            "[mapper]\nmax_range_m = 4\nfilters = [\"range\"]\nsonars = [0, 1]",
            "[mapper]\nsonars = \"corridor\"\ndoubt = true",
            "[odometry]\nstart = [1, 2, 0.5]",
            "[services.sensor]\nexec = \"./robot\"\nenv = { A = \"b\" }\nnice = 5",
            "[topics.\"drive/goal\"]\ntype = \"acme/Goal/1\"\nbytes = 24",
        ] {
            assert!(is_graph(text), "{text}");
        }
        for text in [
            "[maper]",
            "[mapper]\nresolution = 0.1",
            "[mapper]\nresolution_m = \"5 cm\"",
            "[mapper]\nfilters = [\"bubbel\"]",
            "[mapper]\ndoubt = \"yes\"",
            "[run]\nalive_within_s = 0",
            "[mapper]\nresolution_m = 0",
            "[mapper]\np_free = 0.7",
            "[simulator]\nrays = 0",
            "[odometry]\nk_ll = -1",
            "[services.sensor]\nkind = \"sensr\"",
            "[topics.goal]\nbytes = 0",
        ] {
            assert!(!is_graph(text), "{text}");
        }
    }
}
