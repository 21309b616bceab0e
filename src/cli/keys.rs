//! `chladni keys`: the file of API keys.

use std::path::PathBuf;

use chladni::app::{KeyFile, KeyFileError};
use serde_json::json;

use super::Failure;
use super::reporting::{note, print};

/// Keep the file of API keys: add, list, rotate, rename, revoke.
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
    /// Give the keys of an owner another name; the service gives what the owner had to that name
    Rename {
        /// Whose they are, or were if the name was changed in the file
        old: String,
        /// Whose they are to be
        new: String,
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
pub(crate) fn run(args: &KeysArgs) -> Result<(), Failure> {
    let mut file = KeyFile::open(&args.api_keys).map_err(failure)?;
    match &args.action {
        Action::List { json } => {
            return list(&file, *json);
        }
        // A key that was not seen must not be valid: it is printed before the file is written.
        Action::Add { name } => print(file.add(name).map_err(failure)?)?,
        Action::Rotate { name } => print(file.rotate(name).map_err(failure)?)?,
        Action::Rename { old, new } => {
            let count = file.rename(old, new).map_err(failure)?;
            note(format_args!("{count} {} renamed; {new} gets what {old} had", keys(count)));
        }
        Action::Revoke { which, older } => {
            let count = file.revoke(which, *older).map_err(failure)?;
            note(format_args!("{count} {} revoked", keys(count)));
        }
    }
    file.save().map_err(failure)?;
    note("a running service reads the file again at SIGHUP: kill -HUP PID, or systemctl reload chladni");
    Ok(())
}

fn keys(count: usize) -> &'static str {
    if count == 1 { "key" } else { "keys" }
}

fn list(file: &KeyFile, as_json: bool) -> Result<(), Failure> {
    let entries = file.entries();
    if as_json {
        let list: Vec<_> = entries
            .iter()
            .map(|entry| json!({ "name": entry.name, "fingerprint": entry.fingerprint }))
            .collect();
        return print(json!(list));
    }
    for entry in entries {
        print(format_args!("{}  {}", entry.fingerprint, entry.name.as_deref().unwrap_or("(no name)")))?;
    }
    Ok(())
}

fn failure(error: KeyFileError) -> Failure {
    match error {
        KeyFileError::Random(_) => Failure::other(error),
        _ => Failure::input(error),
    }
}
