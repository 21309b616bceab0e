//! The OpenAPI document: the file at the top of the repository, the code, and the service say the same.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use crate::service::Service;

pub(crate) fn document() -> Value {
    serde_json::to_value(chladni::http::document()).unwrap()
}

fn yaml() -> String {
    chladni::http::yaml(&chladni::http::document()).unwrap()
}

/// Every operation with its method and path.
pub(crate) fn operations(document: &Value) -> Vec<(String, Value)> {
    let methods = ["get", "put", "post", "delete", "patch", "head"];
    let paths = document["paths"].as_object().unwrap();
    let of_path = |(path, item): (&String, &Value)| {
        let named = item.as_object().unwrap().iter().filter(|(method, _)| methods.contains(&method.as_str()));
        named.map(|(method, operation)| (format!("{method} {path}"), operation.clone())).collect::<Vec<_>>()
    };
    paths.iter().flat_map(of_path).collect()
}

#[test]
fn the_file_is_what_the_code_generates() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("openapi.yaml");
    let generated = yaml();
    if std::env::var_os("UPDATE_OPENAPI").is_some() {
        std::fs::write(&file, &generated).unwrap();
    }
    let written = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(
        written == generated,
        "openapi.yaml is out of date; write it with UPDATE_OPENAPI=1 cargo test --test api openapi"
    );
}

#[tokio::test]
async fn the_service_hands_its_document_out() {
    let service = Service::start().await;
    let response = service.get("/openapi.yaml").await;
    assert_eq!(response.headers()["content-type"], "application/yaml");
    assert_eq!(response.text().await.unwrap(), yaml());
    let response = service.get("/openapi.json").await;
    assert_eq!(response.headers()["content-type"], "application/json");
    assert_eq!(response.json::<Value>().await.unwrap(), document());
    let links = service.get("/").await.headers()["link"].to_str().unwrap().to_owned();
    assert!(links.contains("</openapi.json>; rel=\"service-desc\""), "{links}");
}

#[test]
fn every_operation_says_what_it_does_and_has_its_own_name() {
    let document = document();
    let mut names = BTreeSet::new();
    for (name, operation) in operations(&document) {
        assert!(operation["summary"].as_str().is_some_and(|summary| !summary.is_empty()), "{name}");
        assert!(names.insert(operation["operationId"].as_str().unwrap().to_owned()), "{name}: {operation}");
        for parameter in operation["parameters"].as_array().into_iter().flatten() {
            assert!(
                parameter["description"].as_str().is_some_and(|text| !text.is_empty()),
                "{name}: {parameter}"
            );
        }
    }
    assert!(names.len() >= 20, "{names:?}");
}

#[test]
fn every_operation_with_a_choice_tells_its_problems() {
    for (name, operation) in operations(&document()) {
        if operation["parameters"].as_array().is_none_or(Vec::is_empty) {
            continue;
        }
        let responses = operation["responses"].as_object().unwrap();
        let problems = responses.iter().filter(|(status, _)| status.starts_with('4'));
        let described =
            problems.map(|(_, response)| &response["content"]["application/problem+json"]["schema"]["$ref"]);
        let described: Vec<_> = described.collect();
        assert!(!described.is_empty(), "{name}");
        assert!(
            described.iter().all(|reference| *reference == "#/components/schemas/Problem"),
            "{name}: {described:?}"
        );
    }
}

#[test]
fn every_field_of_every_schema_is_described_and_has_an_example_of_its_type() {
    let document = document();
    let mut faults = Vec::new();
    for (name, schema) in document["components"]["schemas"].as_object().unwrap() {
        visit(name, schema, &mut faults);
    }
    assert_eq!(faults, Vec::<String>::new());
}

fn visit(name: &str, schema: &Value, faults: &mut Vec<String>) {
    for (field, property) in schema["properties"].as_object().into_iter().flatten() {
        let is_schema_of_its_own = refers(property);
        if !is_schema_of_its_own && property["description"].as_str().is_none_or(str::is_empty) {
            faults.push(format!("{name}.{field} is not described"));
        }
        // Lists and maps of schemas are illustrated where those are.
        let is_illustrated_there = is_schema_of_its_own
            || refers(&property["items"])
            || refers(&property["additionalProperties"])
            || refers(&property["items"]["items"]);
        match property["examples"].get(0) {
            Some(example) if !is_of_type(example, property) => {
                faults.push(format!("{name}.{field}: the example {example} is not of the type"));
            }
            None if !is_illustrated_there => faults.push(format!("{name}.{field} has no example")),
            _ => {}
        }
    }
    for part in ["allOf", "oneOf"] {
        for part in schema[part].as_array().into_iter().flatten() {
            visit(name, part, faults);
        }
    }
}

