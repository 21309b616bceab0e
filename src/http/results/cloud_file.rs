//! A whole cloud as a file of the format asked for.

use std::io;

use crate::cloud::PointCloud;
use crate::cloud::reader::Format;
use crate::cloud::writer::{PlyEncoding, write, write_annotated_ply, write_npz};
use crate::http::wire::accept::{CSV, LAS, LAZ, NPZ, Offer, XYZ};
use crate::http::wire::problem::{Kind, Problem};

/// Writes a cloud with all its fields as NPZ, CSV, XYZ, LAS or LAZ; otherwise as PLY with comments.
///
/// # Errors
/// A problem when the format cannot hold this cloud.
pub(crate) fn encode(
    cloud: &PointCloud,
    offer: Offer,
    encoding: PlyEncoding,
    comments: &[String],
) -> Result<Vec<u8>, Problem> {
    let mut bytes = Vec::new();
    let written = match offer {
        NPZ => write_npz(cloud, &mut bytes),
        CSV => write(cloud, Format::Csv, &mut bytes),
        XYZ => write(cloud, Format::Xyz, &mut bytes),
        LAS => write(cloud, Format::Las, &mut bytes),
        LAZ => write(cloud, Format::Laz, &mut bytes),
        _ => write_annotated_ply(cloud, encoding, comments, &mut bytes),
    };
    match written {
        Ok(()) => Ok(bytes),
        Err(error) if error.kind() == io::ErrorKind::Unsupported => Err(Problem::new(
            Kind::NotAcceptable,
            format!("{error}; ask for ply, npy or npz, which hold every cloud"),
        )
        .with("accepted", vec!["ply", "npy", "npz"])),
        Err(error) => Err(Problem::internal(&error)),
    }
}
