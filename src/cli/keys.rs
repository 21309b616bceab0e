//! `chladni keys`: the file of API keys.

use std::path::PathBuf;

use chladni::app::{KeyFile, KeyFileError};
use serde_json::json;

use super::Failure;

/// Keep the file of API keys: add, list, rotate, revoke.
#[derive(Debug, clap::Args)]
pub(crate) struct KeysArgs {
    /// File of the keys; made when it is not there
    #[arg(long, env = "CHLADNI_API_KEYS", value_name = "FILE", default_value = "keys", global = true)]
    api_keys: PathBuf,

    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Make a key for a new owner and print it
    Add {
        /// Whose it is: keys of one name see the same clouds and jobs
        name: String,
    },
    /// Show names and fingerprints, not keys
    List {
        /// As JSON
        #[arg(long)]
        json: bool,
    },
    /// Make another key for an owner and print it; the older ones are accepted until they are revoked
    Rotate {
        /// Whose it is
        name: String,
    },
    /// Take keys out
    Revoke {
        /// Name of an owner, or fingerprint of a key
        which: String,

        /// Keep the newest of the owner's keys
        #[arg(long)]
        older: bool,
    },
}

/// Edits the file.
#[allow(clippy::print_stdout, clippy::print_stderr)] // keys and lists are the output, hints go to stderr
pub(crate) fn run(args: &KeysArgs) -> Result<(), Failure> {
    let mut file = KeyFile::open(&args.api_keys).map_err(failure)?;
    match &args.action {
        Action::List { json } => {
            list(&file, *json);
            return Ok(());
        }
        Action::Add { name } => println!("{}", saved(&mut file, |file| file.add(name))?),
        Action::Rotate { name } => println!("{}", saved(&mut file, |file| file.rotate(name))?),
        Action::Revoke { which, older } => {
            let count = saved(&mut file, |file| file.revoke(which, *older))?;
            eprintln!("{count} {} revoked", if count == 1 { "key" } else { "keys" });
        }
    }
    eprintln!("a running service reads the file again at SIGHUP: kill -HUP PID, or systemctl reload chladni");
    Ok(())
}

/// What an edit gives, once the file is written.
fn saved<T>(
    file: &mut KeyFile,
    edit: impl FnOnce(&mut KeyFile) -> Result<T, KeyFileError>,
) -> Result<T, Failure> {
    let given = edit(file).map_err(failure)?;
    file.save().map_err(failure)?;
    Ok(given)
}

#[allow(clippy::print_stdout)] // the list is the output
fn list(file: &KeyFile, as_json: bool) {
    let entries = file.entries();
    if as_json {
        let list: Vec<_> = entries
            .iter()
            .map(|entry| json!({ "name": entry.name, "fingerprint": entry.fingerprint }))
            .collect();
        println!("{}", json!(list));
        return;
    }
    for entry in entries {
        println!("{}  {}", entry.fingerprint, entry.name.as_deref().unwrap_or("(no name)"));
    }
}

fn failure(error: KeyFileError) -> Failure {
    match error {
        KeyFileError::Random(_) => Failure::other(error),
        _ => Failure::input(error),
    }
}
