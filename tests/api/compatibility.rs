//! What version 0.1.0 offered is offered still: its document, reduced to what clients rely on, against that of today.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::{Value, json};

use crate::openapi::{document, operations};

/// Files under their names have operations of their own now.
const REPLACED: &str = "get /jobs/{id}/{file}";

#[test]
fn nothing_of_the_last_tagged_document_has_vanished_and_nothing_became_required() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/api/openapi-0.1.0.json");
    let tagged: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    assert_eq!(breaches(&tagged, &document()), Vec::<String>::new());
}

#[test]
fn a_document_with_less_or_with_more_demands_is_caught() {
    let tagged = json!({
        "operations": { "post /a": {
            "operationId": "a", "parameters": ["p"], "required": [], "words": { "p": ["x", "y"] },
            "body": { "required": false, "content": ["text/csv"] },
            "successes": { "200": { "application/json": "A" } }
        } },
        "fields": { "A": ["b"] }, "words": { "A.b": ["u"] }, "always": { "A": ["b"] }
    });
    let schema = json!({ "properties": { "b": { "type": ["array", "null"], "items": { "enum": ["u", "v"] } } }, "required": ["b"] });
    let parameter = json!({ "name": "p", "schema": { "enum": ["x", "y", "z"] } });
    let content = json!({ "application/json": { "schema": { "$ref": "#/components/schemas/A" } } });
    let operation = json!({
        "operationId": "a", "parameters": [parameter],
        "requestBody": { "content": { "text/csv": {}, "text/plain": {} } },
        "responses": { "200": { "content": content } }
    });
    let document =
        json!({ "paths": { "/a": { "post": operation } }, "components": { "schemas": { "A": schema } } });
    assert_eq!(breaches(&tagged, &document), Vec::<String>::new());
    let changed = |pointer: &str, value: Value| {
        let mut document = document.clone();
        *document.pointer_mut(pointer).unwrap() = value;
        breaches(&tagged, &document).join("; ")
    };
    let operation = "/paths/~1a/post";
    let schema = "/components/schemas/A";
    for (place, value, told) in [
        ("/paths/~1a".to_owned(), json!({}), "post /a has vanished"),
        (format!("{operation}/operationId"), json!("b"), "is called"),
        (format!("{operation}/parameters"), json!([]), "post /a: no parameter p"),
        (format!("{operation}/parameters/0/schema/enum"), json!(["x"]), "post /a: no p=y"),
        (
            format!("{operation}/parameters/0"),
            json!({ "name": "p", "required": true, "schema": parameter["schema"] }),
            "requires p",
        ),
        (format!("{operation}/requestBody/content"), json!({ "text/plain": {} }), "takes no text/csv"),
        (
            format!("{operation}/requestBody"),
            json!({ "required": true, "content": { "text/csv": {} } }),
            "requires a body",
        ),
        (format!("{operation}/responses"), json!({ "201": {} }), "no 200 with application/json of A"),
        (
            format!("{operation}/responses/200/content"),
            json!({ "text/csv": {} }),
            "no 200 with application/json of A",
        ),
        (format!("{schema}/properties"), json!({}), "A has no b"),
        (format!("{schema}/properties/b/items/enum"), json!(["v"]), "A.b: no u"),
        (format!("{schema}/required"), json!([]), "A has b at times only"),
    ] {
        let found = changed(&place, value);
        assert!(found.contains(told), "{told}: {found}");
    }
}

/// What `tagged` has and `document` has not, or what that demands beyond it.
fn breaches(tagged: &Value, document: &Value) -> Vec<String> {
    let now: BTreeMap<String, Value> = operations(document).into_iter().collect();
    let mut found = Vec::new();
    for (name, before) in entries(&tagged["operations"]).filter(|(name, _)| *name != REPLACED) {
        match now.get(name) {
            Some(operation) => breaches_of_operation(name, before, operation, &mut found),
            None => found.push(format!("{name} has vanished")),
        }
    }
    let schemas = &document["components"]["schemas"];
    for (name, fields) in entries(&tagged["fields"]) {
        let now = properties(&schemas[name]);
        let lost = words(fields).into_iter().filter(|field| !now.contains_key(*field));
        found.extend(lost.map(|field| format!("{name} has no {field}")));
    }
    for (place, before) in entries(&tagged["words"]) {
        let (name, field) = place.split_once('.').map_or((place, None), |(name, field)| (name, Some(field)));
        let schema = field.map_or(&schemas[name], |field| {
            properties(&schemas[name]).get(field).copied().unwrap_or(&Value::Null)
        });
        found.extend(without(before, &words(choices(schema))).map(|word| format!("{place}: no {word}")));
    }
    for (name, before) in entries(&tagged["always"]) {
        let mut always = BTreeSet::new();
        collect_required(&schemas[name], &mut always);
        found.extend(without(before, &always).map(|field| format!("{name} has {field} at times only")));
    }
    found
}

