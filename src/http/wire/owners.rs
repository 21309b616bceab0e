//! Ownership: whose a request is, and whose the cloud or job that its path names.

use axum::extract::rejection::RawPathParamsRejection;
use axum::extract::{RawPathParams, Request, State};
use axum::http::{Extensions, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use uuid::Uuid;

use super::problem::Problem;
use crate::http::service::Shared;
use crate::store::{Owner, StoreError};

/// Whose request it is; nobody's where no key is asked for.
pub(crate) fn owner(extensions: &Extensions) -> Owner {
    extensions.get().cloned().unwrap_or_else(Owner::nobody)
}

/// Answers 404 to every request whose path names a cloud or job that is not the asker's, or is not there, whatever else
/// is wrong with it: the two cannot be told apart.
///
/// A layer around all routes, so that none can forget it.
pub(crate) async fn only_own(
    State(service): State<Shared>,
    named: Result<RawPathParams, RawPathParamsRejection>,
    request: Request,
    next: Next,
) -> Response {
    // `PUT /clouds/{name}` names a file.
    if request.method() != Method::PUT {
        let owner = owner(request.extensions());
        let ids = named.iter().flatten().filter_map(|(_, text)| text.parse().ok());
        for id in ids.collect::<Vec<Uuid>>() {
            match service.store.owns(&owner, id).await {
                Ok(true) => {}
                Ok(false) => return Problem::from(StoreError::NotFound).into_response(),
                Err(error) => return Problem::from(error).into_response(),
            }
        }
    }
    next.run(request).await
}
