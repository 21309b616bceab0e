//! The OpenAPI document: generated from the routes, the same as the file at the top of the repository.

use std::sync::LazyLock;

use axum::http::header;
use axum::response::{IntoResponse, Response};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::tag::TagBuilder;
use utoipa::openapi::{
    ComponentsBuilder, InfoBuilder, LicenseBuilder, OpenApi, OpenApiBuilder, SecurityRequirement,
};

use super::examples;
use super::problem::Problem;

/// What the routes are added to.
pub(super) fn base() -> OpenApi {
    let key = SecurityScheme::Http(HttpBuilder::new().scheme(HttpAuthScheme::Bearer).build());
    let tag = |name, description| TagBuilder::new().name(name).description(Some(description)).build();
    OpenApiBuilder::new()
        .info(
            InfoBuilder::new()
                .title("chladni")
                .version(env!("CARGO_PKG_VERSION"))
                .description(Some(
                    "Spectral geometry of scanned surfaces: upload a point cloud, get its Laplace–Beltrami operator, spectrum and \
                     manifold harmonics. Row i of every result is point i of the upload. Errors are RFC 9457 problems.",
                ))
                .license(Some(LicenseBuilder::new().name("MIT OR Apache-2.0").identifier(Some("MIT OR Apache-2.0")).build()))
                .build(),
        )
        .components(Some(ComponentsBuilder::new().security_scheme("key", key).build()))
        .security(Some([SecurityRequirement::default(), SecurityRequirement::new("key", Vec::<String>::new())]))
        .tags(Some([
            tag("clouds", "Point clouds."),
            tag("jobs", "Analyses of clouds."),
            tag("results", "What analyses found."),
            tag("harmonics", "What the bases are for: transform, filters, feature points, signatures, distances, similarity."),
            tag("service", "The service itself."),
        ]))
        .build()
}

/// The whole document.
#[must_use]
pub fn document() -> OpenApi {
    examples::illustrate(super::routes().into_openapi())
}

/// This interface as an OpenAPI document.
#[utoipa::path(
    get,
    path = "/openapi.yaml",
    tag = "service",
    responses((status = 200, description = "The document.", body = Object, content_type = "application/yaml"))
)]
pub(crate) async fn openapi() -> Result<Response, Problem> {
    // Made once: it takes milliseconds, too long for a thread that serves others.
    static YAML: LazyLock<Result<String, String>> =
        LazyLock::new(|| document().to_yaml().map_err(|error| error.to_string()));
    let yaml = YAML.as_ref().map_err(|error| Problem::internal(error))?;
    Ok(([(header::CONTENT_TYPE, "application/yaml")], yaml.as_str()).into_response())
}