fn breaches_of_operation(name: &str, before: &Value, now: &Value, found: &mut Vec<String>) {
    if now["operationId"] != before["operationId"] {
        found.push(format!("{name} is called {}", now["operationId"]));
    }
    let parameters: Vec<&Value> = now["parameters"].as_array().into_iter().flatten().collect();
    let named = |wanted: &str| parameters.iter().find(|parameter| parameter["name"] == wanted);
    for parameter in words(&before["parameters"]) {
        if named(parameter).is_none() {
            found.push(format!("{name}: no parameter {parameter}"));
        }
    }
    let required = words(&before["required"]);
    let demanded = parameters.iter().filter(|parameter| parameter["required"] == true);
    let demanded = demanded.filter_map(|parameter| parameter["name"].as_str());
    found.extend(
        demanded
            .filter(|parameter| !required.contains(parameter))
            .map(|parameter| format!("{name} requires {parameter}")),
    );
    for (parameter, choice) in entries(&before["words"]) {
        let now = named(parameter).map_or(&Value::Null, |parameter| choices(&parameter["schema"]));
        found.extend(without(choice, &words(now)).map(|word| format!("{name}: no {parameter}={word}")));
    }
    let body = &now["requestBody"];
    if body["required"] == true && before["body"]["required"] != true {
        found.push(format!("{name} requires a body"));
    }
    let taken: BTreeSet<&str> = entries(&body["content"]).map(|(media_type, _)| media_type).collect();
    found.extend(
        without(&before["body"]["content"], &taken).map(|media_type| format!("{name} takes no {media_type}")),
    );
    for (status, content) in entries(&before["successes"]) {
        let response = &now["responses"][status];
        if response.is_null() {
            found.push(format!("{name} has no {status}"));
        }
        for (media_type, schema) in entries(content) {
            let answer = &response["content"][media_type];
            let reference =
                answer["schema"]["$ref"].as_str().and_then(|reference| reference.rsplit('/').next());
            if answer.is_null() || reference != schema.as_str() {
                let schema = schema.as_str().unwrap_or("bytes");
                found.push(format!("{name} has no {status} with {media_type} of {schema}"));
            }
        }
    }
}

fn entries(object: &Value) -> impl Iterator<Item = (&str, &Value)> {
    object.as_object().into_iter().flatten().map(|(name, value)| (name.as_str(), value))
}

fn words(list: &Value) -> BTreeSet<&str> {
    list.as_array().into_iter().flatten().filter_map(Value::as_str).collect()
}

/// The words of a list that are not among others.
fn without<'a>(list: &'a Value, others: &BTreeSet<&str>) -> impl Iterator<Item = &'a str> {
    words(list).into_iter().filter(move |word| !others.contains(word))
}

/// The words that a schema, or what it is a list of, allows.
fn choices(schema: &Value) -> &Value {
    if schema["items"].is_object() { choices(&schema["items"]) } else { &schema["enum"] }
}

/// The parts that a schema is put together from.
fn parts(schema: &Value) -> impl Iterator<Item = &Value> {
    ["allOf", "oneOf"].into_iter().flat_map(|key| schema[key].as_array().into_iter().flatten())
}

fn properties(schema: &Value) -> BTreeMap<&str, &Value> {
    entries(&schema["properties"]).chain(parts(schema).flat_map(properties)).collect()
}

fn collect_required<'a>(schema: &'a Value, found: &mut BTreeSet<&'a str>) {
    found.extend(words(&schema["required"]));
    for part in schema["allOf"].as_array().into_iter().flatten() {
        collect_required(part, found);
    }
}
