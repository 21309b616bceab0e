//! Files in gzip, and in zip when it holds one: unpacked as far as any packed file may be.

use std::borrow::Cow;
use std::io::{Cursor, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;
use npyz::zip::ZipArchive;

use super::{Format, Location, ReadError, unpacked_max};

/// Entries of an archive that are looked at.
const ENTRIES_MAX: usize = 4096;

/// What a file is packed in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Container {
    Gzip,
    Zip,
}

impl Container {
    /// By the first bytes.
    pub(super) fn of(bytes: &[u8]) -> Option<Self> {
        if bytes.starts_with(b"\x1F\x8B\x08") {
            return Some(Self::Gzip);
        }
        (bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06")).then_some(Self::Zip)
    }
}

/// Whether an entry is an array of NumPy: archives of arrays are read as they are.
fn is_array(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npy"))
}

/// Unpacks gzip, and zip of one file; what is in neither, and archives of arrays, as they are.
pub(super) fn unpacked(bytes: &[u8], format: Format) -> Result<Cow<'_, [u8]>, ReadError> {
    match Container::of(bytes) {
        Some(Container::Gzip) => Ok(Cow::Owned(all_of(MultiGzDecoder::new(bytes), bytes.len(), format)?)),
        Some(Container::Zip) => {
            let mut archive = open(bytes, format)?;
            let entries = entries(&mut archive, format)?;
            if entries.iter().all(|(_, name)| is_array(name)) {
                return Ok(Cow::Borrowed(bytes));
            }
            let [(index, _)] = entries.as_slice() else {
                let message = format!(
                    "the zip archive holds {} files; send one, or an archive that holds one",
                    entries.len()
                );
                return Err(ReadError::byte(format, 0, message));
            };
            Ok(Cow::Owned(member(&mut archive, *index, bytes.len(), format)?))
        }
        None => Ok(Cow::Borrowed(bytes)),
    }
}

/// Opens an archive.
pub(super) fn open(bytes: &[u8], format: Format) -> Result<ZipArchive<Cursor<&[u8]>>, ReadError> {
    let archive = super::guarded(format, || {
        ZipArchive::new(Cursor::new(bytes)).map_err(|error| {
            let message = format!("the zip archive cannot be read: {error}");
            ReadError::byte(format, 0, message)
        })
    })?;
    if archive.len() > ENTRIES_MAX {
        let message =
            format!("the zip archive has {} entries; up to {ENTRIES_MAX} are accepted", archive.len());
        return Err(ReadError::byte(format, 0, message));
    }
    Ok(archive)
}

/// Places and names of the files of an archive, without folders and what macOS puts beside them.
pub(super) fn entries(
    archive: &mut ZipArchive<Cursor<&[u8]>>,
    format: Format,
) -> Result<Vec<(usize, String)>, ReadError> {
    let mut entries = Vec::new();
    for index in 0..archive.len() {
        let entry = archive.by_index_raw(index).map_err(|error| {
            ReadError::byte(format, 0, format!("entry {index} of the zip archive cannot be read: {error}"))
        })?;
        let name = entry.name().to_owned();
        let is_hidden =
            name.starts_with("__MACOSX/") || name.rsplit('/').next().is_some_and(|n| n.starts_with('.'));
        if entry.is_file() && !is_hidden {
            entries.push((index, name));
        }
    }
    Ok(entries)
}

/// A file of an archive of `packed` bytes.
pub(super) fn member(
    archive: &mut ZipArchive<Cursor<&[u8]>>,
    index: usize,
    packed: usize,
    format: Format,
) -> Result<Vec<u8>, ReadError> {
    let entry = archive.by_index(index).map_err(|error| {
        ReadError::byte(format, 0, format!("entry {index} of the zip archive cannot be read: {error}"))
    })?;
    all_of(entry, packed, format)
}

/// Everything that a decoder gives, if that is not too much.
fn all_of(decoder: impl Read, packed: usize, format: Format) -> Result<Vec<u8>, ReadError> {
    let most = unpacked_max(packed);
    let mut inner = Vec::new();
    decoder.take(most as u64 + 1).read_to_end(&mut inner).map_err(|error| ReadError::Truncated {
        format,
        location: Location::Byte(packed),
        message: format!("the file does not unpack: {error}"),
    })?;
    if inner.len() > most {
        return Err(ReadError::TooCompressed { format, packed, unpacked: inner.len() });
    }
    Ok(inner)
}

/// Bytes that a file in gzip or zip unpacks to, up to what is accepted.
pub(super) fn unpacked_len(bytes: &[u8]) -> Option<usize> {
    let most = unpacked_max(bytes.len()) as u64;
    let count = |decoder: &mut dyn Read| {
        // What does not unpack is refused by the reader.
        std::io::copy(&mut decoder.take(most), &mut std::io::sink()).unwrap_or(most) as usize
    };
    match Container::of(bytes)? {
        Container::Gzip => Some(count(&mut MultiGzDecoder::new(bytes))),
        Container::Zip => {
            let mut archive = open(bytes, Format::Npy).ok()?;
            let sizes = (0..archive.len()).filter_map(|index| Some(archive.by_index_raw(index).ok()?.size()));
            Some(sizes.fold(0, u64::saturating_add).min(most) as usize)
        }
    }
}

/// The first bytes of the packed file and its name, from which its format follows. `None` when it does not unpack.
pub(super) fn head(bytes: &[u8], most: usize) -> Option<(Vec<u8>, Option<String>)> {
    let mut head = Vec::new();
    match Container::of(bytes)? {
        Container::Gzip => {
            // What is cut off or damaged further on is found by the reader.
            let _ = MultiGzDecoder::new(bytes).take(most as u64).read_to_end(&mut head);
            Some((head, None))
        }
        Container::Zip => {
            let mut archive = open(bytes, Format::Npy).ok()?;
            let entries = entries(&mut archive, Format::Npy).ok()?;
            let (index, name) = entries.first()?;
            // Of several files, or of one that does not unpack, the reader tells.
            if let Ok(entry) = archive.by_index(*index) {
                let _ = entry.take(most as u64).read_to_end(&mut head);
            }
            Some((head, Some(name.clone())))
        }
    }
}
