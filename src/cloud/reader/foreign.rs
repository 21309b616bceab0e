//! Recognizes files of other kinds by their first bytes, to name them instead of calling them broken clouds.

/// What a file is, and what to do instead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Foreign {
    pub(super) what: &'static str,
    pub(super) advice: &'static str,
}

const UNPACK: &str = "unpack it and send the file inside";
const EXPORT: &str = "export the points as PLY, LAS or E57 from the program that wrote it";
const NO_CLOUD: &str = "send the point cloud itself";
const PAGE: &str = "the download probably answered with a page; fetch the file itself";

/// First bytes, what they tell, and what to do.
const SIGNATURES: [(&[u8], &str, &str); 43] = [
    (b"%PDF-", "a PDF document", NO_CLOUD),
    (b"\x89PNG\r\n", "a PNG image", NO_CLOUD),
    (b"\xFF\xD8\xFF", "a JPEG image", NO_CLOUD),
    (b"GIF8", "a GIF image", NO_CLOUD),
    (b"BM\x36", "a BMP image", NO_CLOUD),
    (b"BM\x8A", "a BMP image", NO_CLOUD),
    (b"8BPS", "a Photoshop image", NO_CLOUD),
    (b"v/1\x01", "an OpenEXR image", NO_CLOUD),
    (b"\0\0\0\x0CjP  ", "a JPEG 2000 image", NO_CLOUD),
    (b"II*\0", "a TIFF image", "convert a height model to points, as XYZ or LAS, first"),
    (b"MM\0*", "a TIFF image", "convert a height model to points, as XYZ or LAS, first"),
    (b"II+\0", "a TIFF image", "convert a height model to points, as XYZ or LAS, first"),
    (b"RIFF", "a RIFF file (WebP, WAV or AVI)", NO_CLOUD),
    (b"7z\xBC\xAF\x27\x1C", "a 7z archive", UNPACK),
    (b"Rar!\x1A\x07", "a RAR archive", UNPACK),
    (b"\xFD7zXZ\0", "compressed by xz", UNPACK),
    (b"BZh", "compressed by bzip2", UNPACK),
    (b"\x28\xB5\x2F\xFD", "compressed by zstd", "unpack it, or send it with `Content-Encoding: zstd`"),
    (b"\x04\x22\x4D\x18", "compressed by lz4", UNPACK),
    (b"glTF", "a binary glTF scene", EXPORT),
    (b"Kaydara FBX Binary", "an FBX scene", EXPORT),
    (b"BLENDER", "a Blender file", EXPORT),
    (b"SQLite format 3\0", "an SQLite database", NO_CLOUD),
    (b"\x89HDF\r\n", "an HDF5 file", "write the points as NPY or NPZ"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file", "write the points as text or NPY"),
    (b"\x80\x02", "a Python pickle", "write the points by numpy.save"),
    (b"\x80\x03", "a Python pickle", "write the points by numpy.save"),
    (b"\x80\x04", "a Python pickle", "write the points by numpy.save"),
    (b"\x80\x05", "a Python pickle", "write the points by numpy.save"),
    (b"PAR1", "a Parquet table", "write the points as CSV or NPY"),
    (b"\xFF\xFE\0\0", "text in UTF-32", "save it in UTF-8"),
    (b"AC10", "a DWG drawing", EXPORT),
    (b"ISO-10303-21", "a STEP or IFC model", EXPORT),
    (b"#usda", "a USD scene", EXPORT),
    (b"$MeshFormat", "a mesh of Gmsh", EXPORT),
    (b"MeshVersionFormatted", "a mesh of Medit", EXPORT),
    (b"%!PS", "a PostScript document", NO_CLOUD),
    (b"\x7FELF", "a program", NO_CLOUD),
    (b"MZ\x90\0", "a program", NO_CLOUD),
    (b"# vtk DataFile", "a VTK file", EXPORT),
    (b"ROSBAG V", "a ROS bag", "write the points as PCD, by `pcl_ros bag_to_pcd`"),
    (b"version https://git-lfs", "a pointer of Git LFS", "fetch the file by `git lfs pull`"),
    (b"DRACO", "compressed by Draco", "decode it to PLY by `draco_decoder`"),
];

/// What the file is, if it is not a cloud.
pub(super) fn told(bytes: &[u8]) -> Option<Foreign> {
    let found = SIGNATURES.iter().find(|(signature, ..)| bytes.starts_with(signature));
    if let Some(&(_, what, advice)) = found {
        return Some(Foreign { what, advice });
    }
    if bytes.get(257..262) == Some(b"ustar") {
        return Some(Foreign { what: "a tar archive", advice: UNPACK });
    }
    if bytes.get(4..8) == Some(b"ftyp") {
        return Some(Foreign { what: "an MP4 video or a HEIC image", advice: NO_CLOUD });
    }
    let head = &bytes[..bytes.len().min(1024)];
    let text = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head).trim_ascii_start();
    let lower = text.to_ascii_lowercase();
    let what = |what, advice| Some(Foreign { what, advice });
    match lower.as_slice() {
        [b'p', b'k', 3, 4, ..] if contains(&lower, b"[content_types].xml") => {
            what("a document of Office, or 3MF", "send a table as CSV, a model as PLY")
        }
        [b'p', b'k', 3, 4, ..] if contains(&lower, b".kml") => what("a KMZ file", EXPORT),
        [b'<', b'!', b'd', b'o', b'c', ..] | [b'<', b'h', b't', b'm', b'l', ..] => what("an HTML page", PAGE),
        [b'<', ..] if contains(&lower, b"<html") => what("an HTML page", PAGE),
        [b'<', ..] if contains(&lower, b"<collada") => what("a COLLADA scene", EXPORT),
        [b'<', ..] if contains(&lower, b"<x3d") => what("an X3D scene", EXPORT),
        [b'<', ..] if contains(&lower, b"<vtkfile") => what("a VTK file", EXPORT),
        [b'<', ..] if contains(&lower, b"<svg") => what("an SVG image", NO_CLOUD),
        [b'<', b'?', b'x', b'm', b'l', ..] => what("an XML document", EXPORT),
        [b'{', b'\\', b'r', b't', b'f', ..] => what("a rich text document", NO_CLOUD),
        [b'{', ..] | [b'[', b'{' | b'[' | b'"', ..] => {
            what("JSON", "write the points as CSV, a point per line, or as NPY")
        }
        _ if lower.starts_with(b"#vrml") => what("a VRML scene", EXPORT),
        _ if is_raster(&lower) => what(
            "an ESRI ASCII grid, a raster of heights",
            "convert it to points, as XYZ, by `gdal_translate -of XYZ`",
        ),
        _ if lower.starts_with(b"0\nsection") || lower.starts_with(b"0\r\nsection") => {
            what("a DXF drawing", EXPORT)
        }
        _ => None,
    }
}

