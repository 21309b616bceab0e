//! LAS and LAZ.
//!
//! A cloud that came as LAS is written in its own point format, with its own header and records; where nothing was
//! changed, byte for byte. Others are written as LAS 1.4, point formats 6 to 8.
//!
//! Coordinates are integers times a scale: on the grid of the file that the cloud came in, as long as all coordinates lie
//! on it, so that they come back bit for bit; else on the coarsest power of ten on which all lie, or the finest that the
//! extent of the cloud leaves. Fields with the name and range of an attribute become that attribute, the others extra
//! bytes of their own type.

mod axis;
mod frame;
mod points;

use std::io::{self, Cursor, Write};

use laz::{LasZipCompressor, LazItemRecordBuilder, LazVlr, LazVlrBuilder};

use self::axis::Axis;
use self::frame::Frame;
use self::points::Points;
use crate::cloud::PointCloud;

/// Points encoded together.
const CHUNK_POINTS: usize = 50_000;

/// Writes a cloud of at most three dimensions whose coordinates are all finite.
pub(super) fn write_las(cloud: &PointCloud, is_compressed: bool, out: &mut impl Write) -> io::Result<()> {
    if cloud.dimension() > 3 {
        return Err(unsupported(format!(
            "LAS has three coordinates; these points have {}",
            cloud.dimension()
        )));
    }
    if let Some(row) = (0..cloud.len()).find(|&row| !cloud.point(row).iter().all(|x| x.is_finite())) {
        return Err(unsupported(format!(
            "LAS has no place for point {row}, which has a non-finite coordinate; nonfinite=omit leaves such points out"
        )));
    }
    let axes = [0, 1, 2].map(|axis| Axis::of(cloud, axis));
    let points = Points::of(cloud);
    let packing = if is_compressed { Some(packing(&points)?) } else { None };
    let mut frame = Frame::of(cloud, &axes, &points, packing.as_ref())?;
    let starts = (0..cloud.len()).step_by(CHUNK_POINTS);
    let chunks =
        starts.map(|first| points.encode(cloud, &axes, first..(first + CHUNK_POINTS).min(cloud.len())));
    let Some(packing) = packing else {
        frame.place_extended(cloud.len() * points.record);
        out.write_all(&frame.head)?;
        for records in chunks {
            out.write_all(&records)?;
        }
        return frame.write_tail(out);
    };
    // Offsets among packed points count from the beginning of the file.
    let mut packed = Cursor::new(vec![0; frame.head.len()]);
    packed.set_position(frame.head.len() as u64);
    let mut compressor = LasZipCompressor::new(packed, packing).map_err(io::Error::other)?;
    for records in chunks {
        compressor.compress_many(&records)?;
    }
    compressor.done()?;
    let packed = compressor.into_inner().into_inner();
    frame.place_extended(packed.len() - frame.head.len());
    out.write_all(&frame.head)?;
    out.write_all(&packed[frame.head.len()..])?;
    frame.write_tail(out)
}

fn unsupported(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::Unsupported, message)
}

/// How points of this format are packed.
fn packing(points: &Points<'_>) -> io::Result<LazVlr> {
    let items = LazItemRecordBuilder::default_for_point_format_id(points.format, points.extra_bytes() as u16);
    Ok(LazVlrBuilder::new(items.map_err(io::Error::other)?).build())
}

#[cfg(test)]
mod tests;
