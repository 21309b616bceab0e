//! The file of API keys, edited: keys added and revoked by the names of their owners, names changed. Comments and order are kept.

use std::fmt::Write as _;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, fchown};
use std::path::{Path, PathBuf};

use rand::TryRngCore;
use rand::rngs::OsRng;
use sha2::{Digest, Sha256};

use crate::http::WAS;

/// Random bytes of a key.
const KEY_BYTES: usize = 32;
/// Characters of a fingerprint.
const FINGERPRINT_LENGTH: usize = 8;
/// Whom the file is for: its owner.
const MODE: u32 = 0o600;

/// Why a key file cannot be edited so.
#[derive(Debug, thiserror::Error)]
pub enum KeyFileError {
    /// The file cannot be read or written.
    #[error("{path}: {cause}")]
    File {
        /// The file.
        path: String,
        /// What the system says.
        cause: io::Error,
    },
    /// The system has no random numbers.
    #[error("cannot make a key: {0}")]
    Random(String),
    /// A name that would be read as something else.
    #[error("`{0}` is not a name for keys; use one without spaces and commas that does not begin with #")]
    Name(String),
    /// The owner has a key.
    #[error("`{0}` has a key; `chladni keys rotate {0}` adds another one")]
    Known(String),
    /// Both names of a renaming have keys.
    #[error(
        "`{0}` has keys of its own, and would have everything of both; choose another name, or revoke them first"
    )]
    Both(String),
    /// Neither a name nor a fingerprint of a key in the file.
    #[error("there is no key of `{0}`; `chladni keys list` shows names and fingerprints")]
    Unknown(String),
    /// Without a key the service would not start.
    #[error("these are the last keys: the service does not start with an empty file; add another key first")]
    Last,
}

/// A key as it may be shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeyEntry {
    /// Whose it is; `None` for a key without a name.
    pub name: Option<String>,
    /// The beginning of the key's SHA-256, in hexadecimal.
    pub fingerprint: String,
}

/// A line of the file: what cannot hold a key, as it is, or entries between commas.
enum Line {
    Other(String),
    Keys(Vec<String>),
}

/// A key file in memory.
pub struct KeyFile {
    path: PathBuf,
    lines: Vec<Line>,
}

