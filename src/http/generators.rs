//! The OpenAPI document as generators of clients understand it: bytes are bytes, a file is an operation of its own, and
//! a YAML reader of either version takes the same words from it.

use std::sync::LazyLock;

use regex_lite::{Captures, Regex};
use utoipa::openapi::path::{Operation, Parameter};
use utoipa::openapi::schema::{ObjectBuilder, SchemaFormat, Type};
use utoipa::openapi::{Content, KnownFormat, OpenApi, RefOr, Schema};

use super::wire::accept::Offer;

/// Completes a document: every format on offer, every file, and bytes as such. `named` are paths with a file for each of their
/// formats; `unnamed` are paths whose answers have several formats and no files; of two methods, POST is meant.
pub(super) fn complete(
    mut document: OpenApi,
    named: &[(String, &[Offer])],
    unnamed: &[(&str, &[Offer])],
) -> OpenApi {
    for &(path, offers) in unnamed {
        if let Some(item) = document.paths.paths.get_mut(path)
            && let Some(operation) = item.post.as_mut().or(item.get.as_mut())
        {
            offer(operation, offers);
        }
    }
    for &(ref path, offers) in named {
        let name = path.rsplit('/').next().unwrap_or(path);
        let Some(item) = document.paths.paths.get_mut(path) else { continue };
        let Some(operation) = &mut item.get else { continue };
        offer(operation, offers);
        let operation = operation.clone();
        for offer in offers {
            let file = file(&operation, name, offer);
            let mut item = utoipa::openapi::PathItem::default();
            item.get = Some(file);
            document.paths.paths.insert(format!("{path}.{}", offer.name), item);
        }
    }
    for operation in document.paths.paths.values_mut().flat_map(|item| {
        [&mut item.get, &mut item.put, &mut item.post, &mut item.delete].into_iter().flatten()
    }) {
        let bodies = operation.request_body.iter_mut().filter_map(|body| match body {
            RefOr::T(body) => Some(body.content.iter_mut()),
            RefOr::Ref(_) => None,
        });
        let answers = operation.responses.responses.values_mut().filter_map(|response| match response {
            RefOr::T(response) => Some(response.content.iter_mut()),
            RefOr::Ref(_) => None,
        });
        for (media_type, content) in bodies.flatten().chain(answers.flatten()) {
            if is_binary(media_type) {
                *content = RefOr::T(Content::new(Some(binary())));
            }
        }
    }
    document
}

fn is_binary(media_type: &str) -> bool {
    let is_text =
        media_type.starts_with("text/") || media_type.contains("json") || media_type.contains("yaml");
    !is_text && media_type != "multipart/form-data"
}

/// Bytes, of a request as of an answer.
fn binary() -> RefOr<Schema> {
    let format = SchemaFormat::KnownFormat(KnownFormat::Binary);
    RefOr::T(Schema::Object(ObjectBuilder::new().schema_type(Type::String).format(Some(format)).build()))
}

fn text() -> RefOr<Schema> {
    RefOr::T(Schema::Object(ObjectBuilder::new().schema_type(Type::String).build()))
}

/// Lists all formats of an operation's whole answer, of which handlers declare JSON alone.
fn offer(operation: &mut Operation, offers: &[Offer]) {
    let Some(RefOr::T(whole)) = operation.responses.responses.get_mut("200") else { return };
    let declared = std::mem::take(&mut whole.content);
    for media_type in offers.iter().map(Offer::media_type) {
        let content = declared.get(media_type).cloned().unwrap_or_else(|| {
            let schema = if is_binary(media_type) { binary() } else { text() };
            RefOr::T(Content::new(Some(schema)))
        });
        whole.content.insert(media_type.to_owned(), content);
    }
}

/// The operation of one file: its format is settled, so it has one media type and no argument `format`.
fn file(operation: &Operation, name: &str, offer: &Offer) -> Operation {
    let mut file = operation.clone();
    file.operation_id = Some(format!("{name}_{}", offer.name));
    file.summary = operation.summary.as_ref().map(|summary| {
        format!("{} As the file {name}.{}.", summary.trim_end_matches('.').to_owned() + ".", offer.name)
    });
    if let Some(parameters) = &mut file.parameters {
        let is_format = |parameter: &RefOr<Parameter>| match parameter {
            RefOr::T(parameter) => parameter.name == "format",
            RefOr::Ref(_) => false,
        };
        parameters.retain(|parameter| !is_format(parameter));
    }
    for response in file.responses.responses.values_mut() {
        if let RefOr::T(response) = response {
            let is_problem = response.content.contains_key(super::wire::problem::MEDIA_TYPE);
            response.content.retain(|media_type, _| is_problem || media_type == offer.media_type());
        }
    }
    // Without ranges of this format there is no partial answer.
    let is_empty = |response: &RefOr<utoipa::openapi::Response>| match response {
        RefOr::T(response) => response.content.is_empty(),
        RefOr::Ref(_) => false,
    };
    if file.responses.responses.get("206").is_some_and(is_empty) {
        file.responses.responses.remove("206");
    }
    file
}

/// Words that YAML 1.1 reads as truth values, and numbers that it reads as text.
static MISREAD: LazyLock<Regex> = LazyLock::new(|| {
    let word = "(?i:y|n|yes|no|on|off)";
    Regex::new(&format!(
        r"(?m)^(?<before>[ ]*(?:- )*(?:[^\s:'\x22]+: )?)(?:(?<word>{word})(?<key>:(?: .*)?)?|(?<digits>-?\d+)(?<exponent>e[+-]\d+))$"
    ))
    .unwrap_or_else(|error| unreachable!("the pattern is fixed: {error}"))
});

/// YAML that means the same by versions 1.1 and 1.2: words such as `off` are quoted, and numbers have a point.
pub(super) fn for_either_version(yaml: &str) -> String {
    let replaced = MISREAD.replace_all(yaml, |found: &Captures<'_>| {
        let part = |name| found.name(name).map_or("", |part| part.as_str());
        match found.name("word") {
            Some(word) => format!("{}'{}'{}", part("before"), word.as_str(), part("key")),
            None => format!("{}{}.0{}", part("before"), part("digits"), part("exponent")),
        }
    });
    replaced.into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_numbers_that_versions_of_yaml_read_differently_are_written_unmistakably() {
        for (written, expected) in [
            ("    - off\n    - ply\n", "    - 'off'\n    - ply\n"),
            ("  default: No\n", "  default: 'No'\n"),
            ("  y:\n    type: number\n", "  'y':\n    type: number\n"),
            ("  minimum: 1e-12\n", "  minimum: 1.0e-12\n"),
            ("  description: off and on\n", "  description: off and on\n"),
            ("  default: 100\n", "  default: 100\n"),
        ] {
            assert_eq!(for_either_version(written), expected);
        }
    }
}
