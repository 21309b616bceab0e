//! Commands on the results of `chladni analyze`: what the bases are for, without a server.

mod features;
mod filter;
mod per_row;
mod render;
mod results;
mod shapes;
mod transform;

use std::io::Write;
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

use super::reporting::Reporting;
use super::{Failure, output};
use crate::arguments::words;
use results::Results;

words! {
    /// A format that answers are written in.
    enum Output {
        /// Points with the answer as properties.
        Ply,
        /// An array.
        Npy,
        /// Numbers as text.
        Json,
    }
}

/// In which form results are written, and what is said of it.
#[derive(Debug, clap::Args)]
struct Writing {
    /// Format in place of the one that the output's extension names; for standard output (`-`) json, or the first of the
    /// formats where there is no json
    #[arg(long, value_name = "FORMAT")]
    output_format: Option<String>,

    #[command(flatten)]
    reporting: Reporting,
}

impl Writing {
    /// Which of the named formats is asked for, or named by the file's extension.
    fn choice<T: Copy>(&self, path: &Path, offered: &[(&str, T)]) -> Result<T, Failure> {
        let named =
            |wanted: &str| offered.iter().find(|(name, _)| *name == wanted).map(|(_, format)| *format);
        let names = || offered.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
        if let Some(name) = &self.output_format {
            return named(name)
                .ok_or_else(|| Failure::Input(format!("--output-format {name}: {} are possible", names())));
        }
        if output::is_standard(path) {
            return Ok(named("json").unwrap_or(offered[0].1));
        }
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        named(extension).ok_or_else(|| {
            let shown = path.display();
            Failure::Input(format!("{shown}: the extension chooses the format; {} are possible", names()))
        })
    }
}

impl Output {
    /// The format that is asked for, or that a file's extension names.
    fn of(path: &Path, writing: &Writing, offered: &[Self]) -> Result<Self, Failure> {
        let offered: Vec<_> = offered.iter().map(|format| (format.name(), *format)).collect();
        writing.choice(path, &offered)
    }
}

/// Writes JSON to the file; to standard output for `-`.
fn write_json(value: &impl Serialize, path: &Path) -> Result<(), Failure> {
    output::write_file(path, |out| {
        serde_json::to_writer(&mut *out, value)?;
        writeln!(out)
    })
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