impl KeyFile {
    /// Reads the file; one that is not there is empty.
    ///
    /// # Errors
    /// [`KeyFileError::File`].
    pub fn open(path: &Path) -> Result<Self, KeyFileError> {
        // A link stays a link: what it leads to is edited.
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let text = match fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            read => read.map_err(|cause| of_file(&path, cause))?,
        };
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        Ok(Self { path, lines: text.lines().map(line).collect() })
    }

    /// The keys in their order.
    #[must_use]
    pub fn entries(&self) -> Vec<KeyEntry> {
        self.keys().map(entry).collect()
    }

    /// Makes a key for a new owner, and gives it.
    ///
    /// # Errors
    /// [`KeyFileError::Name`], [`KeyFileError::Known`], [`KeyFileError::Random`].
    pub fn add(&mut self, name: &str) -> Result<String, KeyFileError> {
        check_name(name)?;
        if self.has(name) {
            return Err(KeyFileError::Known(name.to_owned()));
        }
        // What the name will have is its own from now on.
        self.drop_former(name);
        self.append(name)
    }

    /// Changes the name of an owner, and notes that what the former name has is the new one's. A name that was changed by
    /// hand may be noted so afterwards. Tells how many keys have another name now.
    ///
    /// # Errors
    /// [`KeyFileError::Name`], [`KeyFileError::Unknown`], [`KeyFileError::Both`].
    pub fn rename(&mut self, before: &str, now: &str) -> Result<usize, KeyFileError> {
        check_name(before)?;
        check_name(now)?;
        match (self.has(before), self.has(now)) {
            (true, true) => return Err(KeyFileError::Both(now.to_owned())),
            (false, false) => return Err(KeyFileError::Unknown(before.to_owned())),
            _ => {}
        }
        let mut count = 0;
        for key in self.lines.iter_mut().flat_map(Line::entries) {
            match key.split_once(char::is_whitespace) {
                Some((name, rest)) if name == before => {
                    count += usize::from(is_key(key));
                    *key = format!("{now} {}", rest.trim_start());
                }
                _ => {}
            }
        }
        self.drop_former(now);
        self.drop_former(before);
        self.lines.push(Line::Keys(vec![format!("{now} {WAS} {before}")]));
        Ok(count)
    }

    /// Makes another key for an owner; those of before stay.
    ///
    /// # Errors
    /// [`KeyFileError::Unknown`], [`KeyFileError::Random`].
    pub fn rotate(&mut self, name: &str) -> Result<String, KeyFileError> {
        if self.has(name) { self.append(name) } else { Err(KeyFileError::Unknown(name.to_owned())) }
    }

    /// Takes the keys of a name out, or the one with a fingerprint; of a name's keys all but the last one if
    /// `keeps_newest`. Tells how many went.
    ///
    /// # Errors
    /// [`KeyFileError::Unknown`], [`KeyFileError::Last`].
    pub fn revoke(&mut self, which: &str, keeps_newest: bool) -> Result<usize, KeyFileError> {
        let is_meant = |key: &str| {
            let entry = entry(key);
            entry.name.as_deref() == Some(which) || entry.fingerprint == which
        };
        let mut meant: Vec<usize> =
            self.keys().enumerate().filter(|(_, key)| is_meant(key)).map(|(place, _)| place).collect();
        if meant.is_empty() {
            return Err(KeyFileError::Unknown(which.to_owned()));
        }
        if keeps_newest {
            meant.pop();
        }
        if meant.len() == self.keys().count() {
            return Err(KeyFileError::Last);
        }
        let mut place = 0;
        self.keep(|key| {
            place += usize::from(is_key(key));
            !is_key(key) || !meant.contains(&(place - 1))
        });
        Ok(meant.len())
    }

    /// Writes the file, readable by its owner only. It is whole at every moment, and belongs to whom it belonged.
    ///
    /// # Errors
    /// [`KeyFileError::File`].
    pub fn save(&self) -> Result<(), KeyFileError> {
        let mut name = self.path.as_os_str().to_owned();
        name.push(format!(".{}", std::process::id()));
        let temporary = PathBuf::from(name);
        let written = self.write(&temporary).and_then(|()| fs::rename(&temporary, &self.path));
        written.map_err(|cause| {
            // The first error is the one to report.
            let _ = fs::remove_file(&temporary);
            of_file(&self.path, cause)
        })
    }

    fn write(&self, path: &Path) -> io::Result<()> {
        let mut file: File = OpenOptions::new().write(true).create_new(true).mode(MODE).open(path)?;
        if let Ok(before) = fs::metadata(&self.path) {
            fchown(&file, Some(before.uid()), Some(before.gid()))?;
        }
        for line in &self.lines {
            match line {
                Line::Other(text) => writeln!(file, "{text}")?,
                Line::Keys(keys) => writeln!(file, "{}", keys.join(", "))?,
            }
        }
        file.sync_all()
    }

    fn keys(&self) -> impl Iterator<Item = &str> {
        let lines = self.lines.iter().filter_map(|line| match line {
            Line::Keys(keys) => Some(keys),
            Line::Other(_) => None,
        });
        lines.flatten().map(String::as_str).filter(|entry| is_key(entry))
    }

    /// Drops all entries but those that `is_kept` keeps.
    fn keep(&mut self, mut is_kept: impl FnMut(&str) -> bool) {
        self.lines.iter_mut().for_each(|line| match line {
            Line::Keys(entries) => entries.retain(|entry| is_kept(entry)),
            Line::Other(_) => {}
        });
        self.lines.retain(|line| !matches!(line, Line::Keys(entries) if entries.is_empty()));
    }

    /// No other name gets what this one has.
    fn drop_former(&mut self, name: &str) {
        self.keep(|entry| former(entry) != Some(name));
    }

    fn has(&self, name: &str) -> bool {
        self.keys().any(|key| entry(key).name.as_deref() == Some(name))
    }

    fn append(&mut self, name: &str) -> Result<String, KeyFileError> {
        let mut bytes = [0; KEY_BYTES];
        OsRng.try_fill_bytes(&mut bytes).map_err(|error| KeyFileError::Random(error.to_string()))?;
        let key = hexadecimal(&bytes);
        self.lines.push(Line::Keys(vec![format!("{name} {key}")]));
        Ok(key)
    }
}

