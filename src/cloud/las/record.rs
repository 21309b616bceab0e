//! Records of variable length, with their heads.

use super::{u16_at, u64_at};

/// Bytes of the head of a record, and of an extended one [table 4, table 32].
pub(in crate::cloud) const RECORD_HEAD: usize = 54;
pub(in crate::cloud) const EXTENDED_HEAD: usize = 60;

/// A record in a file.
#[derive(Debug, Clone, Copy)]
pub(in crate::cloud) struct Record<'a> {
    /// Head and data.
    pub(in crate::cloud) bytes: &'a [u8],
    pub(in crate::cloud) data: &'a [u8],
}

impl<'a> Record<'a> {
    /// The record that begins here, if all of it is there.
    pub(in crate::cloud) fn first(bytes: &'a [u8]) -> Option<Self> {
        let length = usize::from(u16_at(bytes, 20)?);
        Self::cut(bytes, RECORD_HEAD, length)
    }

    /// The same for an extended record, whose length has 64 bits.
    pub(in crate::cloud) fn first_extended(bytes: &'a [u8]) -> Option<Self> {
        Self::cut(bytes, EXTENDED_HEAD, usize::try_from(u64_at(bytes, 20)?).ok()?)
    }

    fn cut(bytes: &'a [u8], head: usize, length: usize) -> Option<Self> {
        let bytes = bytes.get(..head.checked_add(length)?)?;
        Some(Self { bytes, data: &bytes[head..] })
    }

    /// Who defines it.
    pub(in crate::cloud) fn user(&self) -> &'a [u8] {
        let user = self.bytes.get(2..18).unwrap_or_default();
        &user[..user.iter().position(|&byte| byte == 0).unwrap_or(user.len())]
    }

    /// Its number among those of its user.
    pub(in crate::cloud) fn number(&self) -> u16 {
        u16_at(self.bytes, 18).unwrap_or(0)
    }

    /// Whether it is the coordinate reference system as well-known text.
    pub(in crate::cloud) fn is_wkt(&self) -> bool {
        self.user() == b"LASF_Projection" && self.number() == 2112
    }

    /// Whether it describes extra bytes of the points.
    pub(in crate::cloud) fn describes_extra_bytes(&self) -> bool {
        self.user() == b"LASF_Spec" && self.number() == 4
    }
}

/// Whether a record still holds for a file that is written anew: not those of how the points are packed and indexed, nor
/// waveforms, which stand at offsets of the old file.
pub(in crate::cloud) fn is_kept(record: &Record<'_>) -> bool {
    match record.user() {
        b"laszip encoded" | b"copc" | b"LAStools" => false,
        b"LASF_Spec" => record.number() != 65_535,
        _ => true,
    }
}
