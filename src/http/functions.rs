//! Lists of numbers that clients post: functions on the rows of the upload, and coefficients.

use axum::extract::Request;
use serde_json::{Map, Value};

use super::asked::JSON_BYTES_MAX;
use super::problem::{Kind, Problem};
use super::{Service, upload};
use crate::cloud::reader::read_columns;
use crate::harmonics::Function;
use crate::harmonics::functions::first_nonfinite;

/// What every `.npy` file begins with.
const NPY_MAGIC: &[u8] = b"\x93NUMPY";

/// Most lists in one request.
const LISTS_MAX: usize = 256;

/// What is accepted, for messages.
const SHAPES: &str = "a JSON array of numbers, an array of such arrays, an object {\"name\": [numbers]}, or an npy file of \
                      one or two axes";

/// The lists that a request's body holds, named `f0`, `f1` and so on where it does not name them.
///
/// JSON: one array of numbers, an array of arrays, an object of arrays, or an answer with `fields` as it came from
/// `GET …/coefficients`; null stands for a number that is not there. NumPy: an array of n, or of n × m, one list per
/// column.
///
/// # Errors
/// A problem that says what would be accepted.
pub(super) async fn receive(service: &Service, request: Request) -> Result<Vec<Function>, Problem> {
    let bytes = upload::body(request).await?;
    let lists = service.compute.run(move || parse(&bytes)).await??;
    if lists.is_empty() || lists.len() > LISTS_MAX {
        let detail =
            format!("the body holds {} lists of numbers; 1 to {LISTS_MAX} are accepted", lists.len());
        return Err(Problem::new(Kind::MalformedRequest, detail));
    }
    Ok(lists)
}

fn parse(bytes: &[u8]) -> Result<Vec<Function>, Problem> {
    if bytes.starts_with(NPY_MAGIC) {
        let columns =
            read_columns(bytes).map_err(|error| Problem::new(Kind::MalformedRequest, error.to_string()))?;
        return Ok(unnamed(columns));
    }
    if bytes.len() as u64 > JSON_BYTES_MAX {
        return Err(Problem::new(
            Kind::TooLarge,
            format!("the body is larger than {JSON_BYTES_MAX} bytes of JSON; send an npy file instead"),
        )
        .with("limit", JSON_BYTES_MAX));
    }
    let json: Value = serde_json::from_slice(bytes)
        .map_err(|error| malformed(&format!("the body is neither npy nor JSON ({error})")))?;
    match json {
        Value::Array(values) if values.iter().all(Value::is_array) && !values.is_empty() => Ok(unnamed(
            values
                .iter()
                .enumerate()
                .map(|(i, list)| numbers(&format!("list {i}"), list))
                .collect::<Result<_, _>>()?,
        )),
        list @ Value::Array(_) => Ok(unnamed(vec![numbers("the list", &list)?])),
        Value::Object(object) => named(object),
        _ => Err(malformed("the body holds no list of numbers")),
    }
}

fn named(mut object: Map<String, Value>) -> Result<Vec<Function>, Problem> {
    let lists = match object.remove("fields") {
        Some(Value::Object(fields)) => fields,
        Some(other) => {
            object.insert("fields".to_owned(), other);
            object
        }
        None => object,
    };
    lists
        .iter()
        .map(|(name, list)| Ok(Function { name: name.clone(), values: numbers(&format!("`{name}`"), list)? }))
        .collect()
}

fn unnamed(lists: Vec<Vec<f64>>) -> Vec<Function> {
    let named = |(i, values)| Function { name: format!("f{i}"), values };
    lists.into_iter().enumerate().map(named).collect()
}

/// A list of numbers; null is NaN.
fn numbers(what: &str, list: &Value) -> Result<Vec<f64>, Problem> {
    let Value::Array(values) = list else { return Err(malformed(&format!("{what} is no list of numbers"))) };
    let number = |(i, value): (usize, &Value)| match value {
        Value::Null => Ok(f64::NAN),
        value => value.as_f64().ok_or_else(|| {
            let shown: String = value.to_string().chars().take(40).collect();
            malformed(&format!("{what} has `{shown}` at place {i} (counting from 0), which is no number"))
        }),
    };
    values.iter().enumerate().map(number).collect()
}

fn malformed(what: &str) -> Problem {
    Problem::new(Kind::MalformedRequest, format!("{what}; send {SHAPES}"))
}

/// Refuses lists that have not a number for each of the `rows` rows of the upload.
///
/// # Errors
/// A problem that names the list.
pub(super) fn check_length(functions: &[Function], rows: usize) -> Result<(), Problem> {
    match functions.iter().find(|function| function.values.len() != rows) {
        None => Ok(()),
        Some(function) => Err(Problem::new(
            Kind::InvalidParameter,
            format!("`{}` has {} values; the upload has {rows} rows", function.name, function.values.len()),
        )
        .with("parameter", function.name.clone())
        .with("points", rows)),
    }
}

/// Refuses functions that are not finite in a row that takes part.
///
/// # Errors
/// A problem that names the function and the row.
pub(super) fn check_finite(functions: &[Function], mass: &[f64]) -> Result<(), Problem> {
    for function in functions {
        if let Some(row) = first_nonfinite(&function.values, mass) {
            return Err(Problem::new(
                Kind::InvalidParameter,
                format!(
                    "`{}` is not finite in row {row} (counting from 0); only rows without a result may be null",
                    function.name
                ),
            )
            .with("parameter", function.name.clone())
            .with("row", row));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Vec<(String, Vec<f64>)>, String> {
        let named = |function: Function| (function.name, function.values);
        parse(text.as_bytes())
            .map(|functions| functions.into_iter().map(named).collect())
            .map_err(|problem| problem.document(None, None).detail)
    }

    fn list(name: &str, values: &[f64]) -> (String, Vec<f64>) {
        (name.to_owned(), values.to_vec())
    }

    #[test]
    fn lists_come_alone_in_a_list_or_under_names() {
        assert_eq!(parsed("[1, 2.5]"), Ok(vec![list("f0", &[1.0, 2.5])]));
        assert_eq!(parsed("[[1], [2]]"), Ok(vec![list("f0", &[1.0]), list("f1", &[2.0])]));
        assert_eq!(parsed(r#"{"b": [1], "a": [2]}"#), Ok(vec![list("b", &[1.0]), list("a", &[2.0])]));
        let answer = r#"{"job_id": "…", "fields": {"x": [3]}, "energy": {}}"#;
        assert_eq!(parsed(answer), Ok(vec![list("x", &[3.0])]));
        assert_eq!(parsed(r#"{"fields": [4]}"#), Ok(vec![list("fields", &[4.0])]));
        assert!(parsed("[null, 1]").unwrap()[0].1[0].is_nan());
    }

    #[test]
    fn what_holds_no_numbers_is_refused_with_what_would_be_accepted() {
        for (body, told) in [
            ("3", "no list of numbers"),
            ("[1, \"two\"]", "`\"two\"` at place 1"),
            ("[[1], 2]", "no number"),
            (r#"{"a": 1}"#, "`a` is no list"),
            ("{", "neither npy nor JSON"),
        ] {
            let detail = parsed(body).unwrap_err();
            assert!(detail.contains(told) && detail.contains("npy"), "{body}: {detail}");
        }
    }
}
