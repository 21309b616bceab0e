//! Which format a file has: by its name, else by its first bytes.

use super::{Format, container, foreign, las, names, pcd, stl, text};

/// How far [`Format::sniff`] looks for text.
const SNIFFED_BYTES: usize = 4096;
/// How far a packed file is unpacked to look at it: binary STL is recognized by its length.
const SNIFFED_PACKED: usize = 64 << 20;
/// Lines of prose that may stand before what tells.
const SNIFFED_LINES: usize = 20;

impl Format {
    /// The format of a file by its name, of which endings such as `.gz` and `.zip` are passed over; else by its bytes,
    /// within gzip and zip too.
    #[must_use]
    pub fn of_file(name: Option<&str>, bytes: &[u8]) -> Option<Self> {
        let by_name = |name: &str| {
            let mut endings = name.rsplit('.');
            let last = endings.next()?;
            let is_packed = ["gz", "gzip", "zip", "z"].iter().any(|ending| last.eq_ignore_ascii_case(ending));
            Self::from_extension(if is_packed { endings.next()? } else { last })
        };
        // A name without a dot has no ending.
        let named = name.filter(|name| name.contains('.')).and_then(by_name);
        named.or_else(|| Self::sniff(bytes)).or_else(|| {
            let (head, name) = container::head(bytes, SNIFFED_PACKED)?;
            name.as_deref().and_then(by_name).or_else(|| Self::sniff(&head))
        })
    }

    /// The format that the first bytes look like.
    #[must_use]
    pub fn sniff(bytes: &[u8]) -> Option<Self> {
        if foreign::told(bytes).is_some() {
            return None;
        }
        let head = &bytes[..bytes.len().min(SNIFFED_BYTES)];
        let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
        let decoded = text::from_utf16(head);
        let head = decoded.as_deref().unwrap_or(head);
        if head.starts_with(b"\x93NUMPY") {
            return Some(Self::Npy);
        }
        if head.starts_with(b"ply\n") || head.starts_with(b"ply\r") {
            return Some(Self::Ply);
        }
        if head.starts_with(b"ASTM-E57") {
            return Some(Self::E57);
        }
        if head.starts_with(b"LASF") {
            return Some(if las::is_compressed(head) { Self::Laz } else { Self::Las });
        }
        if stl::is_stl(bytes) {
            return Some(Self::Stl);
        }
        if pcd::is_pcd(head) {
            return Some(Self::Pcd);
        }
        if head.contains(&0) {
            let first = head.split(|&byte| byte == b'\n').next().unwrap_or_default().trim_ascii();
            return (is_off(first) && first.to_ascii_uppercase().ends_with(b"BINARY")).then_some(Self::Off);
        }
        let lines = text::Lines::new(head).map(|line| line.text);
        lines
            .filter(|line| !line.is_empty() && !is_comment(line))
            .take(SNIFFED_LINES)
            .find_map(Self::from_line)
    }

    /// What a line says that is not a comment.
    fn from_line(line: &[u8]) -> Option<Self> {
        let word = line.split(u8::is_ascii_whitespace).next()?;
        let is_obj =
            matches!(word, b"v" | b"vn" | b"vt" | b"vp" | b"f" | b"g" | b"o" | b"s" | b"mtllib" | b"usemtl");
        if is_obj && word.len() < line.len() {
            return Some(Self::Obj);
        }
        if is_off(word) {
            return Some(Self::Off);
        }
        if line.iter().any(|b| matches!(b, b',' | b';')) {
            return Some(Self::Csv);
        }
        let is_number = text::number(word).is_some();
        let names: Vec<String> = line
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty())
            .map(|word| String::from_utf8_lossy(word).into_owned())
            .collect();
        (is_number || names::axes(&names).is_some()).then_some(Self::Xyz)
    }
}

/// Whether a line begins as OFF does, with the letters of its variants before.
fn is_off(line: &[u8]) -> bool {
    let letters = line.iter().take_while(|b| b.is_ascii_alphabetic()).count();
    matches!(
        line[..letters].to_ascii_uppercase().as_slice(),
        b"OFF" | b"COFF" | b"NOFF" | b"CNOFF" | b"STOFF" | b"STCOFF" | b"STNOFF" | b"STCNOFF"
    )
}

fn is_comment(line: &[u8]) -> bool {
    line.starts_with(b"#") || line.starts_with(b"//")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_bytes_tell_the_format() {
        let cases: [(&[u8], Option<Format>); 18] = [
            (b"ply\r\nformat ascii 1.0", Some(Format::Ply)),
            (b"\x93NUMPY\x01\x00", Some(Format::Npy)),
            (b"# made by hand\nv 1 2 3", Some(Format::Obj)),
            (b"mtllib a.mtl\n", Some(Format::Obj)),
            (b"OFF\n3 1 0", Some(Format::Off)),
            (b"OFF490 518 0", Some(Format::Off)),
            (b"COFF 3 1 0", Some(Format::Off)),
            (b"\xEF\xBB\xBFx,y,z\n1,2,3", Some(Format::Csv)),
            (b"1;2;3", Some(Format::Csv)),
            (b"//X Y Z\n1 2 3", Some(Format::Xyz)),
            (b"nan 2 3", Some(Format::Xyz)),
            (b"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n", Some(Format::Pcd)),
            (b"VERSION .7\nFIELDS x y z\n", Some(Format::Pcd)),
            (b"solid cube\n facet normal 0 0 1\n", Some(Format::Stl)),
            (b"ASTM-E57\x01\0\0\0", Some(Format::E57)),
            (b"<html>", None),
            (b"1 2 3\0", None),
            (b"", None),
        ];
        for (bytes, format) in cases {
            assert_eq!(Format::sniff(bytes), format, "{}", String::from_utf8_lossy(bytes));
        }
    }
}