fn contains(text: &[u8], part: &[u8]) -> bool {
    text.windows(part.len()).any(|window| window == part)
}

fn is_raster(lower: &[u8]) -> bool {
    lower.starts_with(b"ncols") && contains(lower, b"nrows") && contains(lower, b"cellsize")
}

#[cfg(test)]
mod tests {
    use crate::cloud::reader::{Format, ReadError, ReadOptions, read};

    #[test]
    fn files_that_are_no_clouds_are_called_what_they_are() {
        for (bytes, what) in [
            (&b"%PDF-1.7\n"[..], "a PDF document"),
            (b"\x89PNG\r\n\x1a\n", "a PNG image"),
            (b"\xFF\xD8\xFF\xE0", "a JPEG image"),
            (b"<!DOCTYPE html><html>404", "an HTML page"),
            (b"\n<html><body>", "an HTML page"),
            (b"<?xml version=\"1.0\"?>\n<COLLADA>", "a COLLADA scene"),
            (b"{\"points\": []}", "JSON"),
            (b"ncols 4\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 1\n", "a raster of heights"),
            (b"version https://git-lfs.github.com/spec/v1\n", "Git LFS"),
            (b"7z\xBC\xAF\x27\x1C", "a 7z archive"),
            (b"\0\0\0\x18ftypheic", "a HEIC image"),
            (b"BM\x8A\0\0\0", "a BMP image"),
            (b"ISO-10303-21;\nHEADER;\n", "a STEP or IFC model"),
            (b"$MeshFormat\n4.1 0 8\n", "a mesh of Gmsh"),
            (b"\xFF\xFE\0\x001\0\0\0", "text in UTF-32"),
            (
                b"PK\x03\x04\x14\0\0\0\x08\0\0\0!\0\0\0\0\0\0\0\0\0\0\0\0\0\x13\0\0\0[Content_Types].xml",
                "a document of Office",
            ),
        ] {
            assert_eq!(Format::sniff(bytes), None);
            for format in [Format::Ply, Format::Xyz, Format::Las, Format::Obj] {
                let error = read(bytes, format, &ReadOptions::default()).unwrap_err();
                assert!(matches!(error, ReadError::Foreign { .. }), "{error}");
                assert!(error.to_string().contains(what), "{error}");
            }
        }
    }

    #[test]
    fn no_cloud_is_taken_for_another_file() {
        for text in [
            "AC 1 2\n",
            "BM1 1 2 3\n",
            "v 1 2 3\n",
            "[1] 2 3\n",
            "0\n1\n2\n",
            "OFF\n",
            "solid\nfacet",
            "1 2 3",
        ] {
            assert_eq!(super::told(text.as_bytes()), None, "{text}");
        }
    }
}
