//! The OpenAPI document: as YAML, and as a page (`GET /docs`) without scripts and without anything from elsewhere.

mod sample;

use std::fmt::Write as _;
use std::sync::{LazyLock, OnceLock};

use axum::http::header;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use serde_json::Value;

use crate::http::openapi::Description;
use crate::http::wire::problem::Problem;

/// The page loads nothing and runs nothing.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'";

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222;\
    background:#fff}h2{margin-top:2.5rem;border-bottom:1px solid #ccc}summary{cursor:pointer;padding:.3rem 0}\
    code,pre,b{font-family:ui-monospace,monospace}pre{background:#f5f5f5;padding:.6rem;overflow-x:auto}\
    table{border-collapse:collapse;width:100%;margin:.4rem 0 1rem}td,th{border:1px solid #ddd;padding:.25rem .5rem;\
    text-align:left;vertical-align:top}b{color:#1b4f8f}details>div{margin-left:1.2rem}\
    @media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}pre{background:#242424}b{color:#8ab8f0}\
    a{color:#8ab8f0}td,th{border-color:#444}}\
    nav a{margin-right:1rem}pre.run::before{content:'$ ';color:#888}details[open]>summary{font-weight:600}";

/// Methods in the order in which they are shown.
const METHODS: [&str; 4] = ["get", "put", "post", "delete"];

type Described = Extension<&'static LazyLock<Description>>;

/// This interface as an OpenAPI document.
#[utoipa::path(
    get,
    path = "/openapi.yaml",
    operation_id = "openapi",
    tag = "service",
    responses((status = 200, description = "The document.", body = Object, content_type = "application/yaml"))
)]
pub(crate) async fn openapi_yaml(Extension(description): Described) -> Result<Response, Problem> {
    let yaml = description.yaml.as_ref().map_err(|error| Problem::internal(error))?;
    Ok(([(header::CONTENT_TYPE, "application/yaml")], yaml.as_str()).into_response())
}

/// This interface as an OpenAPI document, as JSON.
#[utoipa::path(
    get,
    path = "/openapi.json",
    tag = "service",
    responses((status = 200, description = "The document.", body = Object, content_type = "application/json"))
)]
pub(crate) async fn openapi_json(Extension(description): Described) -> Result<Json<&'static Value>, Problem> {
    description.json.as_ref().map(Json).map_err(|error| Problem::internal(error))
}

/// This interface as a page to read.
#[utoipa::path(
    get,
    path = "/docs",
    tag = "service",
    responses((status = 200, description = "The page.", body = String, content_type = "text/html"))
)]
pub(crate) async fn docs(Extension(description): Described) -> Result<Response, Problem> {
    // Made once, as the document is.
    static PAGE: OnceLock<String> = OnceLock::new();
    let document = description.json.as_ref().map_err(|error| Problem::internal(error))?;
    let html = PAGE.get_or_init(|| page(document));
    let headers =
        [(header::CONTENT_TYPE, "text/html; charset=utf-8"), (header::CONTENT_SECURITY_POLICY, POLICY)];
    Ok((headers, html.as_str()).into_response())
}

