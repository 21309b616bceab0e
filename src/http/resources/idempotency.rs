//! `Idempotency-Key`: repeating a submission with its key returns the original answer.
//!
//! As in the IETF's draft-ietf-httpapi-idempotency-key-header: the same name with another request is refused. Refused
//! requests are not remembered; sending one again meets the same refusal.

use axum::http::{HeaderMap, HeaderValue, Uri};
use axum::response::Response;
use sha2::{Digest, Sha256};
use utoipa::openapi::path::{Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};
use utoipa::openapi::{RefOr, Required};

use crate::http::wire::problem::{Kind, Problem};
use crate::http::wire::request::REPLAYED;
use crate::store::{Owner, Store, Submitted};

/// The header.
pub(crate) const HEADER: &str = "idempotency-key";
/// Longest name.
const LENGTH_MAX: usize = 255;

/// The name of a request, if it has one, and what tells the request apart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Idempotency(Option<Key>);

#[derive(Debug, Clone, PartialEq, Eq)]
struct Key {
    name: String,
    request: [u8; 32],
}

impl Idempotency {
    /// Of a request with this body.
    ///
    /// # Errors
    /// A problem when the name is empty, too long, or not of visible characters.
    pub(crate) fn of(headers: &HeaderMap, uri: &Uri, body: &[u8]) -> Result<Self, Problem> {
        let Some(value) = headers.get(HEADER) else { return Ok(Self(None)) };
        let refuse = || {
            let accepted = format!("1 to {LENGTH_MAX} visible ASCII characters, such as a UUID");
            let told = format!("the header Idempotency-Key must be {accepted}");
            Problem::invalid("Idempotency-Key", told).with("accepted", accepted)
        };
        let name = value.to_str().map_err(|_| refuse())?.trim();
        if name.is_empty() || name.len() > LENGTH_MAX || headers.get_all(HEADER).iter().count() > 1 {
            return Err(refuse());
        }
        let mut digest = Sha256::new();
        let target = uri.path_and_query().map_or("/", |target| target.as_str());
        digest.update((target.len() as u64).to_le_bytes());
        digest.update(target);
        digest.update(body);
        Ok(Self(Some(Key { name: name.to_owned(), request: digest.finalize().into() })))
    }

    /// What this very request was answered with before, if it was.
    ///
    /// # Errors
    /// A problem when the name was given to another request.
    pub(crate) async fn replayed(&self, store: &Store, owner: &Owner) -> Result<Option<Submitted>, Problem> {
        let Some(key) = &self.0 else { return Ok(None) };
        match store.remembered(owner, &key.name).await? {
            Some(known) if known.request == key.request => Ok(Some(known.submitted)),
            Some(_) => Err(key.reused()),
            None => Ok(None),
        }
    }

    /// Remembers what this request is answered with.
    ///
    /// # Errors
    /// A problem when another request took the name meanwhile.
    pub(crate) async fn remember(
        &self,
        store: &Store,
        owner: &Owner,
        submitted: &Submitted,
    ) -> Result<(), Problem> {
        let Some(key) = &self.0 else { return Ok(()) };
        let known = store.remember(owner, key.name.clone(), key.request, submitted.clone()).await?;
        if known.request == key.request { Ok(()) } else { Err(key.reused()) }
    }
}

impl Key {
    fn reused(&self) -> Problem {
        Problem::new(
            Kind::KeyReused,
            format!(
                "the Idempotency-Key `{}` was sent with another path, query or body in the last day; \
                 give every submission a key of its own",
                self.name
            ),
        )
    }
}

/// Marks an answer as one that was given before.
pub(crate) fn mark(response: &mut Response) {
    response.headers_mut().insert(REPLAYED, HeaderValue::from_static("true"));
}

/// The header in the OpenAPI document.
pub(crate) struct IdempotencyKey;

impl utoipa::IntoParams for IdempotencyKey {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Parameter> {
        let schema = ObjectBuilder::new()
            .schema_type(Type::String)
            .min_length(Some(1))
            .max_length(Some(LENGTH_MAX))
            .build();
        let description = "Identifies this submission for a day: repeating the same request returns the same cloud and \
            job; a different request is refused.";
        let parameter = ParameterBuilder::new()
            .name("Idempotency-Key")
            .parameter_in(ParameterIn::Header)
            .required(Required::False)
            .description(Some(description))
            .schema(Some(RefOr::T(Schema::Object(schema))));
        vec![parameter.build()]
    }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderName;

    use super::*;

    fn key(name: &'static str, target: &'static str, body: &str) -> Result<Idempotency, Problem> {
        let headers =
            HeaderMap::from_iter([(HeaderName::from_static(HEADER), HeaderValue::from_static(name))]);
        Idempotency::of(&headers, &Uri::from_static(target), body.as_bytes())
    }

    #[test]
    fn a_request_is_told_apart_by_path_query_and_body() {
        let first = key("k", "/clouds?bases=5", "x").unwrap();
        assert_eq!(key("k", "/clouds?bases=5", "x").unwrap(), first);
        for (target, body) in
            [("/clouds?bases=6", "x"), ("/clouds", "x"), ("/clouds?bases=5", "y"), ("/clouds?bases=5x", "")]
        {
            assert_ne!(key("k", target, body).unwrap(), first);
        }
        assert_eq!(
            Idempotency::of(&HeaderMap::new(), &Uri::from_static("/"), b"").unwrap(),
            Idempotency(None)
        );
    }

    #[test]
    fn a_name_is_visible_and_short() {
        assert!(key("", "/", "").is_err());
        let long: &'static str = Box::leak("k".repeat(256).into_boxed_str());
        assert!(key(long, "/", "").is_err());
        assert!(key("8e03978e-40d5-43dd-bc93-6894a57f9324", "/", "").is_ok());
    }
}
