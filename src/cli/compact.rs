//! `chladni compact`: the database without the space of deleted data, while no service runs.

use chladni::app::compact;
use serde_json::json;

use super::database::DatabaseArgs;
use super::reporting::Reporting;
use super::{Failure, block_on};

/// Rewrite the database without the space of deleted data. The service must be stopped, and the disk must have room for
/// the new file beside the old one.
#[derive(Debug, clap::Args)]
pub(crate) struct CompactArgs {
    #[command(flatten)]
    database: DatabaseArgs,

    #[command(flatten)]
    reporting: Reporting,
}

/// Compacts the database.
///
/// # Errors
/// [`Failure`]: no database there, one that is served, or a full disk; the file is as it was then.
pub(crate) fn run(args: &CompactArgs) -> Result<(), Failure> {
    let database = args.database.file("a PostgreSQL server looks after its space itself, by autovacuum")?;
    let size = || std::fs::metadata(database).map(|file| file.len()).map_err(Failure::other);
    let before = size()?;
    block_on(compact(database))?;
    let after = size()?;
    let facts = json!({ "bytes_before": before, "bytes": after });
    args.reporting.wrote(database, &format!("{before} bytes before, {after} bytes now"), facts);
    Ok(())
}