/// The whole page. Writing to a string cannot fail.
fn page(document: &Value) -> String {
    let info = &document["info"];
    let title = text(&info["title"]);
    let mut html = format!(
        "<!DOCTYPE html><html lang=\"en\"><meta charset=\"utf-8\"><title>{title}</title><style>{STYLE}</style>\
         <h1>{title} {}</h1>{}<p>The same as <a href=\"/openapi.yaml\">openapi.yaml</a>; \
         <a href=\"/capabilities\">capabilities</a> has formats, parameters and limits as data; <a href=\"/\">the viewer</a> shows \
         clouds and modes. In the commands, <code>$CLOUD</code> and <code>$JOB</code> are ids out of the answer to an upload; a \
         service with keys also wants <code>-H \"Authorization: Bearer $KEY\"</code>.</p><nav>",
        text(&info["version"]),
        prose(&info["description"])
    );
    for tag in document["tags"].as_array().into_iter().flatten() {
        let _ = write!(html, "<a href=\"#tag-{0}\">{0}</a>", text(&tag["name"]));
    }
    html.push_str("<a href=\"#schemas\">schemas</a></nav>");
    for tag in document["tags"].as_array().into_iter().flatten() {
        let _ =
            write!(html, "<h2 id=\"tag-{0}\">{0}</h2>{1}", text(&tag["name"]), prose(&tag["description"]));
        for (path, item) in document["paths"].as_object().into_iter().flatten() {
            for method in METHODS {
                let operation = &item[method];
                if operation["tags"].as_array().is_some_and(|tags| tags.contains(&tag["name"])) {
                    show_operation(&mut html, document, (method, path), operation);
                }
            }
        }
    }
    html.push_str("<h2 id=\"schemas\">Schemas</h2>");
    for (name, schema) in document["components"]["schemas"].as_object().into_iter().flatten() {
        let (name, description) = (escaped(name), line(&schema["description"]));
        // Browsers open what a link into it leads to, so the name is that of the inside.
        let _ =
            write!(html, "<details><summary><code>{name}</code> {description}</summary><div id=\"{name}\">");
        show_fields(&mut html, schema);
        html.push_str("</div></details>");
    }
    html.push_str("</html>");
    html
}

fn show_operation(html: &mut String, document: &Value, (method, path): (&str, &str), operation: &Value) {
    let _ = write!(
        html,
        "<details><summary><b>{}</b> <code>{}</code> {}</summary><div>{}<pre class=\"run\">{}</pre>",
        method.to_ascii_uppercase(),
        escaped(path),
        line(&operation["summary"]),
        prose(&operation["description"]),
        escaped(&sample::curl(document, method, path, operation))
    );
    if let Some(parameters) = operation["parameters"].as_array().filter(|all| !all.is_empty()) {
        html.push_str("<table><tr><th>parameter<th>in<th>values<th>meaning");
        for parameter in parameters {
            let _ = write!(
                html,
                "<tr><td><code>{}</code><td>{}<td>{}<td>{}",
                text(&parameter["name"]),
                text(&parameter["in"]),
                kind(&parameter["schema"]),
                line(&parameter["description"])
            );
        }
        html.push_str("</table>");
    }
    show_contents(html, "body", &operation["requestBody"]);
    for (status, response) in operation["responses"].as_object().into_iter().flatten() {
        show_contents(html, &escaped(status), response);
        if status.starts_with('2') {
            show_example(html, document, response);
        }
    }
    html.push_str("</div></details>");
}

/// What a body may be: its media types with their schemas.
fn show_contents(html: &mut String, name: &str, body: &Value) {
    if body.is_null() {
        return;
    }
    let _ = write!(html, "<p><b>{name}</b> {}", line(&body["description"]));
    for (media_type, content) in body["content"].as_object().into_iter().flatten() {
        let _ = write!(html, "<br><code>{}</code> {}", escaped(media_type), kind(&content["schema"]));
    }
    html.push_str("</p>");
}

/// What an answer in JSON looks like.
fn show_example(html: &mut String, document: &Value, response: &Value) {
    let example = sample::example(document, &response["content"]["application/json"]["schema"]);
    if let Some(text) = example.and_then(|example| serde_json::to_string_pretty(&example).ok()) {
        let _ = write!(html, "<pre>{}</pre>", escaped(&text));
    }
}