impl Line {
    fn entries(&mut self) -> &mut [String] {
        match self {
            Self::Other(_) => &mut [],
            Self::Keys(entries) => entries,
        }
    }
}

/// # Errors
/// [`KeyFileError::Name`].
fn check_name(name: &str) -> Result<(), KeyFileError> {
    let is_plain = |c: char| !c.is_whitespace() && !c.is_control() && c != ',';
    if name.is_empty() || name.starts_with(['#', '\u{feff}']) || !name.chars().all(is_plain) {
        return Err(KeyFileError::Name(name.to_owned()));
    }
    Ok(())
}

/// The name that another one has taken the place of, in an entry that says so.
fn former(entry: &str) -> Option<&str> {
    match entry.split_whitespace().collect::<Vec<_>>()[..] {
        [_, WAS, before] => Some(before),
        _ => None,
    }
}

/// Whether an entry holds a key.
fn is_key(entry: &str) -> bool {
    former(entry).is_none()
}

fn line(text: &str) -> Line {
    let keys: Vec<String> =
        text.split(',').map(str::trim).filter(|entry| !entry.is_empty()).map(str::to_owned).collect();
    if keys.is_empty() || text.trim_start().starts_with('#') {
        Line::Other(text.to_owned())
    } else {
        Line::Keys(keys)
    }
}

