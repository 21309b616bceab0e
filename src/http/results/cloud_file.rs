//! A whole cloud as a file of the format asked for.

use std::io;

use crate::arguments::{arguments, words};
use crate::cloud::PointCloud;
use crate::cloud::reader::Format;
use crate::cloud::writer::{PlyEncoding, write, write_annotated_ply, write_npz};
use crate::http::wire::accept::{NPZ, Offer, PLY};
use crate::http::wire::download::unwritten;
use crate::http::wire::problem::{Kind, Problem};
use crate::jobs::Wanted;

words! {
    /// What becomes of rows without a position.
    pub(crate) enum Unplaced {
        /// They stay, row for row as uploaded.
        Keep,
        /// They are left out.
        Omit,
    }
}

arguments! {
    /// Which rows are written.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Rows {
        /// Rows with a NaN or infinite coordinate in files of points: keep them, row for row as uploaded, or omit them, as
        /// formats such as LAS need it.
        nonfinite: Unplaced = word(Unplaced), default Unplaced::Keep;
    }
}

arguments! {
    /// How PLY is written.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Ply {
        /// Encoding of ply.
        encoding: PlyEncoding = word(PlyEncoding), default PlyEncoding::Binary;
    }
}

/// Writes a cloud in a format of clouds with all its fields; PLY with comments.
///
/// # Errors
/// A problem when the format cannot hold this cloud.
pub(crate) fn encode(
    cloud: &PointCloud,
    offer: Offer,
    encoding: PlyEncoding,
    comments: &[String],
    wanted: &Wanted,
) -> Result<Vec<u8>, Problem> {
    let mut bytes = Vec::new();
    let mut out = wanted.writer(&mut bytes);
    let written = match offer {
        NPZ => write_npz(cloud, &mut out),
        PLY => write_annotated_ply(cloud, encoding, comments, &mut out),
        other => match Format::from_name(other.name) {
            Some(format) => write(cloud, format, &mut out),
            None => return Err(Problem::internal(&format!("{} is not a format of clouds", other.name))),
        },
    };
    match written {
        Ok(()) => Ok(bytes),
        Err(error) if error.kind() == io::ErrorKind::Unsupported => Err(Problem::new(
            Kind::NotAcceptable,
            format!("{error}; ask for ply, npy or npz, which hold every cloud"),
        )
        .with("accepted", vec!["ply", "npy", "npz"])),
        Err(error) => Err(unwritten(&error)),
    }
}
