//! The service's API keys: read at the start and at SIGHUP; logs unsafe keys and permissions.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use super::{Settings, StartError};
use crate::http::Keys;
use crate::store::{Store, StoreError};

/// Bits of a file's mode that let others than its owner and group read it, or others than its owner write it.
const LOOSE: u32 = 0o027;

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

/// Gives what keys had before they were named to their names.
pub(super) async fn adopt(keys: &Keys, store: &Store) -> Result<(), StoreError> {
    for (unnamed, named) in keys.adoptions() {
        let changed = store.adopt(&unnamed, &named).await?;
        if changed > 0 {
            tracing::info!(
                owner = named.name(),
                records = changed,
                "a key's name adopted what the key had without it"
            );
        }
    }
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
