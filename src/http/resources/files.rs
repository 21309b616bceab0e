//! Results under file names, for `curl -O`: `/jobs/{id}/bases.npy` is `/jobs/{id}/bases?format=npy`.

use std::future::Future;

use axum::extract::{Request, State};
use axum::response::Response;
use axum::routing::get;
use utoipa_axum::router::OpenApiRouter;

use super::{bases, coefficients, distances, features, filtered, operator, signatures, spectrum};
use crate::http::results::offered::Resource;
use crate::http::results::request::ResultRequest;
use crate::http::service::Shared;
use crate::http::wire::accept::Offer;
use crate::http::wire::problem::Problem;

/// Results that have file names, by the last part of their path, with their formats.
pub(crate) fn named() -> Vec<(&'static str, &'static [Offer])> {
    routes().1
}

/// The routes of all files.
pub(crate) fn router() -> OpenApiRouter<Shared> {
    routes().0
}

type Routes = (OpenApiRouter<Shared>, Vec<(&'static str, &'static [Offer])>);

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
    named.push((name, R::OFFERS));
    (router, named)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::resources::jobs::EIGEN_RESULTS;

    #[test]
    fn every_result_that_a_job_links_to_has_files() {
        let named: Vec<_> = named().into_iter().map(|(name, _)| name).collect();
        let linked: Vec<_> = named.iter().copied().filter(|&name| name != "operator").collect();
        assert_eq!(linked, EIGEN_RESULTS);
    }
}
