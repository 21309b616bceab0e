//! Which format a file has: by name, media type, extension, or its first bytes.

use std::fmt;

/// File formats of clouds. All are read; [`Format::WRITTEN`] are written too.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Hash,
    serde::Serialize,
    serde::Deserialize,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantNames,
)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Polygon file format, ASCII or binary.
    Ply,
    /// Wavefront OBJ.
    Obj,
    /// Object file format of Geomview.
    Off,
    /// Triangles of stereolithography, ASCII or binary.
    Stl,
    /// A point per line, columns separated by blanks (also `.txt` and `.pts`).
    Xyz,
    /// Comma, semicolon or tab separated values.
    Csv,
    /// A NumPy array, n×d.
    Npy,
    /// Point Cloud Library: ASCII, binary, or compressed.
    Pcd,
    /// ASPRS LAS, versions 1.0 to 1.4.
    Las,
    /// LAS compressed by `LASzip`.
    Laz,
    /// ASTM E57.
    E57,
}

/// How far [`Format::sniff`] looks for text.
const SNIFFED_BYTES: usize = 4096;
/// How far a packed file is unpacked to look at it: binary STL is told by its length.
const SNIFFED_PACKED: usize = 64 << 20;
/// Lines of prose that may stand before what tells.
const SNIFFED_LINES: usize = 20;

impl Format {
    /// All formats.
    pub const ALL: [Self; 11] = [
        Self::Ply,
        Self::Obj,
        Self::Off,
        Self::Stl,
        Self::Xyz,
        Self::Csv,
        Self::Npy,
        Self::Pcd,
        Self::Las,
        Self::Laz,
        Self::E57,
    ];

    /// The formats that [`write()`](crate::cloud::writer::write()) writes.
    pub const WRITTEN: [Self; 10] = [
        Self::Ply,
        Self::Obj,
        Self::Off,
        Self::Stl,
        Self::Xyz,
        Self::Csv,
        Self::Npy,
        Self::Pcd,
        Self::Las,
        Self::Laz,
    ];

    /// Name in the interface.
    #[must_use]
    pub const fn name(self) -> &'static str {
        <Self as strum::VariantNames>::VARIANTS[self as usize]
    }

    /// Media type in answers. Only `model/obj`, `model/stl`, `model/e57` and `text/csv` are registered with IANA.
    #[must_use]
    pub const fn media_type(self) -> &'static str {
        self.media_types()[0]
    }

    /// Media types that ask for it, [`Self::media_type`] first.
    #[must_use]
    pub const fn media_types(self) -> &'static [&'static str] {
        match self {
            Self::Ply => &["application/ply", "model/ply", "application/x-ply"],
            Self::Obj => &["model/obj"],
            Self::Off => &["application/x-off"],
            Self::Stl => &["model/stl"],
            Self::Xyz => &["text/x-xyz", "text/plain"],
            Self::Csv => &["text/csv"],
            Self::Npy => &["application/x-npy", "application/npy", "application/octet-stream"],
            Self::Pcd => &["application/x-pcd"],
            Self::Las => &["application/vnd.las"],
            Self::Laz => &["application/vnd.laszip"],
            Self::E57 => &["model/e57"],
        }
    }

    /// Whether files of this format may be text.
    #[must_use]
    pub(super) const fn is_text(self) -> bool {
        matches!(self, Self::Ply | Self::Obj | Self::Off | Self::Stl | Self::Xyz | Self::Csv | Self::Pcd)
    }

    /// The format with this [`Self::name`], in any case.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        name.to_ascii_lowercase().parse().ok()
    }

    /// The format of a file with this extension (without the dot), in any case.
    #[must_use]
    pub fn from_extension(extension: &str) -> Option<Self> {
        match extension.to_ascii_lowercase().as_str() {
            "txt" | "pts" | "asc" | "ptx" | "pwn" => Some(Self::Xyz),
            "npz" => Some(Self::Npy),
            "coff" | "noff" => Some(Self::Off),
            "tsv" => Some(Self::Csv),
            name => Self::from_name(name),
        }
    }

    /// The format that a `Content-Type` names; parameters are ignored. `None` for the general types, such as
    /// `application/octet-stream` and `text/plain`: then the bytes decide.
    #[must_use]
    pub fn from_media_type(media_type: &str) -> Option<Self> {
        let essence = media_type.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
        let (kind, name) = essence.split_once('/')?;
        if !matches!(kind, "application" | "model" | "text") {
            return None;
        }
        match name.strip_prefix("x-").unwrap_or(name) {
            "tab-separated-values" => Some(Self::Csv),
            "wavefront-obj" => Some(Self::Obj),
            "vnd.las" => Some(Self::Las),
            "vnd.laszip" => Some(Self::Laz),
            name => Self::from_name(name),
        }
    }

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
            let (head, name) = super::container::head(bytes, SNIFFED_PACKED)?;
            name.as_deref().and_then(by_name).or_else(|| Self::sniff(&head))
        })
    }

    /// The format that the first bytes look like.
    #[must_use]
    pub fn sniff(bytes: &[u8]) -> Option<Self> {
        if super::foreign::told(bytes).is_some() {
            return None;
        }
        let head = &bytes[..bytes.len().min(SNIFFED_BYTES)];
        let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
        let decoded = super::text::from_utf16(head);
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
            return Some(if super::las::is_compressed(head) { Self::Laz } else { Self::Las });
        }
        if super::stl::is_stl(bytes) {
            return Some(Self::Stl);
        }
        if super::pcd::is_pcd(head) {
            return Some(Self::Pcd);
        }
        if head.contains(&0) {
            let first = head.split(|&byte| byte == b'\n').next().unwrap_or_default().trim_ascii();
            return (is_off(first) && first.to_ascii_uppercase().ends_with(b"BINARY")).then_some(Self::Off);
        }
        let lines = super::text::Lines::new(head).map(|line| line.text);
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
        let is_number = super::text::number(word).is_some();
        let names: Vec<String> = line
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty())
            .map(|word| String::from_utf8_lossy(word).into_owned())
            .collect();
        (is_number || super::names::axes(&names).is_some()).then_some(Self::Xyz)
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

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Ply => "PLY",
            Self::Obj => "OBJ",
            Self::Off => "OFF",
            Self::Stl => "STL",
            Self::Xyz => "XYZ",
            Self::Csv => "CSV",
            Self::Npy => "NPY",
            Self::Pcd => "PCD",
            Self::Las => "LAS",
            Self::Laz => "LAZ",
            Self::E57 => "E57",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_is_found_by_its_name_extension_and_media_type() {
        for format in Format::ALL {
            assert_eq!(Format::from_name(format.name()), Some(format));
            assert_eq!(Format::from_extension(&format.name().to_uppercase()), Some(format));
            assert_eq!(Format::from_media_type(format.media_type()), Some(format));
        }
        assert_eq!(Format::from_media_type("text/csv; charset=utf-8; header=present"), Some(Format::Csv));
        assert_eq!(Format::from_extension("pts"), Some(Format::Xyz));
    }

    #[test]
    fn every_format_that_is_written_is_one() {
        assert!(Format::WRITTEN.iter().all(|format| Format::ALL.contains(format)));
    }

    #[test]
    fn a_general_media_type_leaves_the_choice_to_the_bytes() {
        for general in ["application/octet-stream", "text/plain", "image/ply", "", "nonsense"] {
            assert_eq!(Format::from_media_type(general), None, "{general}");
        }
    }

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
