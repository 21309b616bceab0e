//! Examples for the page: what an answer looks like, and the command that asks for it.

use serde_json::{Map, Value};

/// Where the service is when nothing else is said.
const SERVICE: &str = "http://127.0.0.1:8080";
/// Schemas within schemas that an example shows.
const DEPTH_MAX: usize = 10;

/// An example of a schema, made of the examples of its fields; `None` where there are none.
pub(super) fn example(document: &Value, schema: &Value) -> Option<Value> {
    of_schema(document, schema, DEPTH_MAX)
}

fn of_schema(document: &Value, schema: &Value, depth: usize) -> Option<Value> {
    let depth = depth.checked_sub(1)?;
    if let Some(reference) = schema["$ref"].as_str() {
        return of_schema(document, document.pointer(reference.strip_prefix('#')?)?, depth);
    }
    if let Some(example) = schema["examples"].get(0).or_else(|| schema.get("example")) {
        return Some(example.clone());
    }
    if let Some(parts) = schema["allOf"].as_array() {
        let parts = parts.iter().filter_map(|part| of_schema(document, part, depth + 1));
        let fields = parts.filter_map(|part| part.as_object().cloned()).flatten().collect::<Map<_, _>>();
        return (!fields.is_empty()).then_some(Value::Object(fields));
    }
    if let Some(choices) = ["oneOf", "anyOf"].iter().find_map(|key| schema[*key].as_array()) {
        return choices.iter().find_map(|choice| of_schema(document, choice, depth));
    }
    if let Some(word) = schema["enum"].get(0) {
        return Some(word.clone());
    }
    if let Some(items) = schema.get("items") {
        return Some(Value::Array(of_schema(document, items, depth).into_iter().collect()));
    }
    let fields = schema["properties"].as_object()?;
    let of_field =
        |(name, field): (&String, &Value)| Some((name.clone(), of_schema(document, field, depth)?));
    let fields: Map<_, _> = fields.iter().filter_map(of_field).collect();
    (!fields.is_empty()).then_some(Value::Object(fields))
}

/// The command that makes a call, as typed into a shell.
pub(super) fn curl(document: &Value, method: &str, path: &str, operation: &Value) -> String {
    let parameters = operation["parameters"].as_array().map(Vec::as_slice).unwrap_or_default();
    let mut address = path.to_owned();
    for parameter in parameters.iter().filter(|parameter| parameter["in"] == "path") {
        let name = parameter["name"].as_str().unwrap_or_default();
        address = address.replace(&format!("{{{name}}}"), &of_path(path, name));
    }
    let body = &operation["requestBody"]["content"];
    let (media_type, content) = body.as_object().and_then(|all| all.iter().next()).unzip();
    let mut words = vec!["curl".to_owned()];
    let json = content.filter(|_| media_type.is_some_and(|kind| kind == "application/json"));
    if let Some(content) = json {
        let posted = example(document, &content["schema"]).unwrap_or_else(|| serde_json::json!([1, 1, 0.5]));
        words.push(format!("-H 'Content-Type: application/json' -d '{posted}'"));
    } else if media_type.is_some() {
        words.push("-T scan.ply".to_owned());
    }
    let usual = match (json.is_some(), media_type.is_some()) {
        (true, _) => "post",
        (false, true) => "put",
        (false, false) => "get",
    };
    if method != usual {
        words.push(format!("-X {}", method.to_ascii_uppercase()));
    }
    let binary = first_answer(operation)
        .filter(|kind| !kind.starts_with("text/") && !kind.contains("json") && !kind.contains("yaml"));
    if let Some(kind) = binary.and_then(|kind| kind.rsplit(['/', '-']).next()) {
        words.push(format!("-o answer.{kind}"));
    }
    words.push(format!("\"{SERVICE}{address}\""));
    words.join(" ")
}

/// The first media type of what is answered when all goes well.
fn first_answer(operation: &Value) -> Option<&str> {
    operation["responses"]["200"]["content"].as_object()?.keys().next().map(String::as_str)
}

/// What stands for a part of a path: variables of the shell for what only the reader knows.
fn of_path(path: &str, name: &str) -> String {
    match name {
        "id" if path.starts_with("/clouds") => "$CLOUD".to_owned(),
        "id" => "$JOB".to_owned(),
        "other" | "b" => "$OTHER_JOB".to_owned(),
        "basis" => "4".to_owned(),
        "name" if path.starts_with("/clouds") => "scan.ply".to_owned(),
        "file" => "bases.npy".to_owned(),
        name => format!("${}", name.to_ascii_uppercase()),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn an_example_follows_references_and_leaves_out_what_has_none() {
        let document = json!({"components": {"schemas": {
            "Job": {"properties": {"id": {"examples": ["7"]}, "cloud": {"$ref": "#/components/schemas/Cloud"}, "x": {"type": "number"}}},
            "Cloud": {"allOf": [{"properties": {"points": {"examples": [400]}}}, {"properties": {"state": {"enum": ["a", "b"]}}}]},
        }}});
        let found =
            example(&document, &json!({"type": "array", "items": {"$ref": "#/components/schemas/Job"}}));
        assert_eq!(found, Some(json!([{"id": "7", "cloud": {"points": 400, "state": "a"}}])));
        assert_eq!(example(&document, &json!({"type": "number"})), None);
    }

    #[test]
    fn a_schema_that_contains_itself_ends() {
        let document = json!({"components": {"schemas": {"A": {"properties": {"n": {"examples": [1]}, "a": {"$ref": "#/components/schemas/A"}}}}}});
        assert!(example(&document, &json!({"$ref": "#/components/schemas/A"})).is_some());
    }

    #[test]
    fn commands_name_method_body_and_place() {
        let path = |name: &str| json!({"in": "path", "name": name});
        let asked = |method, path_text: &str, operation| curl(&Value::Null, method, path_text, &operation);
        assert_eq!(
            asked("get", "/jobs/{id}", json!({"parameters": [path("id")]})),
            "curl \"http://127.0.0.1:8080/jobs/$JOB\""
        );
        assert_eq!(
            asked("delete", "/clouds/{id}", json!({"parameters": [path("id")]})),
            "curl -X DELETE \"http://127.0.0.1:8080/clouds/$CLOUD\""
        );
        let upload = json!({"requestBody": {"content": {"application/ply": {}}}});
        assert_eq!(asked("put", "/clouds", upload), "curl -T scan.ply \"http://127.0.0.1:8080/clouds\"");
        let posted = json!({"requestBody": {"content": {"application/json": {"schema": {"examples": [{"bases": 5}]}}}}});
        assert_eq!(
            asked("post", "/x", posted),
            "curl -H 'Content-Type: application/json' -d '{\"bases\":5}' \"http://127.0.0.1:8080/x\""
        );
        let picture = json!({"responses": {"200": {"content": {"image/png": {}}}}});
        assert_eq!(asked("get", "/i", picture), "curl -o answer.png \"http://127.0.0.1:8080/i\"");
    }
}
