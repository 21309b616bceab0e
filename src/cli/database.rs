//! The database of commands that work on its file.

use std::path::Path;

use chladni::app::DatabaseAddress;

use super::Failure;

/// Which database.
#[derive(Debug, clap::Args)]
pub(crate) struct DatabaseArgs {
    /// File of the database.
    #[arg(
        long,
        env = "CHLADNI_DATABASE",
        value_name = "FILE",
        hide_env_values = true,
        default_value = "chladni.db"
    )]
    database: DatabaseAddress,
}

impl DatabaseArgs {
    /// Its file; `of_server` says what does the same on a PostgreSQL server.
    ///
    /// # Errors
    /// [`Failure`]: it is on a server, or not there.
    pub(crate) fn file(&self, of_server: &str) -> Result<&Path, Failure> {
        let file = self.database.path().ok_or_else(|| Failure::Input(of_server.to_owned()))?;
        if file.is_file() {
            return Ok(file);
        }
        Err(Failure::Input(format!("there is no database at {}", file.display())))
    }
}
