//! API keys: bearer tokens, compared in constant time.

use std::sync::{Arc, PoisonError, RwLock};

use axum::extract::{Request, State};
use axum::http::header;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;

use super::guard::PROBES;
use super::notation::short_digest;
use super::problem::{Kind, Problem};
use crate::store::Owner;

/// Paths answered without a key beside the probes: pages about the service itself.
const OPEN_PATHS: [&str; 3] = ["/", "/docs", "/capabilities"];
/// Beginnings of further ones.
const OPEN_PREFIXES: [&str; 3] = ["/openapi.", "/problems/", "/viewer/"];
/// A shorter key can be guessed.
const KEY_LENGTH_MIN: usize = 16;
/// Stands between a name and the one that it had before, in an entry `lab was laboratory`.
pub const WAS: &str = "was";

/// The accepted keys, as digests, so that comparison tells nothing of lengths either. Clones share them: what is replaced
/// in one is replaced in all.
#[derive(Clone)]
pub struct Keys {
    list: Arc<RwLock<Arc<List>>>,
}

/// What a list of keys says.
struct List {
    keys: Vec<Key>,
    renamed: Vec<Renamed>,
}

struct Key {
    digest: [u8; 32],
    owner: Owner,
    /// The owner that the same key has without a name.
    unnamed: Owner,
    is_short: bool,
}

/// Whose everything is that was another name's.
struct Renamed {
    before: Owner,
    now: Owner,
}

/// Why a list of keys cannot be used. Never repeats what stands in it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum KeysError {
    /// There is none.
    #[error("it contains no keys; `chladni keys add NAME` makes one")]
    Empty,
    /// An entry of more than two words.
    #[error("entry {0} has more than a name and a key")]
    Words(usize),
    /// An entry that gives away what a name has, and that name has a key.
    #[error(
        "entry {0} gives to another name what a name with a key of its own has; take out that entry or that key"
    )]
    Given(usize),
    /// The same key twice.
    #[error("entry {0} repeats the key of an earlier one")]
    Repeated(usize),
}

impl Keys {
    /// Keys from a text: one per line or between commas, empty lines and lines that begin with `#` left out. A key has
    /// the name of its owner before it, `pipeline 0b7f…`: keys of the same name see the same clouds and jobs, so that a
    /// key can be replaced by another. A key without a name is an owner of its own.
    ///
    /// An entry of three words, `lab was laboratory`, gives to `lab` what `laboratory` had. It may stay where it is, but not
    /// beside a key of the former name, whose data would go too.
    ///
    /// # Errors
    /// [`KeysError`].
    pub fn parse(text: &str) -> Result<Self, KeysError> {
        let (mut keys, mut renamed): (Vec<Key>, Vec<(usize, Renamed)>) = (Vec::new(), Vec::new());
        for (number, entry) in (1..).zip(entries(text)) {
            let (name, key) = match entry.split_whitespace().collect::<Vec<_>>().as_slice() {
                [key] => (None, *key),
                [name, key] => (Some(*name), *key),
                &[now, WAS, before] => {
                    renamed.push((number, Renamed { before: Owner::named(before), now: Owner::named(now) }));
                    continue;
                }
                _ => return Err(KeysError::Words(number)),
            };
            let (digest, unnamed) = (digest(key), unnamed(key));
            if keys.iter().any(|known| known.digest == digest) {
                return Err(KeysError::Repeated(number));
            }
            let owner = name.map_or_else(|| unnamed.clone(), Owner::named);
            keys.push(Key { digest, owner, unnamed, is_short: key.len() < KEY_LENGTH_MIN });
        }
        if keys.is_empty() {
            return Err(KeysError::Empty);
        }
        let has_key = |owner: &Owner| keys.iter().any(|key| key.owner == *owner);
        if let Some((number, _)) = renamed.iter().find(|(_, renamed)| has_key(&renamed.before)) {
            return Err(KeysError::Given(*number));
        }
        let renamed = renamed.into_iter().map(|(_, renamed)| renamed).collect();
        Ok(Self { list: Arc::new(RwLock::new(Arc::new(List { keys, renamed }))) })
    }

    /// Accepts the keys of `other` from now on, and no longer those of before.
    pub fn replace(&self, other: &Self) {
        let list = other.list();
        *self.list.write().unwrap_or_else(PoisonError::into_inner) = list;
    }