/// Lists of an example, and what each has as many entries as: a number beside it, or another list. `a.*` are the
/// entries of `a`.
const LENGTHS: [(&str, &str, &str); 18] = [
    ("Bases", "eigenvalues", "count"),
    ("Bases", "bases", "count"),
    ("Bases", "bases.*", "points"),
    ("Coefficients", "frequencies", "eigenvalues"),
    ("Coefficients", "fields.*", "eigenvalues"),
    ("Distances", "values", "points"),
    ("Filtered", "coordinates", "points"),
    ("Filtered", "fields.*", "points"),
    ("Laplacians", "fields.*", "points"),
    ("Points", "coordinates", "points"),
    ("Points", "coordinates.*", "dimension"),
    ("Signatures", "values", "scales"),
    ("Signatures", "values.*", "points"),
    ("Similarity", "first", "modes"),
    ("Similarity", "second", "modes"),
    ("Spectrum", "raw_eigenvalues", "eigenvalues"),
    ("Spectrum", "residuals", "eigenvalues"),
    ("Synthesized", "values.*", "points"),
];

#[test]
fn lists_of_an_example_are_as_long_as_the_example_says() {
    let document = document();
    for (schema, list, size) in LENGTHS {
        let example = |field: &str| {
            let found = example_of(&document["components"]["schemas"][schema], field);
            found.unwrap_or_else(|| panic!("{schema}.{field} has no example"))
        };
        let length = |value: &Value| value.as_array().map(Vec::len).unwrap();
        let expected = example(size);
        let expected = expected.as_u64().map_or_else(|| length(&expected), |number| number as usize);
        let value = example(list.trim_end_matches(".*"));
        let lists: Vec<Value> = match (&value, list.ends_with(".*")) {
            (Value::Object(map), true) => map.values().cloned().collect(),
            (Value::Array(lists), true) => lists.clone(),
            _ => vec![value.clone()],
        };
        assert!(
            !lists.is_empty() && lists.iter().all(|list| length(list) == expected),
            "{schema}.{list}: {value}"
        );
    }
}

/// The example of a field, wherever the schema has it.
fn example_of(schema: &Value, field: &str) -> Option<Value> {
    let mut parts = ["allOf", "oneOf"].into_iter().filter_map(|part| schema[part].as_array()).flatten();
    let own = schema["properties"][field]["examples"].get(0).cloned();
    own.or_else(|| parts.find_map(|part| example_of(part, field)))
}

fn refers(schema: &Value) -> bool {
    schema.get("$ref").is_some()
        || schema["oneOf"].as_array().is_some_and(|parts| parts.iter().any(|part| part.get("$ref").is_some()))
}

fn is_of_type(value: &Value, schema: &Value) -> bool {
    let holds = |name: &Value| match name.as_str() {
        Some("integer") => value.is_i64() || value.is_u64(),
        Some("number") => value.is_number(),
        Some("string") => value.is_string(),
        Some("boolean") => value.is_boolean(),
        Some("null") => value.is_null(),
        Some("object") => value.is_object(),
        Some("array") => {
            value.as_array().is_some_and(|items| items.iter().all(|item| is_of_type(item, &schema["items"])))
        }
        _ => true,
    };
    match &schema["type"] {
        Value::Array(names) => names.iter().any(holds),
        name => holds(name),
    }
}

#[tokio::test]
async fn the_documentation_is_a_page_of_its_own() {
    let service = Service::start().await;
    let response = service.get("/docs").await;
    assert_eq!(response.headers()["content-type"], "text/html; charset=utf-8");
    assert!(response.headers()["content-security-policy"].to_str().unwrap().contains("default-src 'none'"));
    let page = response.text().await.unwrap();
    for (name, _) in operations(&document()) {
        let (method, path) = name.split_once(' ').unwrap();
        let shown = format!("<b>{}</b> <code>{path}</code>", method.to_uppercase());
        assert!(page.contains(&shown), "{shown}");
    }
    for from_elsewhere in ["<script", "src=", "href=\"http", "url("] {
        assert!(!page.contains(from_elsewhere), "{from_elsewhere}");
    }
}

/// utoipa keeps the first of two schemas of one name, silently: the names that types are given in the code are counted.
#[test]
fn no_two_schemas_share_a_name() {
    let mut seen = BTreeSet::new();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for file in rust_files(&source) {
        let text = std::fs::read_to_string(&file).unwrap();
        for name in schema_names(&text) {
            assert!(
                seen.insert(name.clone()),
                "two schemas are called {name}; the second is in {}",
                file.display()
            );
        }
    }
    let documented = document();
    let documented: BTreeSet<_> =
        documented["components"]["schemas"].as_object().unwrap().keys().cloned().collect();
    // the macro of enums of words derives their schemas
    let words: BTreeSet<_> = rust_files(&source)
        .iter()
        .flat_map(|file| enums_of_words(&std::fs::read_to_string(file).unwrap()))
        .collect();
    let unknown: Vec<_> =
        documented.iter().filter(|&name| !seen.contains(name) && !words.contains(name)).collect();
    assert!(unknown.is_empty(), "{unknown:?}");
}

