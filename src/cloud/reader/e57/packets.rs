//! What the crate `e57` would keep in memory, told from the file before it reads.
//!
//! It parses all of the XML at once, and unpacks every packet whole: a packet that has a value of one attribute and
//! half a million one-bit values of another makes 8 MB of 64 KiB, and a file of such packets 128 times its own size.

use e57::{PointCloud as Scan, RecordDataType};

use super::refuse;
use crate::cloud::reader::ReadError;

/// Bytes of a page, the last four of which are its checksum.
const PAGE: u64 = 1024;
const PAGE_DATA: u64 = 1020;
/// Bytes of XML that every file may have; larger files, a sixteenth of their size.
const DESCRIPTION_MAX: u64 = 4 << 20;
/// Values of an attribute that may be there before the same point's value of another.
const LEAD_MAX: u64 = 1 << 20;

/// Refuses a file whose XML is out of all proportion.
pub(super) fn check_description(bytes: &[u8]) -> Result<(), ReadError> {
    let announced = bytes.get(32..40).and_then(|bytes| bytes.first_chunk()).map(|b| u64::from_le_bytes(*b));
    let accepted = DESCRIPTION_MAX.max(bytes.len() as u64 / 16);
    match announced {
        Some(announced) if announced > accepted => {
            Err(refuse(format!("its description has {announced} bytes; up to {accepted} are accepted")))
        }
        _ => Ok(()),
    }
}

/// Walks along the packets of a scan: all attributes of its points must arrive about together.
pub(super) fn check_streams(bytes: &[u8], scan: &Scan) -> Result<(), ReadError> {
    let widths: Vec<u64> = scan.prototype.iter().map(|record| width(&record.data_type)).collect();
    let packed: Vec<usize> = (0..widths.len()).filter(|&stream| widths[stream] > 0).collect();
    if packed.is_empty() {
        return Ok(());
    }
    let pages = Pages(bytes);
    let section = logical(scan.file_offset);
    let mut at = logical(u64::from_le_bytes(pages.get(section + 16)?));
    let mut bits = vec![0; widths.len()];
    loop {
        let arrived = |stream: &usize| bits[*stream] / widths[*stream];
        let least = packed.iter().map(arrived).min().unwrap_or(0);
        let most = packed.iter().map(arrived).max().unwrap_or(0);
        if most - least > LEAD_MAX {
            let message = format!("after {least} points one attribute has {most} values and another none");
            return Err(refuse(message));
        }
        if least >= scan.records {
            return Ok(());
        }
        let [kind, _, low, high, few, many] = pages.get(at)?;
        if kind == 1 {
            if usize::from(u16::from_le_bytes([few, many])) != widths.len() {
                return Err(refuse("a packet has another number of attributes than the scan"));
            }
            for (stream, bits) in bits.iter_mut().enumerate() {
                *bits += 8 * u64::from(u16::from_le_bytes(pages.get(at + 6 + 2 * stream as u64)?));
            }
        }
        // Packets are a multiple of four bytes long.
        at += (u64::from(u16::from_le_bytes([low, high])) + 1).next_multiple_of(4);
    }
}

/// Bits of a value; 0 for constants, which are not stored.
fn width(data: &RecordDataType) -> u64 {
    match *data {
        RecordDataType::Single { .. } => 32,
        RecordDataType::Double { .. } => 64,
        RecordDataType::ScaledInteger { min, max, .. } | RecordDataType::Integer { min, max } => {
            let range = (i128::from(max) - i128::from(min)).unsigned_abs();
            u64::from(range.checked_ilog2().map_or(0, |highest| highest + 1))
        }
    }
}

/// An offset without the checksums before it.
fn logical(physical: u64) -> u64 {
    physical - physical / PAGE * (PAGE - PAGE_DATA)
}

/// The file without its checksums.
struct Pages<'a>(&'a [u8]);

impl Pages<'_> {
    fn get<const N: usize>(&self, at: u64) -> Result<[u8; N], ReadError> {
        let mut out = [0; N];
        for (offset, out) in out.iter_mut().enumerate() {
            let at = at.saturating_add(offset as u64);
            let physical = (at / PAGE_DATA).saturating_mul(PAGE).saturating_add(at % PAGE_DATA);
            let byte = usize::try_from(physical).ok().and_then(|at| self.0.get(at));
            *out = *byte.ok_or_else(|| refuse("the file ends before all points of the scan"))?;
        }
        Ok(out)
    }
}
