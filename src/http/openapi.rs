//! The OpenAPI document: generated from the routes, the same as the file at the top of the repository.

use serde_json::Value;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::tag::TagBuilder;
use utoipa::openapi::{
    ComponentsBuilder, InfoBuilder, LicenseBuilder, OpenApi, OpenApiBuilder, SecurityRequirement,
    ServerBuilder,
};

use super::generators;

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
        .servers(Some([ServerBuilder::new().url("/").description(Some("The service that this document comes from.")).build()]))
        .tags(Some([
            tag("clouds", "Point clouds."),
            tag("jobs", "Analyses of clouds."),
            tag("results", "What analyses found."),
            tag("harmonics", "What the bases are for: transform, filters, feature points, signatures, distances, similarity."),
            tag("service", "The service itself."),
        ]))
        .build()
}

/// The document as it is sent. Lives as long as the program.
#[derive(Debug)]
pub(crate) struct Description {
    /// As YAML.
    pub yaml: Result<String, String>,
    /// As JSON.
    pub json: Result<Value, String>,
}

impl Description {
    pub(super) fn of(document: &OpenApi) -> Self {
        Self {
            yaml: yaml(document).map_err(|error| error.to_string()),
            json: serde_json::to_value(document).map_err(|error| error.to_string()),
        }
    }
}

/// The document as YAML.
///
/// # Errors
/// When it cannot be written.
pub fn yaml(document: &OpenApi) -> Result<String, impl std::error::Error> {
    document.to_yaml().map(|yaml| generators::for_either_version(&yaml))
}
