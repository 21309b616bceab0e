//! `chladni backup`: a copy of the database, made while the service runs.

use std::path::PathBuf;

use chladni::app::backup;
use serde_json::json;

use super::database::DatabaseArgs;
use super::reporting::Reporting;
use super::{Failure, block_on};

/// Copy the database into a new file, as of one moment, while the service goes on.
#[derive(Debug, clap::Args)]
pub(crate) struct BackupArgs {
    /// The file to write; it must not be there yet. It is a database to serve from, as it is.
    copy: PathBuf,

    #[command(flatten)]
    database: DatabaseArgs,

    #[command(flatten)]
    reporting: Reporting,
}

/// Writes the copy.
///
/// # Errors
/// [`Failure`]: nothing to copy, a file that is there already, or a full disk.
pub(crate) fn run(args: &BackupArgs) -> Result<(), Failure> {
    let database =
        args.database.file("a PostgreSQL database is copied by its own tools: pg_dump --format=custom")?;
    if args.copy.exists() {
        return Err(Failure::Input(format!("{} is there already", args.copy.display())));
    }
    block_on(backup(database, &args.copy))?;
    let bytes = std::fs::metadata(&args.copy).map_err(Failure::other)?.len();
    args.reporting.wrote(&args.copy, &format!("{bytes} bytes"), json!({ "bytes": bytes }));
    Ok(())
}
