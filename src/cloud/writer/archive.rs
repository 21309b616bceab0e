//! NumPy archives in pieces: all members are complete except the last, which the caller streams.
//!
//! A zip archive of stored members (APPNOTE 6.3), always with the fields of 64 bits. The checksum of the last member
//! stands behind it, so that the length of the archive is known before a byte of it is made.

use flate2::Crc;

use super::{Column, encode_rows};
use crate::cloud::ScalarType;

/// Version of the format that has fields of 64 bits.
const VERSION: u16 = 45;
/// Flag: the checksum follows the bytes.
const CHECKSUM_FOLLOWS: u16 = 1 << 3;
/// The first of January 1980, the least date there is: the same arrays give the same archive.
const DATE: u16 = 1 << 5 | 1;
/// Stands for a number that is found in a field of 64 bits.
const ELSEWHERE: u32 = u32::MAX;
/// Bytes behind the last member: its checksum and lengths, without the directory.
const DESCRIPTOR_BYTES: usize = 24;

/// An archive under construction.
#[derive(Debug, Default)]
pub struct Archive {
    bytes: Vec<u8>,
    directory: Vec<u8>,
    members: u64,
}

/// An archive whose last member lacks its data.
#[derive(Debug)]
pub struct OpenArchive {
    archive: Archive,
    name: String,
    offset: u64,
    data_offset: u64,
    /// Over the header of the last array.
    checksum: Crc,
    header_bytes: u64,
    data_bytes: u64,
}

impl Archive {
    /// Adds an array of these numbers, written in the type `kind`, behind its NumPy header.
    pub fn add(&mut self, name: &str, header: &[u8], values: &[f64], kind: ScalarType) {
        let data = encode_rows(&[Column { values, stride: 1, kind }], values.len());
        let mut checksum = Crc::new();
        checksum.update(header);
        checksum.update(&data);
        let length = (header.len() + data.len()) as u64;
        let offset = self.begin(name, 0, checksum.sum(), length);
        self.bytes.extend_from_slice(header);
        self.bytes.extend_from_slice(&data);
        self.list(name, 0, checksum.sum(), length, offset);
    }

    /// Begins the last array, of which `data_bytes` bytes will follow its header.
    #[must_use]
    pub fn open(mut self, name: &str, header: &[u8], data_bytes: u64) -> OpenArchive {
        let header_bytes = header.len() as u64;
        let offset = self.begin(name, CHECKSUM_FOLLOWS, 0, header_bytes + data_bytes);
        self.bytes.extend_from_slice(header);
        let mut checksum = Crc::new();
        checksum.update(header);
        let data_offset = self.bytes.len() as u64;
        OpenArchive {
            archive: self,
            name: name.to_owned(),
            offset,
            data_offset,
            checksum,
            header_bytes,
            data_bytes,
        }
    }

    /// A member's header [§4.3.7]; returns where it begins.
    fn begin(&mut self, name: &str, flags: u16, checksum: u32, length: u64) -> u64 {
        let offset = self.bytes.len() as u64;
        let out = &mut self.bytes;
        out.extend(b"PK\x03\x04");
        describe(out, flags, checksum);
        out.extend((file_name(name).len() as u16).to_le_bytes());
        out.extend(20_u16.to_le_bytes());
        out.extend(file_name(name).as_bytes());
        wide(out, &[length, length]);
        offset
    }

    /// A member's entry in the directory [§4.3.12].
    fn list(&mut self, name: &str, flags: u16, checksum: u32, length: u64, offset: u64) {
        let out = &mut self.directory;
        out.extend(b"PK\x01\x02");
        out.extend(VERSION.to_le_bytes());
        describe(out, flags, checksum);
        out.extend((file_name(name).len() as u16).to_le_bytes());
        out.extend(28_u16.to_le_bytes());
        // No comment, the first disk, no attributes.
        out.extend([0; 10]);
        out.extend(ELSEWHERE.to_le_bytes());
        out.extend(file_name(name).as_bytes());
        wide(out, &[length, length, offset]);
        self.members += 1;
    }
}

