//! Why a file was refused: always the place at fault and what would be accepted.

use std::fmt;

use super::Format;
use crate::cloud::CloudError;

/// Where in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Location {
    /// A line, counting from 1.
    Line(usize),
    /// A byte, counting from 0.
    Byte(usize),
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}

/// What makes bytes unfit to be read as a cloud.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// Nothing to read.
    #[error("the file is empty; send a point cloud as {}", Format::all_in_words())]
    Empty,
    /// Something else than a point cloud.
    #[error("this is {what}, not a point cloud; {advice}")]
    Foreign {
        /// What it is.
        what: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// A table without rows.
    #[error("{format}: the file has no row of numbers; write a point per line, such as `0.1 0.2 0.3`")]
    NoRows {
        /// Format it was read as.
        format: Format,
    },
    /// A header that names no coordinates.
    #[error(
        "{format}: no column is named x, y or z, nor as coordinates are otherwise named (easting, northing, height; \
         POINT_X; Points:0); the header names {names}; rename the columns, or say coordinates=3 when the first three are \
         the coordinates"
    )]
    NoAxes {
        /// Format it was read as.
        format: Format,
        /// The names that were found.
        names: String,
    },
    /// The file ends before it should.
    #[error("{format}, {location}: the file ends too early: {message}")]
    Truncated {
        /// Format it was read as.
        format: Format,
        /// Where it ends.
        location: Location,
        /// What is missing.
        message: String,
    },
    /// Something that the format does not allow.
    #[error("{format}, {location}: {message}")]
    Malformed {
        /// Format it was read as.
        format: Format,
        /// Where.
        location: Location,
        /// What is wrong, and what would be accepted.
        message: String,
    },
    /// A compressed file that would unpack to much more than such files do.
    #[error(
        "{format}: the file's {packed} bytes would unpack to {unpacked}; up to {} are accepted; send it uncompressed",
        super::unpacked_max(*.packed)
    )]
    TooCompressed {
        /// Format it was read as.
        format: Format,
        /// Bytes of the file.
        packed: usize,
        /// Bytes that its header announces.
        unpacked: usize,
    },
    /// `scan` names no scan of the file.
    #[error("the file has {scans} scans, 0 to {}; scan={scan} is none of them", .scans.saturating_sub(1))]
    NoSuchScan {
        /// Asked for.
        scan: usize,
        /// Scans of the file.
        scans: usize,
    },
    /// More points than the limit.
    #[error("the file has {points} points or more; up to {points_max} are accepted")]
    TooManyPoints {
        /// Announced by the header, or read before reading was given up.
        points: usize,
        /// The limit.
        points_max: usize,
    },
    /// More per-point scalars than the limit.
    #[error("the points have {fields} fields besides their coordinates; up to {fields_max} are accepted")]
    TooManyFields {
        /// Found.
        fields: usize,
        /// The limit.
        fields_max: usize,
    },
    /// More triangles than the limit.
    #[error("the file has more than {faces_max} triangles; leave the faces out, or send fewer")]
    TooManyFaces {
        /// The limit.
        faces_max: usize,
    },
    /// Numbers or triangles that would take more memory than the limit.
    #[error(
        "read, the file would take more than {allowed} bytes of memory, the most for a file of its size; send fewer fields \
         or faces, or numbers of wider types"
    )]
    TooMuchMemory {
        /// The limit.
        allowed: usize,
    },
    /// More coordinates than the limit.
    #[error(
        "points have {dimension} coordinates; up to {dimension_max} are accepted (dimension=3 takes the first \
         three columns as coordinates and keeps the rest as fields)"
    )]
    Dimension {
        /// Found.
        dimension: usize,
        /// The limit.
        dimension_max: usize,
    },
    /// The caller's `dimension` does not fit the file.
    #[error(
        "dimension={dimension} was asked for, but the rows have {columns} columns; 1 to {columns} are possible"
    )]
    DimensionColumns {
        /// Asked for.
        dimension: usize,
        /// Columns of the table.
        columns: usize,
    },
    /// The numbers were read, but they do not make a cloud.
    #[error(transparent)]
    Cloud(#[from] CloudError),
}

impl ReadError {
    /// [`Self::Malformed`] at a line.
    pub(super) fn line(format: Format, line: usize, message: impl Into<String>) -> Self {
        Self::Malformed { format, location: Location::Line(line), message: message.into() }
    }

    /// [`Self::Malformed`] at a byte.
    pub(super) fn byte(format: Format, byte: usize, message: impl Into<String>) -> Self {
        Self::Malformed { format, location: Location::Byte(byte), message: message.into() }
    }
}
