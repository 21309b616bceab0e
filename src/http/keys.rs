//! API keys: bearer tokens, compared in constant time.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};
use subtle::{Choice, ConstantTimeEq};

use super::problem::{Kind, Problem};

/// Probes that an orchestrator asks without a key.
const OPEN_PATHS: [&str; 2] = ["/livez", "/readyz"];

/// The accepted keys, as digests, so that comparison tells nothing of lengths either.
#[derive(Clone)]
pub struct Keys {
    digests: Arc<[[u8; 32]]>,
}

impl Keys {
    /// Keys from a file's text: one per line, empty lines and lines that begin with `#` left out.
    ///
    /// Returns `None` when there is no key in it.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let digests: Arc<[_]> = text
            .lines()
            .map(str::trim)
            .filter(|line| !line.is_empty() && !line.starts_with('#'))
            .map(digest)
            .collect();
        (!digests.is_empty()).then_some(Self { digests })
    }

    fn accept(&self, token: &str) -> bool {
        let offered = digest(token);
        let found = self
            .digests
            .iter()
            .fold(Choice::from(0), |found, known| found | known.as_slice().ct_eq(offered.as_slice()));
        found.into()
    }
}

fn digest(key: &str) -> [u8; 32] {
    Sha256::digest(key.as_bytes()).into()
}

/// Lets requests with an accepted key pass.
pub(crate) async fn require(State(keys): State<Option<Keys>>, request: Request, next: Next) -> Response {
    let Some(keys) = keys else { return next.run(request).await };
    if OPEN_PATHS.contains(&request.uri().path()) {
        return next.run(request).await;
    }
    let token = request
        .headers()
        .get(header::AUTHORIZATION)
        .and_then(|value| value.to_str().ok())
        .and_then(|value| value.split_once(' '))
        .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"))
        .map(|(_, token)| token.trim());
    match token {
        Some(token) if keys.accept(token) => next.run(request).await,
        Some(_) => refuse("the key is not accepted"),
        None => refuse("send a key as `Authorization: Bearer KEY`"),
    }
}

fn refuse(detail: &str) -> Response {
    Problem::new(Kind::Unauthorized, detail)
        .with_header(header::WWW_AUTHENTICATE, "Bearer realm=\"chladni\"")
        .into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_whole_key_is_accepted() {
        let keys = Keys::parse("# operators\nalpha-key\n\n  beta-key  \n").unwrap();
        assert!(keys.accept("alpha-key"));
        assert!(keys.accept("beta-key"));
        assert!(!keys.accept("alpha"));
        assert!(!keys.accept(""));
        assert!(!keys.accept("# operators"));
    }

    #[test]
    fn a_file_without_keys_is_no_keys() {
        assert!(Keys::parse("# nothing\n\n").is_none());
    }
}
