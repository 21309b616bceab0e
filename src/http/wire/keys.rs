//! API keys: bearer tokens, compared in constant time.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;
use uuid::Uuid;

use super::problem::{Kind, Problem};
use crate::store::Owner;

/// Probes that an orchestrator asks without a key.
const OPEN_PATHS: [&str; 2] = ["/livez", "/readyz"];

/// The accepted keys, as digests, so that comparison tells nothing of lengths either.
#[derive(Clone)]
pub struct Keys {
    keys: Arc<[Key]>,
}

struct Key {
    digest: [u8; 32],
    owner: Owner,
}

/// Why a list of keys cannot be used. Never repeats what stands in it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum KeysError {
    /// There is none.
    #[error("there is no key in it")]
    Empty,
    /// An entry of more than two words.
    #[error("entry {0} has more than a name and a key")]
    Words(usize),
    /// The same key twice.
    #[error("entry {0} repeats the key of an earlier one")]
    Repeated(usize),
}

impl Keys {
    /// Keys from a text: one per line or between commas, empty lines and lines that begin with `#` left out. A key may
    /// have a name before it, `pipeline 0b7f…`: keys of the same name see the same clouds and jobs, so that a key can
    /// be replaced by another.
    ///
    /// # Errors
    /// [`KeysError`].
    pub fn parse(text: &str) -> Result<Self, KeysError> {
        let lines = text.lines().filter(|line| !line.trim_start().starts_with('#'));
        let entries = lines.flat_map(|line| line.split(',')).map(str::trim).filter(|entry| !entry.is_empty());
        let mut keys: Vec<Key> = Vec::new();
        for (number, entry) in (1..).zip(entries) {
            let key = match entry.split_whitespace().collect::<Vec<_>>().as_slice() {
                [key] => Key { digest: digest(key), owner: unnamed(key) },
                [name, key] => Key { digest: digest(key), owner: Owner::named(name) },
                _ => return Err(KeysError::Words(number)),
            };
            if keys.iter().any(|known| known.digest == key.digest) {
                return Err(KeysError::Repeated(number));
            }
            keys.push(key);
        }
        if keys.is_empty() { Err(KeysError::Empty) } else { Ok(Self { keys: keys.into() }) }
    }

    /// The owner behind a token. All keys are compared, whichever it is.
    fn owner_of(&self, token: &str) -> Option<&Owner> {
        let offered = digest(token);
        self.keys.iter().fold(None, |found, key| {
            if key.digest.as_slice().ct_eq(offered.as_slice()).into() { Some(&key.owner) } else { found }
        })
    }
}

fn digest(key: &str) -> [u8; 32] {
    Sha256::digest(key.as_bytes()).into()
}

/// The owner of a key without a name: told apart by a digest that is not the one by which the key is accepted. Names have
/// no space, so none is taken for it.
fn unnamed(key: &str) -> Owner {
    let digest = Sha256::digest([b"owner of ".as_slice(), key.as_bytes()].concat());
    Owner::named(&format!("key {}", Uuid::from_slice(&digest[..16]).unwrap_or_default().simple()))
}

/// Lets requests with an accepted key pass, and notes whose they are.
pub(crate) async fn require(State(keys): State<Option<Keys>>, mut request: Request, next: Next) -> Response {
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
    match token.map(|token| keys.owner_of(token)) {
        Some(Some(owner)) => {
            request.extensions_mut().insert(owner.clone());
            next.run(request).await
        }
        Some(None) => refuse("the key is not accepted"),
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

    fn owner_of(text: &str, token: &str) -> Option<Owner> {
        Keys::parse(text).unwrap().owner_of(token).cloned()
    }

    #[test]
    fn only_a_whole_key_is_accepted() {
        let text = "# operators\nalpha-key\n\n  beta-key  \nlab gamma-key";
        for key in ["alpha-key", "beta-key", "gamma-key"] {
            assert!(owner_of(text, key).is_some());
        }
        for other in ["alpha", "", "# operators", "lab", "lab gamma-key"] {
            assert!(owner_of(text, other).is_none(), "{other}");
        }
    }

    #[test]
    fn keys_of_one_name_have_one_owner_and_keys_without_a_name_one_each() {
        let text = "lab one,lab two,three,four";
        assert_eq!(owner_of(text, "one"), Some(Owner::named("lab")));
        assert_eq!(owner_of(text, "one"), owner_of(text, "two"));
        assert_ne!(owner_of(text, "three"), owner_of(text, "four"));
        assert_eq!(
            owner_of(text, "three"),
            owner_of("three", "three"),
            "the place in the file does not matter"
        );
        assert_ne!(owner_of(text, "three"), Some(Owner::nobody()));
    }

    #[test]
    fn a_list_that_cannot_be_used_is_refused_without_repeating_it() {
        for (text, error) in [
            ("# nothing\n\n", KeysError::Empty),
            ("a b\nsecret key words", KeysError::Words(2)),
            ("one secret\ntwo secret", KeysError::Repeated(2)),
        ] {
            let refused = Keys::parse(text).err().unwrap();
            assert_eq!(refused, error);
            assert!(!refused.to_string().contains("secret"));
        }
    }
}
