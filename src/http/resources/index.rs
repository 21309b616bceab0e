//! `GET /`: where to go from here.

use std::collections::BTreeMap;

use axum::Json;
use serde::Serialize;
use utoipa::ToSchema;

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
#[utoipa::path(get, path = "/", tag = "service", responses((status = 200, description = "Links.", body = Index)))]
pub(crate) async fn index() -> Json<Index> {
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
