//! `GET /`: where to go from here; to a browser, the viewer.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::State;
use axum::http::{Extensions, HeaderMap, HeaderValue, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use super::viewer_page;
use crate::http::wire::accept::{self, HTML, JSON};
use crate::http::wire::owners;
use crate::http::wire::problem::Problem;
use crate::http::wire::service::Shared;

/// Where clients find the description of this interface (RFC 8631).
const LINKS: &str = "</openapi.json>; rel=\"service-desc\"; type=\"application/json\", \
     </openapi.yaml>; rel=\"service-desc\"; type=\"application/yaml\", \
     </docs>; rel=\"service-doc\"; type=\"text/html\"";

/// The way in.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Index {
    /// `chladni`.
    service: &'static str,
    /// Version of the service.
    version: &'static str,
    /// What it does.
    description: &'static str,
    /// Paths by name.
    links: BTreeMap<&'static str, &'static str>,
    /// A command to begin with.
    example: &'static str,
}

/// What this service is, and where to find what.
///
/// Browsers, which accept text/html, get a page that shows clouds and their modes.
#[utoipa::path(
    get,
    path = "/",
    tag = "service",
    responses((status = 200, description = "Links, or the page.", content((Index = "application/json"), (String = "text/html"))))
)]
pub(crate) async fn index(
    State(service): State<Shared>,
    uri: Uri,
    headers: HeaderMap,
    extensions: Extensions,
) -> Result<Response, Problem> {
    // A client that accepts neither gets the list all the same.
    let mut response = if accept::choose(None, &headers, &[JSON, HTML]).is_ok_and(|offer| offer == HTML) {
        let owner = service.keys.is_none().then(|| owners::owner(&extensions));
        viewer_page::page(&service, owner.as_ref(), &uri).await?
    } else {
        links().into_response()
    };
    response.headers_mut().insert(header::LINK, HeaderValue::from_static(LINKS));
    response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    Ok(response)
}

fn links() -> Json<Index> {
    Json(Index {
        service: env!("CARGO_PKG_NAME"),
        version: env!("CARGO_PKG_VERSION"),
        description: env!("CARGO_PKG_DESCRIPTION"),
        links: BTreeMap::from([
            ("capabilities", "/capabilities"),
            ("clouds", "/clouds"),
            ("documentation", "/docs"),
            ("jobs", "/jobs"),
            ("live", "/livez"),
            ("metrics", "/metrics"),
            ("openapi", "/openapi.yaml"),
            ("ready", "/readyz"),
        ]),
        example: "curl -T scan.ply 'http://HOST/clouds?bases=50'",
    })
}