impl OpenArchive {
    /// Takes everything out that stands in front of the last array's data.
    #[must_use]
    pub fn take_head(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.archive.bytes)
    }

    /// Number of bytes behind the last array's data.
    #[must_use]
    pub fn tail_bytes(&self) -> usize {
        let entry = 46 + file_name(&self.name).len() + 28;
        DESCRIPTOR_BYTES + self.archive.directory.len() + entry + 56 + 20 + 22
    }

    /// What stands behind the last array's data, of which `data` is the checksum.
    #[must_use]
    pub fn tail(mut self, data: &Crc) -> Vec<u8> {
        let length = self.header_bytes + self.data_bytes;
        self.checksum.combine(data);
        let checksum = self.checksum.sum();
        let mut out = b"PK\x07\x08".to_vec();
        out.extend(checksum.to_le_bytes());
        out.extend([length, length].into_iter().flat_map(u64::to_le_bytes));
        self.archive.list(&self.name, CHECKSUM_FOLLOWS, checksum, length, self.offset);
        let Archive { directory, members, .. } = self.archive;
        let begin = self.data_offset + self.data_bytes + out.len() as u64;
        out.extend(&directory);
        // The directory's end in 64 bits [§4.3.14], where that is [§4.3.15], and the end that all readers look for.
        out.extend(b"PK\x06\x06");
        out.extend(44_u64.to_le_bytes());
        out.extend([VERSION; 2].into_iter().flat_map(u16::to_le_bytes));
        out.extend([0; 8]);
        out.extend([members, members, directory.len() as u64, begin].into_iter().flat_map(u64::to_le_bytes));
        out.extend(b"PK\x06\x07\0\0\0\0");
        out.extend((begin + directory.len() as u64).to_le_bytes());
        out.extend(1_u32.to_le_bytes());
        out.extend(b"PK\x05\x06\0\0\0\0");
        out.extend([u16::MAX; 2].into_iter().flat_map(u16::to_le_bytes));
        out.extend([ELSEWHERE; 2].into_iter().flat_map(u32::to_le_bytes));
        out.extend([0; 2]);
        out
    }
}

fn file_name(name: &str) -> String {
    format!("{name}.npy")
}

/// Version, flags, no compression, date, checksum, and lengths that stand elsewhere.
fn describe(out: &mut Vec<u8>, flags: u16, checksum: u32) {
    out.extend([VERSION, flags, 0, 0, DATE].into_iter().flat_map(u16::to_le_bytes));
    out.extend([checksum, ELSEWHERE, ELSEWHERE].into_iter().flat_map(u32::to_le_bytes));
}

/// Numbers of 64 bits as an extra field [§4.5.3].
fn wide(out: &mut Vec<u8>, numbers: &[u64]) {
    out.extend(1_u16.to_le_bytes());
    out.extend((8 * numbers.len() as u16).to_le_bytes());
    out.extend(numbers.iter().copied().flat_map(u64::to_le_bytes));
}

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Read};

    use npyz::zip::ZipArchive;

    use super::super::{npy_header, npy_vector_header};
    use super::*;

    #[test]
    fn an_archive_in_pieces_is_one_that_others_read() {
        let kind = ScalarType::Float64;
        let mut archive = Archive::default();
        archive.add("points", &npy_header(2, 2, kind), &[1.0, 2.0, 3.0, 4.0], kind);
        let last = npy_vector_header(3, ScalarType::Uint8);
        let mut open = archive.open("bases", &last, 3);
        let announced = open.tail_bytes();
        let mut bytes = open.take_head();
        let mut checksum = Crc::new();
        for piece in [&b"\x07"[..], b"\x08\x09"] {
            let mut part = Crc::new();
            part.update(piece);
            checksum.combine(&part);
            bytes.extend(piece);
        }
        let tail = open.tail(&checksum);
        assert_eq!(tail.len(), announced);
        bytes.extend(tail);

        let mut zip = ZipArchive::new(Cursor::new(bytes)).unwrap();
        assert_eq!(
            zip.file_names().collect::<std::collections::BTreeSet<_>>(),
            ["bases.npy", "points.npy"].into()
        );
        // Reading to the end compares the checksum.
        let mut member = |name: &str| {
            let mut bytes = Vec::new();
            zip.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
            bytes
        };
        assert_eq!(member("bases.npy"), [last.as_slice(), &[7, 8, 9]].concat());
        let points = npyz::NpyFile::new(Cursor::new(member("points.npy"))).unwrap();
        assert_eq!(points.shape(), [2, 2]);
        assert_eq!(points.into_vec::<f64>().unwrap(), [1.0, 2.0, 3.0, 4.0]);
    }
}
