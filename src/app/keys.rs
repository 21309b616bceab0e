//! The service's API keys: read at the start and at SIGHUP; logs unsafe keys and permissions.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use super::{Settings, StartError};
use crate::http::Keys;
use crate::store::{Owner, Store, StoreError};

/// Bits of a file's mode that let others than its owner and group read it, or others than its owner write it.
const LOOSE: u32 = 0o027;
/// Names that a line of the log holds, at most.
const NAMES_TOLD: usize = 10;

/// The keys of the settings; `None` when none are asked for.
pub(super) fn read(settings: &Settings) -> Result<Option<Keys>, StartError> {
    if settings.api_keys.is_none() && settings.keys.is_none() {
        return Ok(None);
    }
    let mut text = String::new();
    if let Some(path) = &settings.api_keys {
        let unreadable = |cause| StartError::KeyFile { path: path.clone(), cause };
        text = std::fs::read_to_string(path).map_err(unreadable)?;
        warn_of_mode(path);
    }
    if let Some(more) = &settings.keys {
        text.push('\n');
        text.push_str(more.reveal());
    }
    let keys = Keys::parse(&text)?;
    for entry in keys.short() {
        tracing::warn!(
            entry,
            "an API key is short enough to be guessed; `chladni keys add NAME` makes a long one"
        );
    }
    Ok(Some(keys))
}

/// Gives what keys had before they were named, or under another name, to their names.
pub(super) async fn adopt(keys: &Keys, store: &Store) -> Result<(), StoreError> {
    for (before, now) in keys.adoptions() {
        let changed = store.adopt(&before, &now).await?;
        if changed > 0 {
            tracing::info!(
                owner = now.name(),
                before = before.name(),
                records = changed,
                "a key's name adopted what the key had without it, or under another name"
            );
        }
    }
    Ok(())
}

/// Says whose clouds and jobs nobody can reach: a name that was changed in the file is another owner.
pub(super) async fn warn_of_unreachable(keys: &Keys, store: &Store) -> Result<(), StoreError> {
    let owners = store.owners().await?;
    let unreachable: Vec<&str> = owners
        .iter()
        .filter(|owner| !keys.has(owner))
        .map(|owner| if *owner == Owner::nobody() { "(stored without keys)" } else { owner.name() })
        .collect();
    if unreachable.is_empty() {
        return Ok(());
    }
    let more = unreachable.len().saturating_sub(NAMES_TOLD);
    let names = unreachable[..unreachable.len() - more].join(", ");
    let names = if more == 0 { names } else { format!("{names} and {more} more") };
    tracing::warn!(
        owners = names,
        "clouds and jobs of these names are out of reach, for no key has such a name; `chladni keys rename OLD NEW` gives \
         what OLD had to the keys of NEW; what was stored without keys is seen without keys only"
    );
    Ok(())
}

fn warn_of_mode(path: &Path) {
    let mode = std::fs::metadata(path).map_or(0, |metadata| metadata.permissions().mode());
    if mode & LOOSE != 0 {
        let mode = format!("{:o}", mode & 0o777);
        tracing::warn!(
            mode,
            "other users can read or change the file of API keys; `chmod 600` keeps them out"
        );
    }
}
