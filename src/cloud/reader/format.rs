//! The formats of clouds: their names, media types and extensions.

use std::fmt;

use crate::arguments::words;

words! {
    /// File formats of clouds. All are read; [`Format::WRITTEN`] are written too.
    #[non_exhaustive]
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
        /// ASPRS LAS, versions 1.0 to 1.5.
        Las,
        /// LAS compressed by `LASzip`.
        Laz,
        /// ASTM E57.
        E57,
    }
}

/// Extensions beside the names of formats.
const OTHER_EXTENSIONS: [(&str, Format); 9] = [
    ("txt", Format::Xyz),
    ("pts", Format::Xyz),
    ("asc", Format::Xyz),
    ("ptx", Format::Xyz),
    ("pwn", Format::Xyz),
    ("npz", Format::Npy),
    ("coff", Format::Off),
    ("noff", Format::Off),
    ("tsv", Format::Csv),
];

impl Format {
    /// The formats that [`write()`](crate::cloud::writer::write()) writes: all but the last.
    pub const WRITTEN: [Self; Self::ALL.len() - 1] = {
        let [written @ .., Self::E57] = Self::ALL else { unreachable!() };
        written
    };

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

    /// The format of a file with this extension (without the dot), in any case.
    #[must_use]
    pub fn from_extension(extension: &str) -> Option<Self> {
        let extension = extension.to_ascii_lowercase();
        let other = OTHER_EXTENSIONS.into_iter().find(|(other, _)| *other == extension);
        other.map(|(_, format)| format).or_else(|| Self::from_name(&extension))
    }

    /// All extensions of files that are read, without dots.
    pub fn extensions() -> impl Iterator<Item = &'static str> {
        Self::ALL.into_iter().map(Self::name).chain(OTHER_EXTENSIONS.into_iter().map(|(other, _)| other))
    }

    /// All formats that are read, in words.
    pub(super) fn all_in_words() -> String {
        let [others @ .., last] = Self::ALL.map(|format| format.to_string());
        format!("{} or {last}", others.join(", "))
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
            name => {
                let of_this_type = |format: &Self| format.media_type() == essence;
                Self::from_name(name).or_else(|| Self::ALL.into_iter().find(of_this_type))
            }
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.name().to_ascii_uppercase())
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
        assert!(Format::extensions().all(|extension| Format::from_extension(extension).is_some()));
    }

    #[test]
    fn a_general_media_type_leaves_the_choice_to_the_bytes() {
        for general in ["application/octet-stream", "text/plain", "image/ply", "", "nonsense"] {
            assert_eq!(Format::from_media_type(general), None, "{general}");
        }
    }
}
