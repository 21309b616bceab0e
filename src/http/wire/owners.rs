//! Ownership: finds the owner of a request and hides resources of others.

use axum::extract::rejection::RawPathParamsRejection;
use axum::extract::{RawPathParams, Request, State};
use axum::http::{Extensions, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use uuid::Uuid;

use super::problem::{Kind, Problem};
use super::service::Shared;
use crate::store::{Owner, StoreError};

/// Whose request it is; nobody's where no key is asked for.
pub(crate) fn owner(extensions: &Extensions) -> Owner {
    extensions.get().cloned().unwrap_or_else(Owner::nobody)
}

/// Answers 404 to every request whose path names a cloud or job that is not the asker's, or is not there, whatever else
/// is wrong with it: the two cannot be told apart.
///
/// A layer around all routes, so that none can forget it.
pub(crate) async fn require_ownership(
    State(service): State<Shared>,
    named: Result<RawPathParams, RawPathParamsRejection>,
    request: Request,
    next: Next,
) -> Response {
    if let Err(RawPathParamsRejection::InvalidUtf8InPathParam(_)) = named {
        let told = "the path is not UTF-8 once its percent signs are decoded";
        return Problem::new(Kind::MalformedRequest, told).into_response();
    }
    // `PUT /clouds/{name}` names a file.
    if request.method() != Method::PUT {
        let owner = owner(request.extensions());
        let ids = named.iter().flatten().filter_map(|(_, text)| text.parse().ok());
        let ids = ids.collect::<Vec<Uuid>>();
        let (path, first) = (request.uri().path().to_owned(), ids.first().copied());
        for id in ids {
            match service.store.owns(&owner, id).await {
                Ok(true) => {}
                Ok(false) => return Problem::from(StoreError::NotFound).into_response(),
                Err(error) => return Problem::from(error).into_response(),
            }
        }
        let response = next.run(request).await;
        if let (StatusCode::NOT_FOUND, Some(id)) = (response.status(), first)
            && let Some(hint) = other_kind(&service, &path, id).await
        {
            return hint.into_response();
        }
        return response;
    }
    next.run(request).await
}

/// The problem of a path to a job that names a cloud, or the other way round. Only its owner gets here.
async fn other_kind(service: &Shared, path: &str, id: Uuid) -> Option<Problem> {
    let (kind, own) = if path.starts_with("/jobs/") && service.store.cloud(id).await.is_ok() {
        ("a cloud", format!("/clouds/{id}"))
    } else if path.starts_with("/clouds/") && service.store.job(id).await.is_ok() {
        ("a job", format!("/jobs/{id}"))
    } else {
        return None;
    };
    Some(Problem::new(Kind::NotFound, format!("{id} is {kind}: it is at {own}")).with("near", vec![own]))
}
