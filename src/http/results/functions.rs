//! Lists of numbers that clients post: functions on the rows of the upload, and coefficients.

use std::collections::HashMap;
use std::sync::Arc;

use serde_json::Value;
use utoipa::ToSchema;

use super::number_lists::{self, LISTS_MAX};
use super::request::{Harmonics, JSON_BYTES_MAX};
use crate::cloud::reader::read_columns;
use crate::harmonics::functions::first_nonfinite;
use crate::harmonics::{Function, Transformed, transform};
use crate::http::wire::body::{IncomingBody, Received};
use crate::http::wire::memory::Reservation;
use crate::http::wire::problem::{Kind, Problem};
use crate::http::wire::service::Service;

/// What every `.npy` file begins with.
const NPY_MAGIC: &[u8] = b"\x93NUMPY";

/// What is accepted, for messages.
const SHAPES: &str = "a JSON array of numbers, an array of such arrays, an object {\"name\": [numbers]}, or an npy file of \
                      one or two axes";

/// The lists that a request's body holds, named `f0`, `f1` and so on where it does not name them.
///
/// JSON: one array of numbers, an array of arrays, an object of arrays, or an answer with `fields` as it came from
/// `GET …/coefficients`; null stands for a number that is not there. NumPy: an array of n, or of n × m, one list per
/// column.
///
/// Beside them the memory that they take.
///
/// # Errors
/// A problem that says what would be accepted.
pub(crate) async fn receive(
    service: &Service,
    body: IncomingBody,
) -> Result<(Vec<Function>, Reservation), Problem> {
    let Received { bytes, reservation } = body.receive(u64::MAX).await?;
    if bytes.is_empty() {
        return Err(malformed("the body is empty"));
    }
    let lists = service.pools.reading.run(move || parse(&bytes)).await??;
    if lists.is_empty() || lists.len() > LISTS_MAX {
        let detail = format!("the body has {} lists of numbers; send 1 to {LISTS_MAX}", lists.len());
        return Err(Problem::new(Kind::MalformedRequest, detail));
    }
    Ok((lists, reservation))
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
    number_lists::parse(bytes).map_err(|why| malformed(&why))
}

fn unnamed(lists: Vec<Vec<f64>>) -> Vec<Function> {
    let named = |(i, values)| Function::new(format!("f{i}"), values);
    lists.into_iter().enumerate().map(named).collect()
}

fn malformed(what: &str) -> Problem {
    Problem::new(Kind::MalformedRequest, format!("{what}; send {SHAPES}"))
}

/// Refuses lists that have not a number for each of the `rows` rows of the upload.
///
/// # Errors
/// A problem that names the list.
pub(crate) fn check_length(functions: &[Function], rows: usize) -> Result<(), Problem> {
    match functions.iter().find(|function| function.values.len() != rows) {
        None => Ok(()),
        Some(Function { name, values, .. }) => {
            let told = format!("`{name}` has {} values; the upload has {rows} rows", values.len());
            Err(Problem::invalid(name, told).with("points", rows))
        }
    }
}

/// Refuses functions that are not finite in a row that takes part.
///
/// # Errors
/// A problem that names the function and the row.
pub(crate) fn check_finite(functions: &[Function], mass: &[f64]) -> Result<(), Problem> {
    for function in functions {
        if let Some(row) = first_nonfinite(&function.values, mass) {
            let told = "(counting from 0); only rows without a result may be null";
            let told = format!("`{}` is not finite in row {row} {told}", function.name);
            return Err(Problem::invalid(&function.name, told).with("row", row));
        }
    }
    Ok(())
}

/// Numbers by name: see the description of the request.
#[derive(Debug, ToSchema)]
#[schema(value_type = Object)]
#[allow(dead_code)] // names the request body in the OpenAPI document
pub(crate) struct NumberLists(Value);

/// Of functions of the upload itself: as stored with the result, else by a pass over the bases.
pub(crate) async fn own_coefficients(
    harmonics: &mut Harmonics,
    given: Vec<Function>,
    mass: Vec<f64>,
) -> Result<(Arc<Vec<Function>>, Vec<Transformed>), Problem> {
    let mut stored: HashMap<String, Transformed> = harmonics
        .bases
        .coefficients()
        .await?
        .into_iter()
        .map(|own| (own.name, Transformed { coefficients: own.numbers, energy: own.energy }))
        .collect();
    let found: Option<Vec<Transformed>> = given.iter().map(|f| stored.remove(&f.name)).collect();
    match found {
        Some(found) => Ok((Arc::new(given), found)),
        None => project(harmonics, given, mass).await,
    }
}

/// One pass over the bases; gives the functions back. Small bases are kept for a pass back.
pub(crate) async fn project(
    harmonics: &mut Harmonics,
    given: Vec<Function>,
    mass: Vec<f64>,
) -> Result<(Arc<Vec<Function>>, Vec<Transformed>), Problem> {
    let given = Arc::new(given);
    let functions = Arc::clone(&given);
    let sums = harmonics.bases.map_and_keep(move |block| {
        let values: Vec<&[f64]> = functions.iter().map(|function| function.values.as_slice()).collect();
        transform::partial(block, &mass, &values)
    });
    Ok((given, transform::total(&sums.await?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_holds_no_numbers_is_refused_with_what_would_be_accepted() {
        for body in ["3", "[1, \"two\"]", "{"] {
            let problem = parse(body.as_bytes()).unwrap_err();
            assert_eq!(problem.kind(), Kind::MalformedRequest);
            let detail = problem.document(None, None).detail;
            assert!(
                detail.contains("send a JSON array of numbers") && detail.contains("npy file"),
                "{detail}"
            );
        }
    }
}