/// The fields of a schema, with those of its parts.
fn show_fields(html: &mut String, schema: &Value) {
    if let Some(fields) = schema["properties"].as_object() {
        html.push_str("<table><tr><th>field<th>type<th>meaning<th>example");
        for (name, field) in fields {
            let example =
                field["examples"].get(0).map(|value| format!("<code>{}</code>", escaped(&value.to_string())));
            let _ = write!(
                html,
                "<tr><td><code>{}</code><td>{}<td>{}<td>{}",
                escaped(name),
                kind(field),
                line(&field["description"]),
                example.unwrap_or_default()
            );
        }
        html.push_str("</table>");
    } else if let Some(words) = schema["enum"].as_array() {
        let words: Vec<String> = words.iter().map(text).collect();
        let _ = write!(html, "<p>{}</p>", words.join(", "));
    }
    for part in ["allOf", "oneOf"].iter().flat_map(|key| schema[*key].as_array().into_iter().flatten()) {
        match part["$ref"].as_str() {
            Some(_) => {
                let _ = write!(html, "<p>with {}</p>", kind(part));
            }
            None => show_fields(html, part),
        }
    }
}

/// What values a schema has, in a few words.
fn kind(schema: &Value) -> String {
    if let Some(name) = schema["$ref"].as_str().and_then(|reference| reference.rsplit('/').next()) {
        let name = escaped(name);
        return format!("<a href=\"#{name}\">{name}</a>");
    }
    if let Some(words) = schema["enum"].as_array() {
        return words.iter().map(text).collect::<Vec<_>>().join(", ");
    }
    if let Some(choices) = ["oneOf", "anyOf"].iter().find_map(|key| schema[*key].as_array()) {
        return choices.iter().map(kind).collect::<Vec<_>>().join(" or ");
    }
    let name = match &schema["type"] {
        Value::Array(names) => names.iter().map(text).collect::<Vec<_>>().join(" or "),
        name => text(name),
    };
    let range: Vec<String> = [("minimum", "from"), ("exclusiveMinimum", "above"), ("maximum", "to")]
        .iter()
        .filter_map(|(key, word)| Some(format!(" {word} {}", schema[*key].as_f64()?)))
        .collect();
    match schema.get("items") {
        Some(items) => format!("{name} of {}", kind(items)),
        None => name + &range.concat(),
    }
}

/// A string of the document, fit for the page.
fn text(value: &Value) -> String {
    escaped(value.as_str().unwrap_or_default())
}

/// Text on a line, what stands between backticks as code.
fn line(value: &Value) -> String {
    let text = text(value);
    let parts = text.split('`').enumerate();
    parts.map(|(i, part)| if i % 2 == 1 { format!("<code>{part}</code>") } else { part.to_owned() }).collect()
}

/// The same in paragraphs.
fn prose(value: &Value) -> String {
    let text = line(value);
    let parts: Vec<&str> = text.split("\n\n").filter(|part| !part.is_empty()).collect();
    if parts.is_empty() { String::new() } else { format!("<p>{}</p>", parts.join("</p><p>")) }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_shows_every_operation_and_every_field_and_escapes_them() {
        let document = serde_json::json!({
            "info": {"title": "t", "version": "1", "description": "a < b\n\nand `c < d`"},
            "tags": [{"name": "one", "description": "first"}],
            "paths": {"/x/{id}": {"get": {"tags": ["one"], "summary": "Gets.",
                "parameters": [{"name": "id", "in": "path", "description": "Which.", "schema": {"type": "integer", "minimum": 1}}],
                "responses": {"200": {"description": "It.", "content": {"text/csv": {"schema": {"$ref": "#/c/s/X"}}}}}}}},
            "components": {"schemas": {"X": {"description": "An x.",
                "properties": {"n": {"type": ["number", "null"], "description": "A number.", "examples": ["\"<&"]}}}}},
        });
        let html = page(&document);
        for part in [
            "<p>a &lt; b</p><p>and <code>c &lt; d</code></p>",
            "<h2 id=\"tag-one\">",
            "curl &quot;http://127.0.0.1:8080/x/$JOB&quot;",
            "<b>GET</b> <code>/x/{id}</code> Gets.",
            "integer from 1",
            "<code>text/csv</code> <a href=\"#X\">X</a>",
            "<div id=\"X\">",
            "number or null",
            "\\&quot;&lt;&amp;",
        ] {
            assert!(html.contains(part), "{part}: {html}");
        }
    }
}