fn rust_files(directory: &Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    let of_entry = |path: std::path::PathBuf| match path.is_dir() {
        true => rust_files(&path),
        false if path.extension().is_some_and(|ending| ending == "rs") => vec![path],
        false => Vec::new(),
    };
    entries.flat_map(of_entry).collect()
}

/// Names of the enums that `words!` declares in a source file.
fn enums_of_words(text: &str) -> Vec<String> {
    let declarations = text.split("words! {").skip(1).filter_map(|rest| rest.split_once("enum "));
    declarations.filter_map(|(_, rest)| rest.split_whitespace().next()).map(str::to_owned).collect()
}

/// Names of the types that derive `ToSchema` in a source file, as the document has them.
fn schema_names(text: &str) -> Vec<String> {
    let mut names = Vec::new();
    let (mut derives, mut renamed) = (false, None);
    for line in text.lines().map(str::trim) {
        derives |= line.contains("ToSchema") && !line.starts_with("use ");
        if let Some(rest) = line.strip_prefix("#[schema(as = ") {
            renamed = rest.split([',', ')']).next().map(str::to_owned);
        }
        let declared = line.strip_prefix("pub ").or_else(|| line.strip_prefix("pub(crate) ")).unwrap_or(line);
        let declared = declared.strip_prefix("struct ").or_else(|| declared.strip_prefix("enum "));
        if let Some(declared) = declared {
            let name = declared.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
            if derives {
                names.push(renamed.take().unwrap_or_else(|| name.to_owned()));
            }
            (derives, renamed) = (false, None);
        }
    }
    names
}

#[tokio::test]
async fn every_link_of_the_page_leads_somewhere_every_call_has_a_command_and_no_backtick_is_left() {
    let service = Service::start().await;
    let html = service.get("/docs").await.text().await.unwrap();
    // Examples may contain messages, in which backticks are literal.
    let without = |text: &str, start: &str, end: &str| -> String {
        text.split(start).map(|part| part.split_once(end).map_or(part, |(_, rest)| rest)).collect()
    };
    let outside = without(&without(&html, "<pre", "</pre>"), "<code>", "</code>");
    assert!(!outside.contains('`'));
    let links = |start: &str| -> Vec<String> {
        html.split(start).skip(1).map(|rest| rest.split('"').next().unwrap().to_owned()).collect()
    };
    let (targets, paths) = (links("href=\"#"), links("href=\"/"));
    assert!(targets.len() > 50 && paths.len() >= 3);
    for target in targets {
        assert!(html.contains(&format!("id=\"{target}\"")), "{target}");
    }
    for path in paths {
        assert!(service.get(&format!("/{path}")).await.status().is_success(), "{path}");
    }
    assert_eq!(html.matches("<pre class=\"run\">curl").count(), html.matches("<summary><b>").count());
    assert!(html.matches("<pre>{").count() > 10, "answers have examples");
}

/// Bytes are strings of format `binary`, a file under its name has one media type, and a form has its file.
#[test]
fn generators_of_clients_understand_bodies() {
    let document = document();
    let mut files = 0;
    for (name, operation) in operations(&document) {
        let whole = operation["responses"]["200"]["content"].as_object();
        let bodies = [whole, operation["requestBody"]["content"].as_object()];
        for (media_type, content) in bodies.into_iter().flatten().flatten() {
            let is_array_of_bytes = content["schema"]["items"]["format"] == "int32";
            assert!(!is_array_of_bytes, "{name}: {media_type}");
            if media_type == "multipart/form-data" {
                assert_eq!(content["schema"]["$ref"], "#/components/schemas/CloudForm", "{name}");
            } else if !["text", "json", "yaml"].iter().any(|text| media_type.contains(text)) {
                assert_eq!(content["schema"]["format"], "binary", "{name}: {media_type}");
            }
        }
        if name.rsplit('/').next().unwrap().contains('.') && name.contains("/jobs/{id}/") {
            files += 1;
            assert_eq!(whole.unwrap().len(), 1, "{name}: {whole:?}");
        }
    }
    assert!(files >= 30, "{files} files");
    let form = &document["components"]["schemas"]["CloudForm"];
    assert_eq!(form["properties"]["file"]["format"], "binary");
    assert_eq!(form["required"][0], "file");
}
