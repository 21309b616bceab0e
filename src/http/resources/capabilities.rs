//! `GET /capabilities`: formats, parameters, limits.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::State;
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::submission::{self, JobArguments};
use super::{bases, coefficients, files, image, laplacian, points, similarity};
use crate::arguments::{Accepts, Argument, Arguments};
use crate::cloud::reader::Format;
use crate::harmonics::FilterKind;
use crate::http::results::offered::Resource;
use crate::http::results::request::Query;
use crate::http::wire::accept::{JSON, Offer};
use crate::http::wire::query::{self, BasesMax};
use crate::http::wire::service::{Limits, Shared};
use crate::operator::OperatorKind;

/// What the service can do, and how much of it.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Capabilities {
    /// Formats of clouds.
    formats: Formats,
    /// Operators by name.
    operators: Vec<&'static str>,
    /// Parameters of a job.
    parameters: Vec<ParameterView>,
    /// Parameters of an upload.
    upload_parameters: Vec<ParameterView>,
    /// Filters by name.
    filters: Vec<&'static str>,
    /// Results of jobs by name: their formats and parameters.
    results: BTreeMap<&'static str, ResultView>,
    /// Limits.
    limits: Limits,
}

/// Formats of clouds and results.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Formats {
    /// Formats of uploads.
    upload: Vec<FormatView>,
    /// Formats of `/clouds/{id}/points`.
    points: Vec<FormatView>,
    /// Formats of `/jobs/{id}/bases`.
    bases: Vec<FormatView>,
}

/// A result of jobs, at `/jobs/{id}/{name}`.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ResultView {
    /// Its formats, the default first.
    formats: Vec<FormatView>,
    /// Its parameters.
    parameters: Vec<ParameterView>,
}

/// A file format.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct FormatView {
    /// As in `?format=`.
    name: &'static str,
    /// Its media type.
    media_type: &'static str,
}

/// A parameter.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ParameterView {
    /// Its name.
    name: &'static str,
    /// Another name for it.
    alias: Option<&'static str>,
    /// `integer`, `number`, `boolean` or `string`.
    #[serde(rename = "type")]
    kind: &'static str,
    /// Its values, in words.
    accepted: String,
    /// Its values, as a JSON schema.
    #[schema(value_type = Object)]
    schema: Value,
    /// Its value when absent, in words if it depends on other things.
    default: String,
    /// What it does, with units.
    meaning: &'static str,
}

impl From<&Argument> for ParameterView {
    fn from(argument: &Argument) -> Self {
        let kind = match argument.accepts {
            Accepts::Integer(..) => "integer",
            Accepts::Positive | Accepts::NonNegative | Accepts::Range(..) => "number",
            Accepts::Switch => "boolean",
            Accepts::Word(_) | Accepts::Id | Accepts::Text | Accepts::Names => "string",
        };
        Self {
            name: argument.name,
            alias: argument.alias,
            kind,
            accepted: argument.accepts.in_words(),
            schema: serde_json::to_value(query::schema(argument.accepts)).unwrap_or_default(),
            default: argument.absent.in_words(),
            meaning: argument.meaning,
        }
    }
}

fn offered(offers: &[Offer]) -> Vec<FormatView> {
    offers.iter().map(|offer| FormatView { name: offer.name, media_type: offer.media_type() }).collect()
}

fn parameters<A: Arguments>() -> Vec<ParameterView> {
    query::table::<A>().iter().map(ParameterView::from).collect()
}

fn result<R: Resource>() -> ResultView {
    ResultView { formats: offered(R::OFFERS), parameters: parameters::<Query<R>>() }
}

fn results() -> BTreeMap<&'static str, ResultView> {
    let compared = ResultView { formats: offered(&[JSON]), parameters: parameters::<similarity::Compare>() };
    let named = files::NAMED.iter().map(|result| {
        let parameters = (result.parameters)().iter().map(ParameterView::from).collect();
        (result.name, ResultView { formats: offered(result.offers), parameters })
    });
    let others = [
        ("bases/{basis}/image.png", result::<image::ReadImage>()),
        ("laplacian", result::<laplacian::ApplyLaplacian>()),
        ("synthesis", result::<coefficients::Synthesize>()),
        ("similarity", compared),
    ];
    named.chain(others).collect()
}

/// Formats, operators, filters, parameters with type, range, default and meaning, and limits.
#[utoipa::path(get, path = "/capabilities", tag = "service", responses((status = 200, description = "What the service can do.", body = Capabilities)))]
pub(crate) async fn capabilities(State(service): State<Shared>) -> Json<Capabilities> {
    let limits = &service.limits;
    Json(Capabilities {
        formats: Formats {
            upload: Format::ALL
                .iter()
                .map(|format| FormatView { name: format.name(), media_type: format.media_type() })
                .collect(),
            points: offered(points::ReadPoints::OFFERS),
            bases: offered(bases::ReadBases::OFFERS),
        },
        operators: OperatorKind::ALL.map(OperatorKind::name).to_vec(),
        parameters: query::table_within::<JobArguments>(BasesMax(limits.bases_max))
            .iter()
            .map(ParameterView::from)
            .collect(),
        filters: FilterKind::ALL.map(FilterKind::name).to_vec(),
        results: results(),
        upload_parameters: parameters::<submission::ReadUpload>(),
        limits: limits.clone(),
    })
}
