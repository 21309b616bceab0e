//! Results under file names, for `curl -O`: `/jobs/{id}/bases.npy` is `/jobs/{id}/bases?format=npy`.

use std::future::Future;
use std::sync::LazyLock;

use axum::extract::{Request, State};
use axum::response::Response;
use axum::routing::get;
use utoipa_axum::router::OpenApiRouter;

use super::{bases, coefficients, distances, features, filtered, operator, signatures, spectrum};
use crate::arguments::Argument;
use crate::http::results::offered::Resource;
use crate::http::results::request::{Query, ResultRequest};
use crate::http::wire::accept::Offer;
use crate::http::wire::problem::Problem;
use crate::http::wire::query;
use crate::http::wire::service::Shared;

/// A result of jobs that has file names.
pub(crate) struct Named {
    /// The last part of its path.
    pub name: &'static str,
    /// Its formats.
    pub offers: &'static [Offer],
    /// Its parameters.
    pub parameters: fn() -> Vec<Argument>,
}

/// Results that have file names.
pub(crate) static NAMED: LazyLock<Vec<Named>> = LazyLock::new(|| routes().1);

/// The routes of all files.
pub(crate) fn router() -> OpenApiRouter<Shared> {
    routes().0
}

type Routes = (OpenApiRouter<Shared>, Vec<Named>);

fn routes() -> Routes {
    let routes = Routes::default();
    let routes = add(routes, "bases", bases::bases);
    let routes = add(routes, "spectrum", spectrum::spectrum);
    let routes = add(routes, "operator", operator::operator);
    let routes = add(routes, "coefficients", coefficients::coefficients);
    let routes = add(routes, "filtered", filtered::filtered);
    let routes = add(routes, "features", features::features);
    let routes = add(routes, "signatures", signatures::signatures);
    add(routes, "distances", distances::distances)
}

/// A route for each format of a resource, answered by the resource's own handler.
fn add<R, F, Answer>((mut router, mut named): Routes, name: &'static str, handler: F) -> Routes
where
    R: Resource + Send + Sync,
    F: Fn(ResultRequest<R>) -> Answer + Clone + Send + Sync + 'static,
    Answer: Future<Output = Result<Response, Problem>> + Send + 'static,
{
    for &offer in R::OFFERS {
        let handler = handler.clone();
        let file = move |State(service): State<Shared>, request: Request| {
            let handler = handler.clone();
            async move {
                let (mut parts, _) = request.into_parts();
                handler(ResultRequest::of_file(&mut parts, &service, offer).await?).await
            }
        };
        router = router.route(&format!("/jobs/{{id}}/{name}.{}", offer.name), get(file));
    }
    named.push(Named { name, offers: R::OFFERS, parameters: query::table::<Query<R>> });
    (router, named)
}
