//! `chladni compact`: the database without the space of deleted data, while no service runs.

use chladni::app::compact;

use super::database::DatabaseArgs;
use super::{Failure, block_on};

/// Rewrite the database without the space of deleted data. The service must be stopped, and the disk must have room for
/// the new file beside the old one.
#[derive(Debug, clap::Args)]
pub(crate) struct CompactArgs {
    #[command(flatten)]
    database: DatabaseArgs,
}

/// Compacts the database.
///
/// # Errors
/// [`Failure`]: no database there, one that is served, or a full disk; the file is as it was then.
#[allow(clippy::print_stdout)] // tells what was done
pub(crate) fn run(args: &CompactArgs) -> Result<(), Failure> {
    let database = args.database.file("a PostgreSQL server looks after its space itself, by autovacuum")?;
    let size = || std::fs::metadata(database).map(|file| file.len()).map_err(Failure::other);
    let before = size()?;
    block_on(compact(database))?;
    println!("{}: {before} bytes before, {} bytes now", database.display(), size()?);
    Ok(())
}
