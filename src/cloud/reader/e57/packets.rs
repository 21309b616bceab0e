//! What the crate `e57` would keep in memory, told from the file before it reads.
//!
//! It parses all of the XML at once: 72 bytes of memory for every `<` and every `=`, and a comparison of every attribute of
//! an element with every other. It unpacks every packet whole: a packet that has a value of one attribute and half a
//! million one-bit values of another makes 8 MB of 64 KiB, and a file of such packets 128 times its own size. And of an
//! attribute that is constant, and so not stored, it makes as many values as others have: without others, for ever.

use e57::{PointCloud as Scan, RecordDataType};

use super::refuse;
use crate::cloud::reader::ReadError;

/// Bytes of a page, the last four of which are its checksum.
const PAGE: u64 = 1024;
const PAGE_DATA: u64 = 1020;
/// Bytes of XML that every file may have, some hundred scans; larger files, a thirty-second of their size.
const DESCRIPTION_MAX: u64 = 768 << 10;
/// Attributes of an element of the XML; the standard's have ten at most.
const XML_ATTRIBUTES_MAX: usize = 1000;
/// Values that may wait at once, of all attributes together, for their points to be complete or taken.
const QUEUED_MAX: u64 = 1 << 20;
/// Bytes that a waiting value takes at most: it has sixteen, in queues that grow by doubling.
const QUEUED_BYTES: usize = 48;

/// Refuses a file whose XML is out of all proportion.
pub(super) fn check_description(bytes: &[u8]) -> Result<(), ReadError> {
    let number = |at: usize| {
        let bytes = bytes.get(at..at + 8).and_then(|bytes| bytes.first_chunk());
        bytes.map(|bytes| u64::from_le_bytes(*bytes))
    };
    // A file without a whole header is refused by the crate.
    let (Some(begin), Some(announced)) = (number(24), number(32)) else { return Ok(()) };
    let accepted = DESCRIPTION_MAX.max(bytes.len() as u64 / 32);
    if announced > accepted {
        return Err(refuse(format!("its description has {announced} bytes; up to {accepted} are accepted")));
    }
    // Quoted values may have a `>` in them, but no `<`: an element does not end before one.
    let mut attributes = 0;
    for byte in Pages(bytes).from(logical(begin)).take(announced as usize) {
        match byte {
            b'<' => attributes = 0,
            b'=' => attributes += 1,
            _ => {}
        }
        if attributes > XML_ATTRIBUTES_MAX {
            let message =
                format!("an element of its description has more than {XML_ATTRIBUTES_MAX} attributes");
            return Err(refuse(message));
        }
    }
    Ok(())
}

/// Walks along the packets of a scan: some attribute must be stored, and all of a point must arrive about together.
/// Returns how many bytes of memory their values take at most before they are taken.
pub(super) fn check_streams(bytes: &[u8], scan: &Scan) -> Result<usize, ReadError> {
    let widths: Vec<u64> = scan.prototype.iter().map(|record| width(&record.data_type)).collect();
    let packed: Vec<usize> = (0..widths.len()).filter(|&stream| widths[stream] > 0).collect();
    if packed.is_empty() {
        return Err(refuse("all attributes of its points are constants"));
    }
    let pages = Pages(bytes);
    let section = logical(scan.file_offset);
    let mut at = logical(u64::from_le_bytes(pages.get(section + 16)?));
    let constants = (widths.len() - packed.len()) as u64;
    let mut bits = vec![0; widths.len()];
    let mut queued_max = 0;
    // Points that are complete, and so taken before the next packet is read.
    let mut taken = 0;
    loop {
        let arrived = |stream: &usize| bits[*stream] / widths[*stream];
        let complete = packed.iter().map(arrived).min().unwrap_or(0);
        let queued =
            packed.iter().map(|stream| arrived(stream) - taken).sum::<u64>() + constants * (complete - taken);
        if queued > QUEUED_MAX {
            let message =
                format!("after {taken} points {queued} values wait; up to {QUEUED_MAX} are accepted");
            return Err(refuse(message));
        }
        queued_max = queued_max.max(queued);
        taken = complete;
        if complete >= scan.records {
            return Ok(queued_max as usize * QUEUED_BYTES);
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

impl<'a> Pages<'a> {
    /// All bytes from `at` on.
    fn from(&self, at: u64) -> impl Iterator<Item = u8> + use<'a> {
        let place = |number: u64| usize::try_from(number).unwrap_or(usize::MAX);
        let pages = self.0.chunks(PAGE as usize).skip(place(at / PAGE_DATA));
        let data = pages.flat_map(|page| &page[..page.len().min(PAGE_DATA as usize)]);
        data.skip(place(at % PAGE_DATA)).copied()
    }

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
