//! A whole cloud as a file of the format asked for.

use std::io;

use crate::cloud::PointCloud;
use crate::cloud::reader::Format;
use crate::cloud::writer::{PlyEncoding, write, write_annotated_ply, write_npz};
use crate::http::wire::accept::{CSV, LAS, LAZ, NPZ, Offer, XYZ};
use crate::http::wire::download::unwritten;
use crate::http::wire::problem::{Kind, Problem};
use crate::jobs::Wanted;

/// Writes a cloud with all its fields as NPZ, CSV, XYZ, LAS or LAZ; otherwise as PLY with comments.
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
        CSV => write(cloud, Format::Csv, &mut out),
        XYZ => write(cloud, Format::Xyz, &mut out),
        LAS => write(cloud, Format::Las, &mut out),
        LAZ => write(cloud, Format::Laz, &mut out),
        _ => write_annotated_ply(cloud, encoding, comments, &mut out),
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