    fn list(&self) -> Arc<List> {
        Arc::clone(&self.list.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// How many keys there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.list().keys.len()
    }

    /// Places, counted from 1, of keys that are short enough to be guessed.
    #[must_use]
    pub fn short(&self) -> Vec<usize> {
        (1..).zip(&self.list().keys).filter(|(_, key)| key.is_short).map(|(place, _)| place).collect()
    }

    /// Whose everything was, and whose it is: for every key with a name what it had without one, then what names had
    /// before they were renamed.
    #[must_use]
    pub fn adoptions(&self) -> Vec<(Owner, Owner)> {
        let list = self.list();
        let named = list.keys.iter().filter(|key| key.owner != key.unnamed);
        let named = named.map(|key| (key.unnamed.clone(), key.owner.clone()));
        let renamed = list.renamed.iter().map(|renamed| (renamed.before.clone(), renamed.now.clone()));
        named.chain(renamed).collect()
    }

    /// Whether an owner has a key.
    #[must_use]
    pub fn has(&self, owner: &Owner) -> bool {
        self.list().keys.iter().any(|key| key.owner == *owner)
    }

    /// The owner behind a token. All keys are compared, whichever it is.
    fn owner_of(&self, token: &str) -> Option<Owner> {
        let offered = digest(token);
        let list = self.list();
        let found = list.keys.iter().fold(None, |found, key| {
            if key.digest.as_slice().ct_eq(offered.as_slice()).into() { Some(&key.owner) } else { found }
        });
        found.cloned()
    }
}

/// The entries of a list of keys, each a key or a name and a key.
fn entries(text: &str) -> impl Iterator<Item = &str> {
    // Some editors put a mark of the encoding before everything.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let lines = text.lines().filter(|line| !line.trim_start().starts_with('#'));
    lines.flat_map(|line| line.split(',')).map(str::trim).filter(|entry| !entry.is_empty())
}

/// Whether a path is answered without a key.
fn is_open(path: &str) -> bool {
    PROBES.contains(&path)
        || OPEN_PATHS.contains(&path)
        || OPEN_PREFIXES.iter().any(|prefix| path.starts_with(prefix))
}

fn digest(key: &str) -> [u8; 32] {
    Sha256::digest(key.as_bytes()).into()
}

/// The owner of a key without a name: told apart by a digest that is not the one by which the key is accepted. Names have
/// no space, so none is taken for it.
fn unnamed(key: &str) -> Owner {
    Owner::named(&format!("key {}", short_digest(&[b"owner of ".as_slice(), key.as_bytes()].concat())))
}

/// Lets requests with an accepted key pass, and notes whose they are.
pub(crate) async fn require(State(keys): State<Option<Keys>>, mut request: Request, next: Next) -> Response {
    let Some(keys) = keys else { return next.run(request).await };
    if is_open(request.uri().path()) {
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
            let mut response = next.run(request).await;
            // For the log.
            response.extensions_mut().insert(owner);
            response
        }
        Some(None) => refuse("the key is not accepted; it may have been revoked"),
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
        Keys::parse(text).unwrap().owner_of(token)
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
            ("lab was secret", KeysError::Empty),
            ("lab key, lab was secret\nsecret other-key", KeysError::Given(2)),
            ("lab key, lab was lab", KeysError::Given(2)),
        ] {
            let refused = Keys::parse(text).err().unwrap();
            assert_eq!(refused, error);
            assert!(!refused.to_string().contains("secret"));
        }
    }

    #[test]
    fn a_mark_of_the_encoding_is_no_part_of_a_key() {
        assert!(owner_of("\u{feff}alpha-key\n", "alpha-key").is_some());
        assert_eq!(owner_of("\u{feff}lab alpha-key", "alpha-key"), Some(Owner::named("lab")));
    }

    #[test]
    fn keys_that_can_be_guessed_are_counted() {
        assert_eq!(Keys::parse("x\nlab 0123456789abcdef,lab 0123456789abcde").unwrap().short(), [1, 3]);
    }

    #[test]
    fn a_key_with_a_name_adopts_what_it_had_without() {
        let before = owner_of("alpha-key", "alpha-key").unwrap();
        let keys = Keys::parse("lab alpha-key\nbeta-key").unwrap();
        assert_eq!(keys.adoptions(), [(before, Owner::named("lab"))]);
    }

    #[test]
    fn a_name_has_what_it_had_under_another_one() {
        let keys = Keys::parse("key-without-name, lab was laboratory").unwrap();
        assert_eq!(keys.adoptions(), [(Owner::named("laboratory"), Owner::named("lab"))]);
        assert!(owner_of("lab was laboratory, other-key", "laboratory").is_none(), "it is no key");
        // a key may be called so
        assert_eq!(owner_of("was key", "key"), Some(Owner::named("was")));
    }

    #[test]
    fn replaced_keys_are_replaced_in_all_clones() {
        let keys = Keys::parse("alpha-key").unwrap();
        let clone = keys.clone();
        keys.replace(&Keys::parse("beta-key").unwrap());
        assert!(clone.owner_of("alpha-key").is_none() && clone.owner_of("beta-key").is_some());
    }

    #[test]
    fn pages_that_tell_of_the_service_need_no_key() {
        for open in
            ["/", "/docs", "/openapi.yaml", "/openapi.json", "/problems/not-found", "/capabilities", "/livez"]
        {
            assert!(is_open(open), "{open}");
        }
        for closed in ["/clouds", "/jobs", "/metrics", "/docs/x", "/problemsx", "//", "/jobs/openapi."] {
            assert!(!is_open(closed), "{closed}");
        }
    }
}
