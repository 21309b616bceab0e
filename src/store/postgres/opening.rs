//! The start on a PostgreSQL server: whatever is wrong is said in one line, with what to do about it.

use std::time::Duration;

use sqlx::error::DatabaseError;
use sqlx::postgres::{PgConnectOptions, PgConnection};
use sqlx::{ConnectOptions, Connection, Error};

use crate::store::{DatabaseAddress, StoreError};

/// PostgreSQL 15 is the oldest that is tested, and the oldest that the project itself supports for years to come.
const VERSION_MIN: i32 = 15;

/// How long the server may take to answer.
const ANSWER: Duration = Duration::from_secs(15);

/// Checks server and database, and brings the tables up to date. Returns how to connect.
pub(super) async fn prepare(address: &DatabaseAddress) -> Result<PgConnectOptions, StoreError> {
    let options = address.server().ok_or(Error::PoolClosed).and_then(|options| options).map_err(unusable)?;
    let options = options.application_name("chladni");
    let mut connection = match tokio::time::timeout(ANSWER, options.connect()).await {
        Ok(connected) => connected.map_err(|error| not_connected(&options, error))?,
        Err(_) => {
            return Err(refuse(format!(
                "{} did not answer in {} seconds; check host, port and firewall",
                place(&options),
                ANSWER.as_secs()
            )));
        }
    };
    check_server(&mut connection).await?;
    check_owner(&mut connection).await?;
    // Under an advisory lock of the driver: nodes that start together migrate one after the other.
    sqlx::migrate!("./migrations/postgres")
        .run(&mut connection)
        .await
        .map_err(|error| may_lack_rights(&options, StoreError::not_migrated(error)))?;
    let written = sqlx::query(
        "INSERT INTO probes (id, beats) VALUES (1, 1) ON CONFLICT (id) DO UPDATE SET beats = probes.beats + 1",
    )
    .execute(&mut connection)
    .await;
    written.map_err(|error| may_lack_rights(&options, error.into()))?;
    connection.close().await?;
    Ok(options)
}

fn refuse(why: String) -> StoreError {
    StoreError::Database(why)
}

fn unusable(_: Error) -> StoreError {
    refuse(
        "it is not an address such as postgres://user:password@host:5432/database; a database of SQLite is given by the path \
         of its file"
            .to_owned(),
    )
}

/// Host and port, or the socket's folder.
fn place(options: &PgConnectOptions) -> String {
    match options.get_socket() {
        Some(folder) => format!("the server at the socket in {}", folder.display()),
        None => format!("the server at {}:{}", options.get_host(), options.get_port()),
    }
}

fn not_connected(options: &PgConnectOptions, error: Error) -> StoreError {
    let server = place(options);
    let user = options.get_username();
    let database = options.get_database().unwrap_or(user);
    let code = error.as_database_error().and_then(DatabaseError::code).map(|code| code.to_string());
    let why = match (code.as_deref(), error) {
        (Some("28P01" | "28000"), error) => format!(
            "{server} refuses user {user}: {}; check the user, the password (in the address or in PGPASSWORD) and the \
             server's pg_hba.conf",
            said(&error)
        ),
        (Some("3D000"), _) => {
            format!("{server} has no database {database}; create it: createdb --owner {user} {database}")
        }
        (Some("42501"), _) => format!(
            "user {user} may not connect to database {database}; allow it: GRANT CONNECT ON DATABASE {database} TO {user}"
        ),
        (Some("53300"), _) => {
            format!("{server} has no connection left; raise its max_connections, or start fewer nodes")
        }
        (Some("57P03"), _) => format!("{server} is starting or stopping; start chladni again when it is up"),
        (_, Error::Io(cause)) => {
            format!(
                "{server} cannot be reached: {cause}; check that it runs, and host and port of the address"
            )
        }
        (_, Error::Tls(cause)) => {
            format!(
                "{server} offers no TLS connection that can be trusted: {cause}; check sslmode and sslrootcert"
            )
        }
        // The protocol ends where a server without it says no, or where no PostgreSQL server listens at all.
        (_, error) => format!("{server} cannot be used: {}", said(&error)),
    };
    refuse(why)
}

/// The server's words without "error returned from database".
fn said(error: &Error) -> String {
    error.as_database_error().map_or_else(|| error.to_string(), |error| error.message().to_owned())
}

async fn check_server(connection: &mut PgConnection) -> Result<(), StoreError> {
    let (version, name, encoding, standby, synchronous, fsync): (i32, String, String, bool, String, String) =
        sqlx::query_as(
            "SELECT current_setting('server_version_num')::int, current_setting('server_version'), \
             current_setting('server_encoding'), pg_is_in_recovery(), current_setting('synchronous_commit'), \
             current_setting('fsync')",
        )
        .fetch_one(connection)
        .await?;
    if !is_recent(version) {
        return Err(refuse(format!("the server is PostgreSQL {name}; {VERSION_MIN} or newer is needed")));
    }
    if encoding != "UTF8" {
        return Err(refuse(format!(
            "the database has the encoding {encoding}; create one with UTF8: createdb --encoding UTF8 --template template0"
        )));
    }
    if standby {
        return Err(refuse(
            "the server is a standby, which takes no writes; give the primary's address".to_owned(),
        ));
    }
    if synchronous == "off" || fsync == "off" {
        tracing::warn!(
            synchronous_commit = synchronous,
            fsync,
            "the server may forget what it has acknowledged when it crashes; both settings should be on"
        );
    }
    Ok(())
}

fn is_recent(version: i32) -> bool {
    version / 10_000 >= VERSION_MIN
}

/// Refuses a database in which another application has tables.
async fn check_owner(connection: &mut PgConnection) -> Result<(), StoreError> {
    let (tables, own): (i64, i64) = sqlx::query_as(
        "SELECT count(*), count(*) FILTER (WHERE table_name = '_sqlx_migrations') FROM information_schema.tables \
         WHERE table_schema = current_schema()",
    )
    .fetch_one(connection)
    .await?;
    if tables > 0 && own == 0 {
        return Err(refuse(
            "the database has tables of another application; give chladni a database of its own".to_owned(),
        ));
    }
    Ok(())
}

/// Tells what a user lacks that may not make or change tables.
fn may_lack_rights(options: &PgConnectOptions, error: StoreError) -> StoreError {
    let user = options.get_username();
    let database = options.get_database().unwrap_or(user);
    match error {
        StoreError::Database(cause) if cause.contains("permission denied") || cause.contains("no schema") => {
            refuse(format!(
                "user {user} may not create and change tables ({cause}); make it the owner: ALTER DATABASE {database} OWNER \
                 TO {user}"
            ))
        }
        error => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_is_recent_from_version_15_on() {
        for version in [150_000, 150_018, 160_004, 180_000] {
            assert!(is_recent(version), "{version}");
        }
        for version in [149_999, 140_012, 90_624] {
            assert!(!is_recent(version), "{version}");
        }
    }
}
