//! `chladni migrate`: from an SQLite file to a PostgreSQL database.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;

use chladni::app::{DatabaseAddress, Moved, migrate};

use super::reporting::print;
use super::{Failure, run_on_runtime};

/// Copy clouds, jobs and results from an SQLite file into an empty PostgreSQL database, and check their digests. No service
/// may run on either. The file stays as it is; a copy that was broken off goes on where it ended when it is called again.
#[derive(Debug, clap::Args)]
pub(crate) struct MigrateArgs {
    /// File of the database to copy.
    #[arg(long, value_name = "FILE", default_value = "chladni.db")]
    from: PathBuf,

    /// Address of the database to fill, such as `postgres://user@host/chladni`; its password is better given by `PGPASSWORD`.
    #[arg(long, value_name = "ADDRESS")]
    to: DatabaseAddress,
}

/// Copies everything.
///
/// # Errors
/// [`Failure`]: nothing to copy, a target that is not PostgreSQL; one that is not empty, a service that runs, damage.
pub(crate) fn run(args: &MigrateArgs) -> Result<(), Failure> {
    if !args.from.is_file() {
        return Err(Failure::Input(format!("there is no database at {}", args.from.display())));
    }
    if args.to.path().is_some() {
        return Err(Failure::Input(format!(
            "{} is a file; --to takes an address such as postgres://user@host/chladni",
            args.to
        )));
    }
    run_on_runtime(async {
        let moved = migrate(&args.from, &args.to, report).await.map_err(Failure::other)?;
        let Moved { clouds, jobs, found } = moved;
        print(format_args!("{}: {clouds} clouds and {jobs} jobs, every digest checked", args.to))?;
        if found > 0 {
            print(format_args!("{found} of them had been copied before"))?;
        }
        Ok(())
    })
}

/// One line that is written over, for whoever looks on.
fn report(moved: Moved) {
    let mut terminal = std::io::stderr();
    if terminal.is_terminal() {
        let _ = write!(terminal, "\r{} clouds, {} jobs\x1b[K\r", moved.clouds, moved.jobs);
    }
}