fn entry(key: &str) -> KeyEntry {
    let (name, key) = match key.split_once(char::is_whitespace) {
        Some((name, key)) => (Some(name.to_owned()), key.trim()),
        None => (None, key),
    };
    let digest = hexadecimal(&Sha256::digest(key.as_bytes()));
    KeyEntry { name, fingerprint: digest[..FINGERPRINT_LENGTH].to_owned() }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a String does not fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn of_file(path: &Path, cause: io::Error) -> KeyFileError {
    KeyFileError::File { path: path.display().to_string(), cause }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    fn edited(text: &str, edit: impl FnOnce(&mut KeyFile)) -> (String, u32) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        fs::write(&path, text).unwrap();
        let mut file = KeyFile::open(&path).unwrap();
        edit(&mut file);
        file.save().unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside it");
        (fs::read_to_string(&path).unwrap(), fs::metadata(&path).unwrap().permissions().mode() & 0o777)
    }

    #[test]
    fn comments_and_other_keys_are_kept() {
        let text = "# pipeline\nlab one, lab two\n\n  # of the viewer\nthree\nviewer four\n";
        let (after, mode) = edited(text, |file| assert_eq!(file.revoke("lab", true).unwrap(), 1));
        assert_eq!(after, "# pipeline\nlab two\n\n  # of the viewer\nthree\nviewer four\n");
        assert_eq!(mode, 0o600, "whatever it was before");
        let (after, _) = edited(text, |file| assert_eq!(file.revoke("lab", false).unwrap(), 2));
        assert_eq!(after, "# pipeline\n\n  # of the viewer\nthree\nviewer four\n");
    }

    #[test]
    fn a_new_key_is_long_and_is_its_owners_newest() {
        let mut made = (String::new(), String::new());
        let (after, _) = edited("\u{feff}old-key\r\n", |file| {
            made = (file.add("lab").unwrap(), file.rotate("lab").unwrap());
            assert!(matches!(file.add("lab"), Err(KeyFileError::Known(_))));
            assert!(matches!(file.rotate("other"), Err(KeyFileError::Unknown(_))));
        });
        assert_eq!(after, format!("old-key\nlab {}\nlab {}\n", made.0, made.1));
        assert!(made.0.len() == 64 && made.0 != made.1);
    }

    #[test]
    fn a_key_without_a_name_is_known_by_its_fingerprint() {
        // printf %s old-key | sha256sum
        let fingerprint = "762c08fc";
        let (after, _) = edited("old-key\nlab new-key\n", |file| {
            let entries = file.entries();
            assert_eq!(entries[0], KeyEntry { name: None, fingerprint: fingerprint.to_owned() });
            assert_eq!(entries[1].name.as_deref(), Some("lab"));
            file.revoke(fingerprint, false).unwrap();
            assert!(matches!(file.revoke("lab", false), Err(KeyFileError::Last)));
        });
        assert_eq!(after, "lab new-key\n");
    }

    #[test]
    fn a_renamed_owner_keeps_its_keys_and_is_known_under_its_former_name() {
        let text = "# pipeline\nlab one, lab two\nviewer three\n";
        let (after, _) = edited(text, |file| {
            assert_eq!(file.rename("lab", "laboratory").unwrap(), 2);
            assert!(matches!(file.rename("lab", "attic"), Err(KeyFileError::Unknown(_))));
            assert!(matches!(file.rename("viewer", "laboratory"), Err(KeyFileError::Both(_))));
            assert!(matches!(file.rename("viewer", "two words"), Err(KeyFileError::Name(_))));
            let names: Vec<_> = file.entries().into_iter().map(|entry| entry.name.unwrap()).collect();
            assert_eq!(names, ["laboratory", "laboratory", "viewer"], "the note is no key");
        });
        let renamed = "# pipeline\nlaboratory one, laboratory two\nviewer three\nlaboratory was lab\n";
        assert_eq!(after, renamed);
        // once more, back, and of a name that was changed by hand
        let (after, _) = edited(renamed, |file| assert_eq!(file.rename("laboratory", "attic").unwrap(), 2));
        let twice = "# pipeline\nattic one, attic two\nviewer three\nattic was lab\nattic was laboratory\n";
        assert_eq!(after, twice);
        let (after, _) = edited(renamed, |file| assert_eq!(file.rename("laboratory", "lab").unwrap(), 2));
        assert_eq!(after, "# pipeline\nlab one, lab two\nviewer three\nlab was laboratory\n");
        let (after, _) = edited("lab one\n", |file| assert_eq!(file.rename("laboratory", "lab").unwrap(), 0));
        assert_eq!(after, "lab one\nlab was laboratory\n");
        for text in [renamed, twice] {
            assert!(crate::http::Keys::parse(text).is_ok(), "the service reads it");
        }
    }

    #[test]
    fn a_new_owner_of_a_former_name_keeps_what_it_will_have() {
        let (after, _) = edited("lab one\nlab was attic\n", |file| {
            assert_eq!(file.revoke("lab", true).unwrap(), 0);
            file.add("attic").unwrap();
            assert!(matches!(file.revoke("was", false), Err(KeyFileError::Unknown(_))));
        });
        assert!(after.starts_with("lab one\nattic ") && after.lines().count() == 2, "{after}");
    }

    #[test]
    fn a_name_that_would_be_read_as_something_else_is_refused() {
        let mut file = KeyFile { path: PathBuf::from("keys"), lines: Vec::new() };
        for name in ["", "two words", "a,b", "#lab", "a\nb"] {
            assert!(matches!(file.add(name), Err(KeyFileError::Name(_))), "{name}");
        }
    }
}
