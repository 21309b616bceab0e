//! Where a database is: a file, or an address `postgres://…`.

use std::convert::Infallible;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use sqlx::postgres::PgConnectOptions;

/// A database's file or address. Shown without its password.
#[derive(Clone, PartialEq, Eq)]
pub struct DatabaseAddress(Place);

#[derive(Clone, PartialEq, Eq)]
enum Place {
    File(PathBuf),
    Postgres(String),
}

impl DatabaseAddress {
    /// The database in a file.
    #[must_use]
    pub fn file(path: impl Into<PathBuf>) -> Self {
        Self(Place::File(path.into()))
    }

    /// The file; `None` for a server's address.
    #[must_use]
    pub fn path(&self) -> Option<&Path> {
        match &self.0 {
            Place::File(path) => Some(path),
            Place::Postgres(_) => None,
        }
    }

    /// What PostgreSQL's driver makes of the address; `None` for a file.
    pub(super) fn server(&self) -> Option<Result<PgConnectOptions, sqlx::Error>> {
        match &self.0 {
            Place::File(_) => None,
            Place::Postgres(address) if is_postgres(address) => Some(address.parse()),
            // the driver takes any scheme for its own
            Place::Postgres(_) => Some(Err(sqlx::Error::Configuration("another scheme".into()))),
        }
    }
}

impl From<PathBuf> for DatabaseAddress {
    fn from(path: PathBuf) -> Self {
        Self::file(path)
    }
}

impl FromStr for DatabaseAddress {
    type Err = Infallible;

    /// Validity is checked on opening: a parse error on the command line would print the password.
    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(if text.contains("://") { Self(Place::Postgres(text.to_owned())) } else { Self::file(text) })
    }
}

impl fmt::Display for DatabaseAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Place::File(path) => write!(f, "{}", path.display()),
            Place::Postgres(address) => f.write_str(&without_secrets(address)),
        }
    }
}

impl fmt::Debug for DatabaseAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

fn is_postgres(address: &str) -> bool {
    let scheme = address.split("://").next().unwrap_or_default();
    ["postgres", "postgresql"].iter().any(|known| scheme.eq_ignore_ascii_case(known))
}

/// Scheme, user, host and name: a password may stand before the host or among the parameters. Of an address with signs that
/// had to be escaped only the scheme is shown: where its password ends is a guess.
fn without_secrets(address: &str) -> String {
    let (scheme, all) = address.split_once("://").unwrap_or(("", address));
    let rest = all.split(['?', '#']).next().unwrap_or_default();
    if all.matches('@').count() > rest.matches('@').count().min(1) {
        return format!("{scheme}://…");
    }
    let (user, place) = match rest.split_once('@') {
        Some((login, place)) => (login.split(':').next().filter(|user| !user.is_empty()), place),
        None => (None, rest),
    };
    let user = user.map(|user| format!("{user}@")).unwrap_or_default();
    format!("{scheme}://{user}{place}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_form_of_an_address_shows_its_password() {
        for (address, shown) in [
            ("postgres://kim:s3cret@db.example:5433/chladni", "postgres://kim@db.example:5433/chladni"),
            ("postgres://kim:s%40cret@db.example/chladni", "postgres://kim@db.example/chladni"),
            ("postgres://kim@db.example/chladni?password=s3cret", "postgres://kim@db.example/chladni"),
            ("postgres://kim:s3@cret@db.example/chladni", "postgres://…"),
            ("postgres://kim:s3?cret@db.example/chladni", "postgres://…"),
            ("postgres://kim@db.example/chladni?password=s3@cret", "postgres://…"),
            ("postgresql:///chladni?host=/tmp&user=kim&password=s3cret", "postgresql:///chladni"),
        ] {
            let address: DatabaseAddress = address.parse().unwrap();
            assert_eq!((address.to_string(), format!("{address:?}")), (shown.to_owned(), shown.to_owned()));
            assert_eq!(address.path(), None);
        }
    }

    #[test]
    fn addresses_of_other_databases_are_neither_files_nor_servers() {
        for other in ["mysql://kim@db/chladni", "sqlite://chladni.db", "http://db.example/"] {
            let address: DatabaseAddress = other.parse().unwrap();
            assert_eq!(address.path(), None, "{other}");
            assert!(address.server().unwrap().is_err(), "{other}");
        }
        let address: DatabaseAddress = "PostgreSQL://db.example/chladni".parse().unwrap();
        assert!(address.server().unwrap().is_ok());
    }

    #[test]
    fn anything_else_is_a_file() {
        let address: DatabaseAddress = "data/postgres.db".parse().unwrap();
        assert_eq!(address.path(), Some(Path::new("data/postgres.db")));
    }
}
