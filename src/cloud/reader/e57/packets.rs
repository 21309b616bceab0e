//! Pages and packets of a file: checksums are held against the bytes, packets cut out of pages.
//!
//! The crate `e57` reads the description. It parses all of the XML at once: 72 bytes of memory for every `<` and every `=`,
//! and a comparison of every attribute of an element with every other; so the XML is held against the file first. Points
//! are unpacked here: the crate makes a vector of values for every point, and reads a third of what libE57 does.

use super::refuse;
use crate::cloud::reader::ReadError;

/// Bytes of a page, the last four of which are its checksum.
const PAGE: usize = 1024;
const PAGE_DATA: usize = 1020;
/// Bytes of XML that every file may have, some hundred scans; larger files, a thirty-second of their size.
const DESCRIPTION_MAX: u64 = 768 << 10;
/// Attributes of an element of the XML; the standard's have ten at most.
const XML_ATTRIBUTES_MAX: usize = 1000;

/// Refuses a file whose XML is out of all proportion.
pub(super) fn check_description(bytes: &[u8]) -> Result<(), ReadError> {
    let number = |at: usize| {
        let bytes = bytes.get(at..at + 8).and_then(|bytes| bytes.first_chunk());
        bytes.map(|bytes| u64::from_le_bytes(*bytes))
    };
    // A file without a whole header is refused by the crate.
    let (Some(begin), Some(announced), Some(page)) = (number(24), number(32), number(40)) else {
        return Ok(());
    };
    if page != PAGE as u64 {
        return Err(refuse(format!(
            "its pages have {page} bytes; {PAGE} are accepted, as the standard has them"
        )));
    }
    let accepted = DESCRIPTION_MAX.max(bytes.len() as u64 / 32);
    if announced > accepted {
        return Err(refuse(format!("its description has {announced} bytes; up to {accepted} are accepted")));
    }
    // Quoted values may have a `>` in them, but no `<`: an element does not end before one.
    let mut attributes = 0;
    let place = logical(begin);
    let pages = bytes.chunks(PAGE).skip(place / PAGE_DATA);
    let data = pages.flat_map(|page| &page[..page.len().min(PAGE_DATA)]).skip(place % PAGE_DATA);
    for byte in data.take(announced as usize) {
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

/// An offset without the checksums before it.
fn logical(physical: u64) -> usize {
    let physical = usize::try_from(physical).unwrap_or(usize::MAX);
    physical - physical / PAGE * (PAGE - PAGE_DATA)
}

/// The data of a file, page by page, each held against its checksum when it is reached.
struct Pages<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Pages from the first that is known to be whole to the last.
    checked: std::ops::Range<usize>,
}

impl Pages<'_> {
    fn take(&mut self, count: usize, out: &mut Vec<u8>) -> Result<(), ReadError> {
        let mut left = count;
        while left > 0 {
            let page = self.at / PAGE_DATA;
            let bytes = self.bytes.get(page * PAGE..(page + 1) * PAGE);
            let bytes = bytes.ok_or_else(|| refuse("the file ends before all points of the scan"))?;
            let (data, checksum) = bytes.split_at(PAGE_DATA);
            if !self.checked.contains(&page) {
                // Big-endian, unlike all other numbers of the format.
                if checksum != crc32c::crc32c(data).to_be_bytes() {
                    return Err(refuse(format!("page {page} is damaged: its checksum does not match")));
                }
                self.checked = page..page + 1;
            }
            let start = self.at % PAGE_DATA;
            let length = left.min(PAGE_DATA - start);
            out.extend_from_slice(&data[start..start + length]);
            self.at += length;
            left -= length;
        }
        Ok(())
    }
}

/// The data packets of a scan, one after another.
pub(super) struct Packets<'a> {
    pages: Pages<'a>,
    packet: Vec<u8>,
    streams: usize,
}

impl<'a> Packets<'a> {
    /// Of the scan whose binary section begins at an offset of the file; every packet has `streams` streams.
    pub(super) fn of(bytes: &'a [u8], section: u64, streams: usize) -> Result<Self, ReadError> {
        let mut pages = Pages { bytes, at: logical(section), checked: 0..0 };
        let mut head = Vec::with_capacity(32);
        pages.take(32, &mut head)?;
        let first = head[16..24].first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        pages.at = logical(first);
        Ok(Self { pages, packet: Vec::with_capacity(1 << 16), streams })
    }

    /// Hands the bytes of every stream of the next data packet to `each`.
    pub(super) fn next(&mut self, mut each: impl FnMut(usize, &[u8])) -> Result<(), ReadError> {
        loop {
            self.packet.clear();
            self.pages.take(4, &mut self.packet)?;
            let length = usize::from(u16::from_le_bytes([self.packet[2], self.packet[3]])) + 1;
            // Packets are a multiple of four bytes long.
            self.pages.take(length.next_multiple_of(4).max(8) - 4, &mut self.packet)?;
            if self.packet[0] == 1 {
                break;
            }
        }
        if usize::from(u16::from_le_bytes([self.packet[4], self.packet[5]])) != self.streams {
            return Err(refuse("a packet has another number of attributes than the scan"));
        }
        let lengths = self.packet.get(6..6 + 2 * self.streams);
        let lengths = lengths.ok_or_else(|| refuse("a packet is shorter than it says"))?;
        let mut at = 6 + 2 * self.streams;
        for (stream, length) in lengths.as_chunks::<2>().0.iter().enumerate() {
            let end = at + usize::from(u16::from_le_bytes(*length));
            let bytes = self.packet.get(at..end);
            each(stream, bytes.ok_or_else(|| refuse("a packet is shorter than it says"))?);
            at = end;
        }
        Ok(())
    }
}
