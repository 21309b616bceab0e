//! An example for every field of the OpenAPI document, taken from answers of the service.

use std::collections::BTreeMap;

use serde_json::Value;
use utoipa::openapi::{OpenApi, RefOr, Schema};

/// Examples by schema and field.
const EXAMPLES: &str = include_str!("examples.json");

/// Writes the examples into a document. Fields that are schemas of their own have theirs there.
pub(super) fn illustrate(mut document: OpenApi) -> OpenApi {
    let examples: BTreeMap<String, BTreeMap<String, Value>> =
        serde_json::from_str(EXAMPLES).unwrap_or_default();
    let schemas = document.components.iter_mut().flat_map(|components| components.schemas.iter_mut());
    for (name, schema) in schemas {
        if let Some(examples) = examples.get(name) {
            visit(schema, examples);
        }
    }
    document
}

fn visit(schema: &mut RefOr<Schema>, examples: &BTreeMap<String, Value>) {
    let RefOr::T(schema) = schema else { return };
    match schema {
        Schema::Object(object) => {
            for (field, property) in &mut object.properties {
                if let (RefOr::T(property), Some(example)) = (property, examples.get(field)) {
                    set(property, example);
                }
            }
        }
        Schema::AllOf(all) => all.items.iter_mut().for_each(|part| visit(part, examples)),
        Schema::OneOf(one) => one.items.iter_mut().for_each(|part| visit(part, examples)),
        _ => {}
    }
}

fn set(property: &mut Schema, example: &Value) {
    let examples = vec![example.clone()];
    match property {
        Schema::Object(object) => object.examples = examples,
        Schema::Array(array) => array.examples = examples,
        Schema::OneOf(one) => one.examples = examples,
        Schema::AllOf(all) => all.examples = examples,
        _ => {}
    }
}
