//! Commands on the results of `chladni analyze`: what the bases are for, without a server.

mod features;
mod filter;
mod per_row;
mod render;
mod results;
mod shapes;
mod transform;

use std::io::{self, Write};
use std::path::Path;

use chladni::cloud::ScalarType;
use chladni::cloud::writer::{Column, encode_rows, npy_header, npy_vector_header};
use serde::Serialize;

pub(crate) use features::{FeaturesArgs, features};
pub(crate) use filter::{FilterArgs, filter};
pub(crate) use per_row::{DistancesArgs, SignaturesArgs, distances, signatures};
pub(crate) use render::{RenderArgs, render};
pub(crate) use shapes::{InvariantsArgs, SimilarityArgs, invariants, similarity};
pub(crate) use transform::{CoefficientsArgs, SynthesisArgs, coefficients, synthesis};

use super::{Failure, output};
use results::Results;

/// A format that answers are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Output {
    Ply,
    Npy,
    Json,
}

impl Output {
    /// The format that a file's extension names.
    fn of(path: &Path, offered: &[Self]) -> Result<Self, Failure> {
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        let found = offered.iter().copied().find(|format| format.name() == extension);
        found.ok_or_else(|| {
            let names: Vec<_> = offered.iter().map(|format| format.name()).collect();
            let shown = path.display();
            Failure::Input(format!(
                "{shown}: the extension chooses the format; {} are possible",
                names.join(", ")
            ))
        })
    }

    fn name(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Npy => "npy",
            Self::Json => "json",
        }
    }
}

/// Writes JSON to the file, or to standard output when none is named.
fn write_json(value: &impl Serialize, path: Option<&Path>) -> Result<(), Failure> {
    let write = |out: &mut dyn Write| -> io::Result<()> {
        serde_json::to_writer(&mut *out, value)?;
        writeln!(out)
    };
    match path {
        Some(path) => output::write_file(path, |out| write(out)),
        None => write(&mut io::stdout().lock()).map_err(Failure::other),
    }
}

/// Writes columns as an array of rows × columns doubles; a single one, if `flat`, as an array of one axis.
fn write_npy(columns: &[Vec<f64>], flat: bool, path: &Path) -> Result<(), Failure> {
    let kind = ScalarType::Float64;
    let rows = columns.first().map_or(0, Vec::len);
    let header = if flat { npy_vector_header(rows, kind) } else { npy_header(rows, columns.len(), kind) };
    let encoded: Vec<_> = columns.iter().map(|values| Column { values, stride: 1, kind }).collect();
    output::write_file(path, |out| {
        out.write_all(&header)?;
        out.write_all(&encode_rows(&encoded, rows))
    })
}

/// Says what was written.
#[allow(clippy::print_stdout)] // the command's output
fn told(path: &Path, what: &str) {
    println!("{}: {what}", path.display());
}
